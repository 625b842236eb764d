"""`sqrp cell`: the simulated cell as a process of its own."""

from __future__ import annotations

import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Seed, WorkspacePath, open_with_warnings, program_with_warnings
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_option

NAME = "cell"

ServedBy = Annotated[str, typer.Option("--serve", metavar="ros2", help="By topics of ROS 2 (DDS).")]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE", help="Write how `run --robot` reaches it, once it can be reached."),
]
FirstProgram = Annotated[
    Path | None, typer.Option("--program", metavar="FILE", help="Begin where this program begins.")
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="FAULT",
        help="Let this happen, at times from the program's first motion: as in `run --sim`, and joints-loss@5, "
        "joints-frozen@5, joints-latency=0.5; repeatable.",
    ),
]
RosDomain = Annotated[
    int | None, typer.Option("--domain", metavar="N", min=0, max=232, help="Of ROS 2; by default a free one.")
]
RosNetwork = Annotated[
    str | None, typer.Option("--network", metavar="NAME", help="Interface or address of ROS 2; loopback by default.")
]
Pace = Annotated[
    float,
    typer.Option(
        "--pace", metavar="FACTOR", min=0.001, max=100.0, help="How fast its time may pass; 0.1 on a busy computer."
    ),
]


def command(
    workspace: WorkspacePath,
    serve: ServedBy = "",
    config: ConfigFile = None,
    program: FirstProgram = None,
    fault: Faults = None,
    domain: RosDomain = None,
    network: RosNetwork = None,
    pace: Pace = 1.0,
    seed: Seed = 0,
) -> ExitCode:
    """Serve the simulated cell to other programs: it follows trajectories and publishes joint states and images.

    Runs until Ctrl-C. Its clock is `/clock`, which passes more slowly where this computer is too slow.
    """
    from sqrp_cli.api.robot import serve as serve_cell
    from sqrp_cli.api.robot import served_as
    from sqrp_cli.platform.files import check_not_read, check_writable, write_atomically
    from sqrp_cli.runtime.cell.robot_file import as_yaml
    from sqrp_cli.terminal.console import note

    if serve != "ros2":
        found = f"is `{serve}`" if serve else "is missing"
        raise bad_option(f"--serve {found}; expected ros2", mend=f"sqrp cell {workspace} --serve ros2")
    if fault and program is None:
        raise bad_option("--fault needs --program: its times are those of a program")
    cell = open_with_warnings(workspace, seed)
    opened = None if program is None else program_with_warnings(program, seed)
    if config is not None:
        check_not_read([config], [file.path for file in cell.workspace.files.values()])
        check_writable(config)
        _check_new(config)
    joints = tuple(cell.workspace.robot.home) if opened is None else opened.program.joints
    file = served_as(joints, cell, network, domain)

    def ready() -> None:
        if config is not None:
            _check_new(config)  # it may have come while the simulation was made ready
            write_atomically(config, as_yaml(file))
            leaving.callback(config.unlink, missing_ok=True)
        note(f"serving {cell.workspace.name} (domain {file.domain}, {file.network}) until Ctrl-C")

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    with ExitStack() as leaving:
        try:
            serve_cell(cell, opened, file, fault or [], seed, ready=ready, tell=note, factor=pace)
        except KeyboardInterrupt:
            note("stopped serving")
    return ExitCode.OK


def _check_new(config: Path) -> None:
    """Raises InputError for a file that is there: it is removed at the end, and may be that of a real robot."""
    if config.exists() or config.is_symlink():
        message = "this file is there, and --config removes its file at the end"
        mend = "choose another name, or remove it if an earlier `sqrp cell` was killed and left it"
        raise InputError(Problem("would-overwrite", message, Place(config), mend=mend))
