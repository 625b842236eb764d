"""`sqrp rank`: the candidates of a task, best first."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.request import flag, option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer, open_to_write, page_is_written
from sqrp_cli.cli.start import Start
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.ask.api.session import Session
    from sqrp_cli.study.result import CandidateResult, Ranking

NAME = "rank"


class RankCommand(
    requests.RankRequest,
    requests.Chosen,
    requests.Paged,
    requests.Watchable,
    requests.Seeded,
    requests.Printed,
    requests.StartCommand,
):
    """Rank the candidates of a task, each in its best way.

    The best are those in which the cameras see what matters. The chosen one can be written as a program.
    """

    program: Path | None = option(
        "--program", "Append the chosen candidate to this program file.", PATH, default=None, metavar="PROGRAM"
    )
    all: bool = flag("--all", "Show all candidates, also of a long ranking.")


def rank(context: Any, ask: RankCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Assess, rank, write what is to be written, and print."""
    from sqrp_cli.ask.api.session import Session, check_choice, world_before
    from sqrp_cli.checks.cell_warnings import cell_warnings, swept_cameras
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.platform.files import check_distinct
    from sqrp_cli.show.terminal.console import note, print_problems, say_command

    if ask.watch:
        return watched(context, {"--json": ask.json, "--program": ask.program})
    workspace, after = Start.of(ask.workspace, ask.after, ask.program)
    check_distinct({"--program": ask.program, "--report": ask.report})
    before = world_before(after, ask.program)
    cell = open_to_write(workspace, ask.seed, [ask.program, after], report=ask.report)
    session = Session.begin(cell.cell, ask.but(after=before))
    print_problems(cell_warnings(session.cell))
    check_choice(session.task, ask.choose)
    assessments, interrupted = _assess(session, ask.jobs)
    if not assessments:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(assessments))
    found = session.ranking(assessments, ask, interrupted=interrupted)
    if found.best is not None:
        ways = (one.way for one in found.best.steps or (found.best,))
        print_problems(swept_cameras(session.cell, session.assignment.world, ways))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(found, ask)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.candidate_page import write_ranking

        write = partial(write_ranking, found, session.assignment)
        if not page_is_written(ask.report, write, context.obj, ask.jobs):
            code = ExitCode.INTERRUPTED
    answer(found, as_json=ask.json, all_rows=ask.all)
    if message:
        note(message)
    if not ask.json and found.best is None and _lacks_a_precondition(session):
        words = [str(workspace), ask.task, *([] if before is None else ["--after", str(before)])]
        say_command("\nTo see whether something done first helps:", f"sqrp check {shlex.join(words)}")
    return code


def _lacks_a_precondition(session: Session) -> bool:
    """Whether a candidate of one step only waits for what other skills may establish."""
    from sqrp_cli.task.feasibility import unmet_preconditions

    one_step = (one for one in session.task.candidates if not one.steps)
    return any(unmet_preconditions(session.cell, one, session.assignment.world) for one in one_step)


def _assess(session: Session, jobs: int) -> tuple[list[CandidateResult], bool]:
    """The assessments of all candidates, or at Ctrl-C of the finished ones; and whether it was interrupted."""
    from sqrp_cli.ask.api.session import assess
    from sqrp_cli.show.terminal.console import note, progress

    assessments: list[CandidateResult] = []
    try:
        assessments.extend(assess(session, jobs, progress))  # keeps those that came before an exception
    except KeyboardInterrupt:
        note(f"interrupted when {len(assessments)} of {len(session.task.candidates)} candidates were finished")
        return assessments, True
    return assessments, False


def _write_chosen(found: Ranking, ask: RankCommand) -> tuple[ExitCode, str]:
    """Append the chosen candidate to a program, if one was named, unless it is infeasible.

    Returns the exit code and a message.
    """
    from sqrp_cli.ask.api.session import add_steps, choose_candidate, steps_of

    chosen, program, session = choose_candidate(found.candidates, ask.choose), ask.program, found.session
    if not chosen.feasible:
        if found.best is None and program is None:
            return ExitCode.NONE_FEASIBLE, ""
        consequence = "" if program is None else f", so {program} was not written"
        infeasible = f"{chosen.name} is infeasible ({chosen.reasons[0]})"
        why = "no candidate can be done" if ask.choose == "best" else infeasible
        return ExitCode.NONE_FEASIBLE, f"{why}{consequence}"
    if program is None:
        return ExitCode.OK, "" if ask.choose == "best" else f"{chosen.name} is chosen; --program FILE writes it"
    steps = steps_of(session, chosen)
    add_steps(session.cell, steps, session.assignment.sampling, program)
    where = "the last step" if len(steps) == 1 else f"the last {len(steps)} steps"
    return ExitCode.OK, f"{chosen.name} is now {where} of {program}"


command = command_of(RankCommand, rank)
