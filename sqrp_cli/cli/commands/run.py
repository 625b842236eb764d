"""`sqrp run`: a program in the simulated cell or, after checks and a question, on a robot; watched by its cameras."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.api.arguments import RunOutputs
from sqrp_cli.api.logged_run import LoggedRun
from sqrp_cli.api.program import DEFAULT_RUNS
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import answer, check_excluded, check_needed, program_with_warnings, read_share
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_option

if TYPE_CHECKING:
    from sqrp_cli.api.program import OpenProgram
    from sqrp_cli.api.robot import RobotSession
    from sqrp_cli.api.run_results import SimulatedRun
    from sqrp_cli.runtime.cell.ros_checks import CellCheck
    from sqrp_cli.runtime.record.events import Listener


NAME = "run"

_FORMS = (
    "slip@a4+0.4, slip@a4:random, slip@7.2, miss-pick, camera-loss:cam2@5, frozen:cam1@3, latency:cam3=0.5, "
    "perception-crash:cam1@4, 2:slip@a4 in step 2"
)

_OPTIONS = {"film": "--record", "log": "--log", "frames": "--frames", "page": "--report"}

MaybeProgram = Annotated[
    Path | None, typer.Argument(metavar="PROGRAM", help="A program file, as `sqrp rank --program` writes.")
]
Simulated = Annotated[bool, typer.Option("--sim", help="Run it in the simulated cell.")]
RobotFile = Annotated[
    Path | None, typer.Option("--robot", metavar="CONFIG", help="Run it on the robot that this file leads to.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="With --robot: check and look, but command nothing.")]
Agreed = Annotated[bool, typer.Option("--yes", help="With --robot: do not ask before it moves.")]
Speed = Annotated[
    str | None,
    typer.Option("--speed", metavar="PERCENT", help="With --robot: share of the program's speed, such as 10%."),
]
Faults = Annotated[
    list[str] | None, typer.Option("--fault", metavar="FAULT", help=f"Let this happen: {_FORMS}; repeatable.")
]
Sweep = Annotated[
    str | None,
    typer.Option("--sweep", metavar="[STEP:]slip@PRIMITIVE", help="Many runs, with a slip at other instants."),
]
RunCount = Annotated[int | None, typer.Option("--n", metavar="N", min=1, help="Runs of a sweep; 20 by default.")]
RecordFile = Annotated[
    Path | None,
    typer.Option(
        "--record",
        metavar="FILE",
        help="*.mp4: film all cameras, with what is seen drawn in. *.mcap, or *.bag for ROS 1: images, joints, "
        "frames, boxes and verdicts, as Foxglove and RViz show them and `sqrp audit` reads them.",
    ),
]
LogFile = Annotated[
    Path | None, typer.Option("--log", metavar="FILE", help="Write what happens, one JSON document per line.")
]
FramesFolder = Annotated[
    Path | None, typer.Option("--frames", metavar="DIR", help="Keep every image, as `sqrp audit` reads them.")
]
ReplayedLog = Annotated[
    Path | None,
    typer.Option(
        "--replay",
        metavar="LOG",
        help="Show a run again, from its log, without simulating; with PROGRAM its page has 3D playback, too.",
    ),
]


def command(
    context: typer.Context,
    program: MaybeProgram = None,
    sim: Simulated = False,
    robot: RobotFile = None,
    dry_run: DryRun = False,
    yes: Agreed = False,
    speed: Speed = None,
    fault: Faults = None,
    sweep: Sweep = None,
    n: RunCount = None,
    seed: option.Seed = 0,
    record: RecordFile = None,
    log: LogFile = None,
    frames: FramesFolder = None,
    replay: ReplayedLog = None,
    report: option.Report = None,
    as_json: option.Json = False,
) -> ExitCode:
    """Run a program, watched through camera images alone.

    The robot stops, tries again or goes on as the skill says when a fault is seen.
    """
    outputs = RunOutputs(film=record, log=log, frames=frames, page=report, options=_OPTIONS)
    _check_options(replay, sweep, n, fault, outputs)
    check_needed("--robot", robot, {"--dry-run": dry_run, "--yes": yes, "--speed": speed})
    if robot is not None:
        check_excluded("--robot", {"--sim": sim, "--fault": fault, "--sweep": sweep, "--replay": replay})
    outputs.check_names()
    if report is not None:
        option.check_report(report)
    if replay is not None:
        return _replay(replay, program, report, context.obj, as_json=as_json)
    if program is None:
        how = "--sim" if robot is None else f"--robot {shlex.quote(str(robot))}"
        raise InputError(Problem("no-program", "expected a program to run", mend=f"sqrp run PROGRAM {how}"))
    if robot is not None:
        run = run_on_robot(program, robot, speed, outputs, seed, dry_run=dry_run, yes=yes, as_json=as_json)
    elif sweep is not None:
        return _sweep(_open(program, sim=sim, seed=seed), sweep, n, as_json=as_json)
    else:
        run = _run(_open(program, sim=sim, seed=seed), fault or [], outputs, as_json=as_json)
    if dry_run and run.done and not as_json:
        from sqrp_cli.terminal.console import say

        say("The cell is as the program says, and so are the images where it starts. Nothing was commanded.")
        return ExitCode.OK
    return _show(run, report, context.obj, as_json=as_json)


def _check_options(
    replay: Path | None, sweep: str | None, n: int | None, fault: list[str] | None, outputs: RunOutputs
) -> None:
    """Raises InputError for options that exclude each other."""
    files = outputs.named
    if replay is not None:
        check_excluded("--replay", {"--fault": fault, "--sweep": sweep, "--n": n, **files, "--report": None})
    if sweep is not None:
        check_excluded("--sweep", {"--fault": fault, "--report": outputs.page, **files})
    check_needed("--sweep", sweep, {"--n": n})


def _open(path: Path, *, sim: bool, seed: int) -> OpenProgram:
    """The program with its workspace. Raises InputError where it cannot be run."""
    from sqrp_cli.runtime.cell.requirements import check_simulator
    from sqrp_cli.terminal.console import print_problems

    opened = program_with_warnings(path, seed)
    if not sim:
        message = "expected where to run it: --sim, or --robot with the file that leads to a robot"
        raise InputError(Problem("no-driver", message, mend=f"sqrp run {path} --sim"))
    check_simulator()
    print_problems(opened.warnings)
    return opened


def _run(opened: OpenProgram, faults: Sequence[str], outputs: RunOutputs, *, as_json: bool) -> SimulatedRun:
    """Run a program in the simulated cell, shown live."""
    injected, witnessed = opened.read_faults(faults, "--fault"), outputs.page is not None
    with _shown_live(opened, as_json=as_json) as listeners:
        return opened.run_into(outputs, injected, listeners=listeners, witnessed=witnessed)


@contextmanager
def _shown_live(opened: OpenProgram, *, as_json: bool, stopped: str = "") -> Iterator[Sequence[Listener]]:
    """What shows a run live; at Ctrl-C its finished steps are printed, and the command ends.

    stopped: what is said then of the robot.
    """
    from sqrp_cli.terminal.console import note
    from sqrp_cli.terminal.run_view import FinishedSteps, LiveView

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


def _replay(log: Path, program: Path | None, page: Path | None, arguments: Sequence[str], *, as_json: bool) -> ExitCode:
    """Show a run again; of one that was interrupted, what happened until then.

    program: leads to the workspace, for a page with 3D playback.
    """
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.terminal.console import note
    from sqrp_cli.terminal.run_view import FinishedSteps, LiveView

    logged = LoggedRun.read(log)
    if program is not None:
        logged = logged.of(option.read_program(program))
    check_not_read([page], [log, *([] if logged.program is None else logged.program.files)])
    finished = FinishedSteps([step.skill for step in logged.header.steps])
    with LiveView(logged.header.cameras, pace=not as_json) as view:
        run = logged.replay(finished, view)
    if run is not None:
        return _show(run, page, arguments, as_json=as_json)
    if page is not None or as_json:
        raise logged.no_report
    finished.show(logged.header.workspace)
    note(f"this log was interrupted at {finished}")
    return ExitCode.INTERRUPTED


def _sweep(opened: OpenProgram, slip: str, count: int | None, *, as_json: bool) -> ExitCode:
    """Many runs of a program, each with a slip at another instant; at Ctrl-C those that are finished are shown."""
    from sqrp_cli.runtime.run.injected_fault import parse_sweep
    from sqrp_cli.terminal.console import progress

    parse_sweep(slip, opened.program.steps, "--sweep")
    swept = opened.sweep(slip, count or DEFAULT_RUNS, progress=progress)
    answer(swept, as_json=as_json)
    if swept.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if swept.done else ExitCode.STOPPED_ON_FAULT


def _show(run: SimulatedRun, page: Path | None, arguments: Sequence[str], *, as_json: bool) -> ExitCode:
    """Write the page, if one is wanted, and print how a run went. arguments: of the command."""
    from sqrp_cli.terminal.console import note
    from sqrp_cli.terminal.run_view import wall_time

    if page is not None:
        run.write_page(page, arguments)
        note(f"open {page} in a browser")
    if not as_json and run.report.wall:
        note(wall_time(run.report))
    for fault in run.never_happened:
        note(f"--fault {fault} never happened: the run ended before, at {run.report.time:.2f} s")
    answer(run, as_json=as_json)
    return ExitCode.OK if run.done else ExitCode.STOPPED_ON_FAULT


LEAST_SPEED = 0.01
"""Below it a program would take a hundred times as long."""


def run_on_robot(
    program: Path,
    robot: Path,
    speed: str | None,
    outputs: RunOutputs,
    seed: int,
    *,
    dry_run: bool,
    yes: bool,
    as_json: bool,
) -> SimulatedRun:
    """Run a program on the robot that a file leads to; at Ctrl-C it stops.

    Raises InputError where the cell is not as the program says, or nobody agrees.
    """
    from sqrp_cli.api.robot import open_robot
    from sqrp_cli.terminal.console import print_problems

    if as_json and not dry_run and not yes:
        raise bad_option("--json leaves no room for a question; add --yes, or --dry-run")
    opened = program_with_warnings(program, seed)
    outputs.check_not_read([*opened.files, robot])
    print_problems(opened.warnings)
    share = 1.0 if speed is None else read_share(speed, "--speed", LEAST_SPEED)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the robot is told to stop, as at Ctrl-C
    with open_robot(opened, robot, share) as session:
        _check(session, robot, as_json=as_json)
        if not dry_run and not yes:
            _agree(session)
        with _shown_live(session.opened, as_json=as_json, stopped="; the robot is told to stop") as listeners:
            return session.run(outputs, listeners, moves=not dry_run)


def _check(session: RobotSession, robot: Path, *, as_json: bool) -> None:
    """Compare the cell with the program. Raises InputError where it differs."""
    from sqrp_cli.terminal.console import note

    note("watching the cell ...")
    checks = session.robot.check()
    if not as_json:
        _print_checks(checks)
    differing = [one for one in checks if one.problem is not None]
    problems = [Problem("other-cell", str(one.problem), Place(robot)) for one in differing]
    late = [index for index, one in enumerate(differing) if one.what == "age"]
    if late:
        mend = session.robot.cell.file.mend_of_lateness
        problems[late[-1]] = replace(problems[late[-1]], mend=mend or None)  # once for all
    if problems:
        raise InputError(*problems)


def _print_checks(checks: Sequence[CellCheck]) -> None:
    """What was compared."""
    from sqrp_cli.terminal.console import Column, print_table, say

    columns = [Column("cell"), Column("what"), Column("found"), Column("expected"), Column("")]
    rows = [[one.about, one.what, one.found, one.expected, "" if one.problem is None else "differs"] for one in checks]
    print_table(columns, rows)
    say()


def _agree(session: RobotSession) -> None:
    """Ask whether the robot may move. Raises InputError unless somebody says yes."""
    from sqrp_cli.terminal.console import ask, say

    program, refused = session.opened.program, "nobody agreed that the robot moves"
    seconds = sum(step.time for step in program.steps)
    say(f"The robot will move for {seconds:.0f} s. SQRP is no safety function: keep the emergency stop at hand.")
    sys.stdout.flush()
    try:
        agreed = ask("Move the robot? [y/N] ")
    except EOFError:
        agreed = ""
    if agreed.lower() not in ("y", "yes"):
        raise InputError(Problem("not-agreed", refused, mend="answer y, or give --yes"))
