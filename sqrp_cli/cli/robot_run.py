"""`sqrp run --robot`: checks, a question, and the run."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.cli.options import program_with_warnings, read_share
from sqrp_cli.errors import InputError, Place, Problem, bad_option

if TYPE_CHECKING:
    from sqrp_cli.api.arguments import RunOutputs
    from sqrp_cli.api.robot import RobotSession
    from sqrp_cli.api.run_results import SimulatedRun
    from sqrp_cli.runtime.cell.ros_checks import CellCheck

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
) -> SimulatedRun | None:
    """Run a program on the robot that a file leads to; at Ctrl-C it stops, and None is returned.

    Raises InputError where the cell is not as the program says, or nobody agrees.
    """
    from sqrp_cli.api.robot import open_robot
    from sqrp_cli.terminal.console import note, print_problems
    from sqrp_cli.terminal.run_view import FinishedSteps, LiveView

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
        finished = FinishedSteps(session.opened.program)
        try:
            with LiveView(list(opened.workspace.cameras)) as view:
                return session.run(
                    film=outputs.film,
                    log=outputs.log,
                    frames=outputs.frames,
                    listeners=[finished, view],
                    moves=not dry_run,
                )
        except KeyboardInterrupt:
            if not as_json:
                finished.show(opened.workspace.name)
            note(f"interrupted at {finished}; the robot is told to stop")
            return None


def _check(session: RobotSession, robot: Path, *, as_json: bool) -> None:
    """Compare the cell with the program. Raises InputError where it differs."""
    from sqrp_cli.terminal.console import note

    note("watching the cell ...")
    checks = session.check()
    if not as_json:
        _print_checks(checks)
    problems = [Problem("other-cell", one.problem, Place(robot)) for one in checks if one.problem is not None]
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
