"""`sqrp run`: a program in the simulated cell or, after checks and a question, on a robot; watched by its cameras."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.program import DEFAULT_RUNS, LoggedRun
from sqrp_cli.ask.api.run_results import RunOutputs
from sqrp_cli.ask.request import Command, argument, option
from sqrp_cli.ask.values import FLAG, PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import (
    answer,
    check_excluded,
    check_needed,
    check_report,
    program_with_warnings,
    read_program,
)
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_option

if TYPE_CHECKING:
    from sqrp_cli.ask.api.program import OpenProgram
    from sqrp_cli.ask.api.robot import RobotSession
    from sqrp_cli.ask.api.run_results import SimulatedRun
    from sqrp_cli.run.record.events import Listener


NAME = "run"

LEAST_SPEED = 0.01
"""Below it a program would take a hundred times as long."""


class RunCommand(requests.RunRequest, requests.Paged, requests.Seeded, requests.Printed, Command):
    """Run a program, watched through camera images alone.

    The robot stops, tries again or goes on as the skill says when a fault is seen.
    """

    program: Path | None = argument("PROGRAM", "A program file, as `sqrp rank --program` writes.", PATH, default=None)
    sim: bool = option("--sim", "Run it in the simulated cell.", FLAG, default=False)
    robot: Path | None = option(
        "--robot", "Run it on the robot that this file leads to.", PATH, default=None, metavar="CONFIG"
    )
    dry_run: bool = option("--dry-run", "With --robot: check and look, but command nothing.", FLAG, default=False)
    yes: bool = option("--yes", "With --robot: do not ask before it moves.", FLAG, default=False)
    speed: float | None = option(
        "--speed",
        "With --robot: share of the program's speed, such as 10%.",
        values.share(LEAST_SPEED),
        default=None,
        metavar="PERCENT",
    )
    sweep: str | None = option(
        "--sweep",
        "Many runs, with a slip at other instants.",
        values.text("a slip and where, such as `slip@a4`"),
        default=None,
        metavar="[STEP:]slip@PRIMITIVE",
    )
    n: int | None = option("--n", "Runs of a sweep; 20 by default.", values.count(1), default=None, metavar="N")
    replay: Path | None = option(
        "--replay",
        "Show a run again, from its log, without simulating; with PROGRAM its page has 3D playback, too.",
        PATH,
        default=None,
        metavar="LOG",
    )


def run(context: Any, ask: RunCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Run, sweep or replay, as the options say."""
    outputs = RunOutputs.of(ask, page=ask.report)
    # Raises InputError for options that exclude each other.
    files = outputs.named
    if ask.replay is not None:
        others = {"--fault": ask.faults, "--sweep": ask.sweep, "--n": ask.n, **files, "--report": None}
        check_excluded("--replay", others)
    if ask.sweep is not None:
        check_excluded("--sweep", {"--fault": ask.faults, "--report": outputs.page, **files})
    check_needed("--sweep", ask.sweep, {"--n": ask.n})
    check_needed("--robot", ask.robot, {"--dry-run": ask.dry_run, "--yes": ask.yes, "--speed": ask.speed})
    if ask.robot is not None:
        others = {"--sim": ask.sim, "--fault": ask.faults, "--sweep": ask.sweep, "--replay": ask.replay}
        check_excluded("--robot", others)
    outputs.check_names()
    if ask.report is not None:
        check_report(ask.report)
    if ask.replay is not None:
        return _replay(ask.replay, ask, context.obj)
    if ask.program is None:
        how = "--sim" if ask.robot is None else f"--robot {shlex.quote(str(ask.robot))}"
        raise InputError(Problem("no-program", "expected a program to run", mend=f"sqrp run PROGRAM {how}"))
    if ask.robot is not None:
        found = run_on_robot(ask.program, ask.robot, ask, outputs)
    else:
        from sqrp_cli.run.cell.requirements import check_simulator
        from sqrp_cli.show.terminal.console import print_problems

        opened = program_with_warnings(ask.program, ask.seed)
        if not ask.sim:
            message = "expected where to run it: --sim, or --robot with the file that leads to a robot"
            raise InputError(Problem("no-driver", message, mend=f"sqrp run {ask.program} --sim"))
        check_simulator()
        print_problems(opened.warnings)
        if ask.sweep is not None:
            return _sweep(opened, ask.sweep, ask)
        injected = opened.read_faults(ask.faults, "--fault")
        with _shown_live(opened, as_json=ask.json) as listeners:
            found = opened.run_into(outputs, injected, listeners=listeners, witnessed=outputs.page is not None)
    if ask.dry_run and found.done and not ask.json:
        from sqrp_cli.show.terminal.console import say

        say("The cell is as the program says, and so are the images where it starts. Nothing was commanded.")
        return ExitCode.OK
    return _show(found, ask.report, context.obj, as_json=ask.json)


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


def _replay(log: Path, ask: RunCommand, arguments: Sequence[str]) -> ExitCode:
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
        return _show(run, ask.report, arguments, as_json=ask.json)
    if ask.report is not None or ask.json:
        raise logged.no_report
    finished.show(logged.header.workspace)
    note(f"this log was interrupted at {finished}")
    return ExitCode.INTERRUPTED


def _sweep(opened: OpenProgram, slip: str, ask: RunCommand) -> ExitCode:
    """Many runs of a program, each with a slip at another instant; at Ctrl-C those that are finished are shown."""
    from sqrp_cli.run.faults import parse_sweep
    from sqrp_cli.show.terminal.console import progress

    parse_sweep(slip, opened.program.steps, "--sweep")
    swept = opened.sweep(slip, ask.n or DEFAULT_RUNS, progress=progress)
    answer(swept, as_json=ask.json)
    if swept.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if swept.done else ExitCode.STOPPED_ON_FAULT


def _show(run: SimulatedRun, page: Path | None, arguments: Sequence[str], *, as_json: bool) -> ExitCode:
    """Write the page, if one is wanted, and print how a run went. arguments: of the command."""
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import wall_time

    if page is not None:
        run.write_page(page, arguments)
        note(f"open {page} in a browser")
    if not as_json and run.wall:
        note(wall_time(run))
    for fault in run.never_happened:
        note(f"--fault {fault} never happened: the run ended before, at {run.time:.2f} s")
    answer(run, as_json=as_json)
    return ExitCode.OK if run.done else ExitCode.STOPPED_ON_FAULT


def run_on_robot(program: Path, robot: Path, ask: RunCommand, outputs: RunOutputs) -> SimulatedRun:
    """Run a program on the robot that a file leads to; at Ctrl-C it stops.

    Raises InputError where the cell is not as the program says, or nobody agrees.
    """
    from sqrp_cli.ask.api.robot import open_robot
    from sqrp_cli.show.terminal.console import ask as ask_user
    from sqrp_cli.show.terminal.console import print_problems, say

    if ask.json and not ask.dry_run and not ask.yes:
        raise bad_option("--json leaves no room for a question; add --yes, or --dry-run")
    opened = program_with_warnings(program, ask.seed)
    outputs.check_not_read([*opened.files, robot])
    print_problems(opened.warnings)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the robot is told to stop, as at Ctrl-C
    with open_robot(opened, robot, ask.speed or 1.0) as session:
        _check(session, robot, as_json=ask.json)
        if not ask.dry_run and not ask.yes:
            seconds = sum(step.time for step in session.opened.program.steps)
            say(
                f"The robot will move for {seconds:.0f} s. SQRP is no safety function: keep the emergency stop at hand."
            )
            sys.stdout.flush()
            try:
                agreed = ask_user("Move the robot? [y/N] ")
            except EOFError:
                agreed = ""
            if agreed.lower() not in ("y", "yes"):
                raise InputError(
                    Problem("not-agreed", "nobody agreed that the robot moves", mend="answer y, or give --yes")
                )
        with _shown_live(session.opened, as_json=ask.json, stopped="; the robot is told to stop") as listeners:
            return session.run(outputs, listeners, moves=not ask.dry_run)


def _check(session: RobotSession, robot: Path, *, as_json: bool) -> None:
    """Compare the cell with the program, and print what was compared. Raises InputError where it differs."""
    from sqrp_cli.show.terminal.console import Column, note, print_table, say

    note("watching the cell ...")
    checks = session.robot.check()
    if not as_json:
        columns = [Column("cell"), Column("what"), Column("found"), Column("expected"), Column("")]
        differs = ["" if one.problem is None else "differs" for one in checks]
        rows = [[c.about, c.what, c.found, c.expected, word] for c, word in zip(checks, differs, strict=True)]
        print_table(columns, rows)
        say()
    differing = [one for one in checks if one.problem is not None]
    problems = [Problem("other-cell", str(one.problem), Place(robot)) for one in differing]
    late = [index for index, one in enumerate(differing) if one.what == "age"]
    if late:
        mend = session.robot.cell.file.mend_of_lateness
        problems[late[-1]] = replace(problems[late[-1]], mend=mend or None)  # once for all
    if problems:
        raise InputError(*problems)


command = command_of(RunCommand, run)
