"""Programs in a cell: `run`, `cell`, `audit` and `calibrate`."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.calibration import learned
from sqrp_cli.ask.api.program import DEFAULT_RUNS, LoggedRun, audited, cameras_patch
from sqrp_cli.ask.request import Command, argument, flag, option
from sqrp_cli.cli.command import command, line
from sqrp_cli.cli.options import (
    Patches,
    answer,
    check_excluded,
    check_needed,
    check_report,
    open_with_warnings,
    program_with_warnings,
    read_program,
)
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_input, bad_option

if TYPE_CHECKING:
    from sqrp_cli.ask.api.program import OpenProgram
    from sqrp_cli.ask.api.robot import RobotSession
    from sqrp_cli.ask.api.run_results import SimulatedRun
    from sqrp_cli.run.record.events import Listener

LEAST_SPEED = 0.01  # below it a program would take a hundred times as long


class _Run(requests.RunRequest, requests.Paged, requests.Seeded, requests.Printed, Command):
    program: Path | None = argument(
        "PROGRAM", "A program file, as `sqrp rank --program` writes.", values.path, default=None
    )
    sim: bool = flag("--sim", "Run it in the simulated cell.")
    robot: Path | None = option(
        "--robot CONFIG", "Run it on the robot that this file leads to.", values.path, default=None
    )
    dry_run: bool = flag("--dry-run", "With --robot: check and look, but command nothing.")
    yes: bool = flag("--yes", "With --robot: do not ask before it moves.")
    speed: float | None = option(
        "--speed", "With --robot: share of the program's speed, such as 10%.", values.share(LEAST_SPEED), default=None
    )
    sweep: str | None = option(
        "--sweep [STEP:]slip@PRIMITIVE",
        "Many runs, with a slip at other instants.",
        values.text("a slip and where, such as `slip@a4`"),
        default=None,
    )
    n: int | None = option("--n", "Runs of a sweep; 20 by default.", values.count(1), default=None)
    replay: Path | None = option(
        "--replay LOG",
        "Show a run again, from its log, without simulating; with PROGRAM its page has 3D playback, too.",
        values.path,
        default=None,
    )


@command("run", _Run)
def run(ask: _Run) -> ExitCode:
    """Run, sweep or replay, as the options say."""
    files = ask.written()
    # Raises InputError for options that exclude each other.
    if ask.replay is not None:
        others = {"--fault": ask.faults, "--sweep": ask.sweep, "--n": ask.n, **files, "--report": None}
        check_excluded("--replay", others)
    if ask.sweep is not None:
        check_excluded("--sweep", {"--fault": ask.faults, **files})
    check_needed("--sweep", ask.sweep, {"--n": ask.n})
    check_needed("--robot", ask.robot, {"--dry-run": ask.dry_run, "--yes": ask.yes, "--speed": ask.speed})
    if ask.robot is not None:
        others = {"--sim": ask.sim, "--fault": ask.faults, "--sweep": ask.sweep, "--replay": ask.replay}
        check_excluded("--robot", others)
    ask.check_names()
    if ask.report is not None:
        check_report(ask.report)
    if ask.replay is not None:
        return _replay(ask.replay, ask)
    if ask.program is None:
        how = "--sim" if ask.robot is None else f"--robot {shlex.quote(str(ask.robot))}"
        raise bad_input("no-program", "expected a program to run", mend=f"sqrp run PROGRAM {how}")
    if ask.robot is not None:
        found = _run_on_robot(ask.program, ask.robot, ask)
    else:
        from sqrp_cli.run.cell.requirements import check_simulator
        from sqrp_cli.show.terminal.console import print_problems, progress

        opened = program_with_warnings(ask.program, ask.seed)
        if not ask.sim:
            message = "expected where to run it: --sim, or --robot with the file that leads to a robot"
            raise bad_input("no-driver", message, mend=f"sqrp run {ask.program} --sim")
        check_simulator()
        print_problems(opened.warnings)
        if ask.sweep is not None:
            swept = opened.sweep(ask.sweep, ask.n or DEFAULT_RUNS, progress=progress, option="--sweep")
            answer(swept, as_json=ask.json)
            if swept.interrupted:
                return ExitCode.INTERRUPTED
            return ExitCode.OK if swept.done else ExitCode.STOPPED_ON_FAULT
        opened.read_faults(ask.faults, "--fault")  # before anything is shown
        with _shown_live(opened, as_json=ask.json) as listeners:
            found = opened.run_into(ask.but(listeners=listeners, witnessed=ask.report is not None))
    if ask.dry_run and found.done and not ask.json:
        from sqrp_cli.show.terminal.console import say

        say("The cell is as the program says, and so are the images where it starts. Nothing was commanded.")
        return ExitCode.OK
    return _show(found, ask)


@contextmanager
def _shown_live(opened: OpenProgram, *, as_json: bool, stopped: str = "") -> Iterator[Sequence[Listener]]:
    """What shows a run live; at Ctrl-C its finished steps are printed, and the command ends.

    stopped: what is said then of the robot.
    """
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import FinishedSteps, LiveView

    finished = FinishedSteps([step.short_task for step in opened.program.steps])
    try:
        planned = sum(step.time for step in opened.program.steps)
        with LiveView(list(opened.workspace.cameras), planned=planned) as view:
            yield finished, view
    except KeyboardInterrupt:
        if not as_json:
            finished.show(opened.workspace.name)
        note(f"interrupted at {finished}{stopped}")
        raise typer.Exit(ExitCode.INTERRUPTED) from None


def _replay(log: Path, ask: _Run) -> ExitCode:
    """Show a run again; of one that was interrupted, what happened until then.

    A program leads to the workspace, for a page with 3D playback.
    """
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import FinishedSteps, LiveView

    LoggedRun.read(log)  # a file that is no log is told before what is wrong with the program
    opened = None if ask.program is None else read_program(ask.program)
    logged = LoggedRun.read(log, opened)
    check_not_read([ask.report], [log, *([] if opened is None else opened.files)])
    finished = FinishedSteps([step.skill for step in logged.header.steps])
    with LiveView(logged.header.cameras, pace=not ask.json) as view:
        run = logged.replay(finished, view)
    if run is not None:
        return _show(run, ask)
    if ask.report is not None or ask.json:
        raise logged.no_report
    finished.show(logged.header.workspace)
    note(f"this log was interrupted at {finished}")
    return ExitCode.INTERRUPTED


def _show(run: SimulatedRun, ask: _Run) -> ExitCode:
    """Write the page, if one is wanted, and print how a run went."""
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import wall_time

    if ask.report is not None:
        run.write_page(ask.report, line.get())
        note(f"open {ask.report} in a browser")
    if not ask.json and run.wall:
        note(wall_time(run))
    for fault in run.never_happened:
        note(f"--fault {fault} never happened: the run ended before, at {run.time:.2f} s")
    answer(run, as_json=ask.json)
    return ExitCode.OK if run.done else ExitCode.STOPPED_ON_FAULT


def _run_on_robot(program: Path, robot: Path, ask: _Run) -> SimulatedRun:
    """Run a program on the robot that a file leads to; at Ctrl-C it stops.

    Raises InputError where the cell is not as the program says, or nobody agrees.
    """
    from sqrp_cli.ask.api.robot import open_robot
    from sqrp_cli.show.terminal.console import ask as ask_user
    from sqrp_cli.show.terminal.console import print_problems, say

    if ask.json and not ask.dry_run and not ask.yes:
        raise bad_option("--json leaves no room for a question; add --yes, or --dry-run")
    opened = program_with_warnings(program, ask.seed)
    ask.check_not_read([*opened.files, robot])
    print_problems(opened.warnings)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the robot is told to stop, as at Ctrl-C
    with open_robot(opened, robot, ask.speed or 1.0) as session:
        check_cell(session, robot, as_json=ask.json)
        if not ask.dry_run and not ask.yes:
            seconds = sum(step.time for step in session.opened.program.steps)
            told = f"The robot will move for {seconds:.0f} s."
            say(f"{told} SQRP is no safety function: keep the emergency stop at hand.")
            sys.stdout.flush()
            try:
                agreed = ask_user("Move the robot? [y/N] ")
            except EOFError:
                agreed = ""
            if agreed.lower() not in ("y", "yes"):
                raise bad_input("not-agreed", "nobody agreed that the robot moves", mend="answer y, or give --yes")
        with _shown_live(session.opened, as_json=ask.json, stopped="; the robot is told to stop") as listeners:
            return session.run(ask.but(listeners=listeners), moves=not ask.dry_run)


def check_cell(session: RobotSession, robot: Path, *, as_json: bool) -> None:
    """Compare the cell with the program, and print what was compared. Raises InputError where it differs."""
    from sqrp_cli.show.terminal.console import Column, note, print_table, say

    note("watching the cell ...")
    checks = session.robot.check()
    if not as_json:
        columns = [Column("cell"), Column("what"), Column("found"), Column("expected"), Column("")]
        words = ["" if one.problem is None else "differs" for one in checks]
        rows = [[c.about, c.what, c.found, c.expected, word] for c, word in zip(checks, words, strict=True)]
        print_table(columns, rows)
        say()
    differing = [one for one in checks if one.problem is not None]
    problems = [Problem("other-cell", str(one.problem), Place(robot)) for one in differing]
    if late := [index for index, one in enumerate(differing) if one.what == "age"]:
        mend = session.robot.cell.file.mend_of_lateness
        problems[late[-1]] = replace(problems[late[-1]], mend=mend or None)  # once for all
    if problems:
        raise InputError(*problems)


class _Cell(requests.Seeded, requests.CellCommand):
    """Serve the simulated cell to other programs: it follows trajectories and publishes joint states and images.

    Runs until Ctrl-C. Its clock is `/clock`, which passes more slowly where this computer is too slow.
    """

    serve: str | None = option("--serve", "By topics of ROS 2 (DDS).", values.one_of("ros2"), default=None)
    config: Path | None = option(
        "--config FILE", "Write how `run --robot` reaches it, once it can be reached.", values.path, default=None
    )
    program: Path | None = option("--program FILE", "Begin where this program begins.", values.path, default=None)
    faults: Sequence[str] = option(
        "--fault FAULT",
        "Let this happen, at times from the program's first motion: as in `run --sim`, and joints-loss@5, "
        "joints-frozen@5, joints-latency=0.5; repeatable.",
        values.texts("faults such as `slip@a4+0.4`"),
        default=(),
    )
    domain: int | None = option("--domain", "Of ROS 2; by default a free one.", values.count(0, 232), default=None)
    network: str | None = option(
        "--network NAME", "Interface or address of ROS 2; loopback by default.", values.text("a name"), default=None
    )
    pace: float = option(
        "--pace FACTOR", "How fast its time may pass; 0.1 on a busy computer.", values.number(1e-3, 100.0), default=1.0
    )


@command("cell", _Cell)
def cell(ask: _Cell) -> ExitCode:
    """Serve until Ctrl-C."""
    from sqrp_cli.ask.api.robot import serve, served_as
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

    def check_new() -> None:
        """Raises InputError for a file that is there: it is removed at the end, and may be that of a real robot."""
        if config is not None and (config.exists() or config.is_symlink()):
            message = "this file is there, and --config removes its file at the end"
            mend = "choose another name, or remove it if an earlier `sqrp cell` was killed and left it"
            raise bad_input("would-overwrite", message, Place(config), mend=mend)

    if config is not None:
        check_not_read([config], cell.files)
        check_writable(config)
        check_new()
    joints = tuple(cell.workspace.robot.home) if opened is None else opened.program.joints
    file = served_as(joints, cell, ask.network, ask.domain)

    def ready() -> None:
        if config is not None:
            check_new()  # it may have come while the simulation was made ready
            write_atomically(config, as_yaml(file))
            leaving.callback(config.unlink, missing_ok=True)
        note(f"serving {cell.workspace.name} (domain {file.domain}, {file.network}) until Ctrl-C")

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    with ExitStack() as leaving:
        try:
            serve(cell, opened, file, ask.faults, ask.seed, ready=ready, tell=note, factor=ask.pace)
        except KeyboardInterrupt:
            note("stopped serving")
    return ExitCode.OK


CAMERAS = Patches("# Cameras as `sqrp audit` found them", "of `sqrp audit`")


class _Audit(requests.AuditRequest, requests.Printed, requests.OnProgram):
    patch: Path | None = option(
        "--patch FILE", "Write where cameras that have moved are, as a patch.", values.path, default=None
    )


@command("audit", _Audit)
def audit(ask: _Audit) -> ExitCode:
    """Compare, write the patch, and print."""
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.ros.bag import is_bag
    from sqrp_cli.run.cell.requirements import check_packages
    from sqrp_cli.show.terminal.console import note, progress

    if is_bag(ask.program):
        mend = shlex.join(["sqrp", "audit", str(ask.recording), str(ask.program)])
        raise bad_option("this is a recording; expected a program here", Place(ask.program), mend=mend)
    check_packages()
    opened = program_with_warnings(ask.program)
    if ask.patch is not None:
        CAMERAS.check(ask.patch)
        check_not_read([ask.patch], opened.files)
    found = audited(opened, ask.but(progress=progress))
    answer(replace(found, written=ask.patch is not None), as_json=ask.json)
    if ask.patch is not None:
        if patch := cameras_patch(opened.workspace, found.cameras):
            CAMERAS.write(ask.patch, patch)
            note(f"to have the poses: {to_apply(ask.patch, opened.workspace.whole_file.file)}")
        else:
            note(f"of no camera is it known that it has moved, so {ask.patch} is not written")
    return ExitCode.OK if found.passed else ExitCode.NONE_FEASIBLE


CURVES = Patches("# Curves that `sqrp calibrate` found", "of `sqrp calibrate`")


class _Calibrate(requests.CalibrateRequest, requests.Printed, Command):
    patch: Path | None = option(
        "--patch FILE", "Write a patch of the workspace with the curves.", values.path, default=None
    )


@command("calibrate", _Calibrate)
def calibrate(ask: _Calibrate) -> ExitCode:
    """Learn, write the patch, and print."""
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.show.terminal.console import note, progress

    if ask.patch is not None:
        CURVES.check(ask.patch)
    found = learned(ask.but(progress=progress))
    if ask.patch is not None:
        check_not_read([ask.patch], found.cell.files)
        CURVES.write(ask.patch, found.patch)
        note(f"to have the curves: {to_apply(ask.patch, found.cell.workspace.whole_file.file)}")
    answer(found, as_json=ask.json)
    return ExitCode.OK
