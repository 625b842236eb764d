"""`sqrp cell`: the simulated cell as a process of its own."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import open_with_warnings, program_with_warnings
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_option

NAME = "cell"


class ServeCommand(requests.Seeded, requests.CellCommand):
    """Serve the simulated cell to other programs: it follows trajectories and publishes joint states and images.

    Runs until Ctrl-C. Its clock is `/clock`, which passes more slowly where this computer is too slow.
    """

    serve: str | None = option(
        "--serve", "By topics of ROS 2 (DDS).", values.one_of("ros2"), default=None, metavar="ros2"
    )
    config: Path | None = option(
        "--config", "Write how `run --robot` reaches it, once it can be reached.", PATH, default=None, metavar="FILE"
    )
    program: Path | None = option("--program", "Begin where this program begins.", PATH, default=None, metavar="FILE")
    faults: Sequence[str] = option(
        "--fault",
        "Let this happen, at times from the program's first motion: as in `run --sim`, and joints-loss@5, "
        "joints-frozen@5, joints-latency=0.5; repeatable.",
        values.texts("faults such as `slip@a4+0.4`"),
        default=(),
        metavar="FAULT",
    )
    domain: int | None = option(
        "--domain", "Of ROS 2; by default a free one.", values.count(0, 232), default=None, metavar="N"
    )
    network: str | None = option(
        "--network",
        "Interface or address of ROS 2; loopback by default.",
        values.text("a name"),
        default=None,
        metavar="NAME",
    )
    pace: float = option(
        "--pace",
        "How fast its time may pass; 0.1 on a busy computer.",
        values.number(1e-3, 100.0),
        default=1.0,
        metavar="FACTOR",
    )


def serve(_context: Any, ask: ServeCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Serve until Ctrl-C."""
    from sqrp_cli.ask.api.robot import serve as serve_cell
    from sqrp_cli.ask.api.robot import served_as
    from sqrp_cli.platform.files import check_not_read, check_writable, write_atomically
    from sqrp_cli.run.cell.robot_file import as_yaml
    from sqrp_cli.show.terminal.console import note

    config = ask.config
    if not ask.serve:
        raise bad_option("--serve is missing; expected ros2", mend=f"sqrp cell {ask.workspace} --serve ros2")
    if ask.faults and ask.program is None:
        raise bad_option("--fault needs --program: its times are those of a program")
    cell = open_with_warnings(ask.workspace, ask.seed)
    opened = None if ask.program is None else program_with_warnings(ask.program, ask.seed)
    if config is not None:
        check_not_read([config], [file.path for file in cell.workspace.files.values()])
        check_writable(config)
        _check_new(config)
    joints = tuple(cell.workspace.robot.home) if opened is None else opened.program.joints
    file = served_as(joints, cell, ask.network, ask.domain)

    def ready() -> None:
        if config is not None:
            _check_new(config)  # it may have come while the simulation was made ready
            write_atomically(config, as_yaml(file))
            leaving.callback(config.unlink, missing_ok=True)
        note(f"serving {cell.workspace.name} (domain {file.domain}, {file.network}) until Ctrl-C")

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    with ExitStack() as leaving:
        try:
            serve_cell(cell, opened, file, ask.faults, ask.seed, ready=ready, tell=note, factor=ask.pace)
        except KeyboardInterrupt:
            note("stopped serving")
    return ExitCode.OK


def _check_new(config: Path) -> None:
    """Raises InputError for a file that is there: it is removed at the end, and may be that of a real robot."""
    if config.exists() or config.is_symlink():
        message = "this file is there, and --config removes its file at the end"
        mend = "choose another name, or remove it if an earlier `sqrp cell` was killed and left it"
        raise InputError(Problem("would-overwrite", message, Place(config), mend=mend))


command = command_of(ServeCommand, serve)
