"""`sqrp rank`: the candidates of a task, best first."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.api.results import Ranking
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import answer, job_count, open_to_write, page_is_written
from sqrp_cli.cli.start import Start
from sqrp_cli.cli.watch import Watch, watched
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.session import Session
    from sqrp_cli.programming.coverage.assessment import Assessment
    from sqrp_cli.programming.ranking import Ranked

NAME = "rank"

By = Annotated[str, typer.Option("--by", metavar="q_eoi|q_avg|time|delay|expected_time", help="What counts first.")]
ProgramFile = Annotated[
    Path | None, typer.Option("--program", metavar="PROGRAM", help="Append the chosen candidate to this program file.")
]
AllRows = Annotated[bool, typer.Option("--all", help="Show all candidates, also of a long ranking.")]
CameraErrors = Annotated[
    str | None,
    typer.Option("--calibration", metavar='"5 mm, 0.5 deg"', help="Draw camera poses with these errors (1 sigma)."),
]


def command(
    context: typer.Context,
    workspace: option.StartPath,
    task: option.TaskText,
    by: By = "q_eoi",
    samples: option.SampleCount = None,
    dt: option.SampleStep = None,
    tolerance: option.Tolerance = None,
    program: ProgramFile = None,
    choose: option.Choose = None,
    ways: option.Ways = "best",
    all_rows: AllRows = False,
    max_time: option.MaxTime = None,
    after: option.After = None,
    calibration: CameraErrors = None,
    report: option.Report = None,
    jobs: option.Jobs = None,
    seed: option.Seed = 0,
    watch: Watch = False,
    as_json: option.Json = False,
) -> ExitCode:
    """Rank the candidates of a task, each in its best way.

    The best are those in which the cameras see what matters. The chosen one can be written as a program.
    """
    from sqrp_cli.api.session import check_choice, world_before
    from sqrp_cli.checks.cell_warnings import cell_warnings, swept_cameras
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.platform.files import check_distinct
    from sqrp_cli.programming.ranking import rank, read_criterion
    from sqrp_cli.terminal.console import note, print_problems, say_command

    if watch:
        return watched(context, {"--json": as_json, "--program": program})
    workspace, after = Start.of(workspace, after, program)
    criterion, (wanted, all_ways) = read_criterion(by), option.read_ways(ways)
    sampling = option.read_sampling(samples, dt, tolerance)
    drawn = option.read_calibration(calibration, seed)
    option.check_max_time(max_time)
    check_distinct({"--program": program, "--report": report})
    before = world_before(after, program)
    cell = open_to_write(workspace, seed, [program, after], report=report)
    session = cell.begin(
        task,
        sampling=sampling,
        calibration=drawn,
        after=before,
        by=criterion,
        ways=wanted,
        max_time=max_time,
    )
    print_problems(cell_warnings(session.cell))
    choice = "best" if choose is None else choose
    check_choice(session.task, choice)
    assessments, interrupted = _assess(session, job_count(jobs))
    if not assessments:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(assessments))
    ranked = rank(assessments, criterion)
    if ranked[0].rank is not None:
        best = ranked[0].assessment
        print_problems(swept_cameras(cell.cell, session.assignment.world, (one.way for one in best.steps or (best,))))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(session, ranked, choice, program)
    if report is not None and not interrupted:
        from sqrp_cli.report.pages.candidate_page import write_ranking

        write = partial(write_ranking, session.task.text, session.assignment, ranked, criterion)
        if not page_is_written(report, write, context.obj, job_count(jobs)):
            code = ExitCode.INTERRUPTED
    answer(Ranking(session, ranked, criterion, interrupted, all_ways=all_ways, all_rows=all_rows), as_json=as_json)
    if message:
        note(message)
    if not as_json and ranked[0].rank is None and _lacks_a_precondition(session):
        words = [str(workspace), task, *([] if before is None else ["--after", str(before)])]
        say_command("\nTo see whether something done first helps:", f"sqrp check {shlex.join(words)}")
    return code


def _lacks_a_precondition(session: Session) -> bool:
    """Whether a candidate of one step only waits for what other skills may establish."""
    from sqrp_cli.programming.feasibility import unmet_preconditions

    one_step = (one for one in session.task.candidates if not one.steps)
    return any(unmet_preconditions(session.cell, one, session.assignment.world) for one in one_step)


def _assess(session: Session, jobs: int) -> tuple[list[Assessment], bool]:
    """The assessments of all candidates, or at Ctrl-C of the finished ones; and whether it was interrupted."""
    from sqrp_cli.api.session import assess
    from sqrp_cli.terminal.console import note, progress

    assessments: list[Assessment] = []
    try:
        assessments.extend(assess(session, jobs, progress))  # keeps those that came before an exception
    except KeyboardInterrupt:
        note(f"interrupted when {len(assessments)} of {len(session.task.candidates)} candidates were finished")
        return assessments, True
    return assessments, False


def _write_chosen(
    session: Session, ranking: Sequence[Ranked], choose: str, program: Path | None
) -> tuple[ExitCode, str]:
    """Append the chosen candidate to a program, if one was named, unless it is infeasible.

    Returns the exit code and a message.
    """
    from sqrp_cli.api.session import add_steps, choose_candidate, steps_of

    chosen = choose_candidate(ranking, choose)
    if chosen.rank is None:
        if ranking[0].rank is None and program is None:
            return ExitCode.NONE_FEASIBLE, ""
        consequence = "" if program is None else f", so {program} was not written"
        name, reason = chosen.assessment.candidate.name, chosen.assessment.reasons[0]
        why = "no candidate can be done" if choose == "best" else f"{name} is infeasible ({reason})"
        return ExitCode.NONE_FEASIBLE, f"{why}{consequence}"
    if program is None:
        message = "" if choose == "best" else f"{chosen.assessment.candidate.name} is chosen; --program FILE writes it"
        return ExitCode.OK, message
    steps = steps_of(session, chosen.assessment)
    add_steps(session.cell, steps, session.assignment.sampling, program)
    where = "the last step" if len(steps) == 1 else f"the last {len(steps)} steps"
    return ExitCode.OK, f"{chosen.assessment.candidate.name} is now {where} of {program}"
