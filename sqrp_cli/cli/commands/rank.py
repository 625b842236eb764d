"""`sqrp rank`: the candidates of a task, best first."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import (
    After,
    Jobs,
    Json,
    MaxTime,
    Report,
    SampleCount,
    SampleStep,
    Seed,
    TaskText,
    Tolerance,
    WorkspacePath,
    check_max_time,
    check_report,
    job_count,
    open_with_warnings,
    read_calibration,
    read_sampling,
)
from sqrp_cli.errors import ExitCode, InputError, Problem, expected_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.arguments import WaysOption
    from sqrp_cli.api.cell import OpenCell
    from sqrp_cli.api.session import Session
    from sqrp_cli.programming.coverage.assessment import Assessment
    from sqrp_cli.programming.ranking import Criterion, Ranked

NAME = "rank"


def command(
    context: typer.Context,
    workspace: WorkspacePath,
    task: TaskText,
    by: Annotated[
        str, typer.Option("--by", help="What counts first: q_eoi, q_avg, time, delay or expected_time.")
    ] = "q_eoi",
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    program: Annotated[
        Path | None, typer.Option("--program", metavar="FILE", help="Append the chosen candidate to this program file.")
    ] = None,
    choose: Annotated[
        str, typer.Option("--choose", metavar="best|NAME", help="Which candidate goes into the program.")
    ] = "best",
    ways: Annotated[
        str,
        typer.Option(
            "--ways",
            metavar="best|all|fastest",
            help="Show each candidate by its best way, all that are Pareto-optimal, or take the fastest, seen or not.",
        ),
    ] = "best",
    max_time: MaxTime = None,
    after: After = None,
    calibration: Annotated[
        str | None,
        typer.Option("--calibration", metavar='"5 mm, 0.5 deg"', help="What if the cameras are off by this (1 sigma)?"),
    ] = None,
    report: Report = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Rank the candidates of a task, each in its best way.

    The best are those in which the cameras see what matters. The chosen one can be written as a program.
    """
    from sqrp_cli.api.results import Ranking
    from sqrp_cli.api.session import check_choice
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.programming.ranking import rank, read_criterion
    from sqrp_cli.terminal.console import note, print_problems, say_raw

    criterion = read_criterion(by)
    sampling = read_sampling(samples, dt, tolerance)
    drawn = read_calibration(calibration, seed)
    check_max_time(max_time)
    cell, before = _checked_files(workspace, seed, after, program, report)
    session = cell.begin(
        task,
        sampling=sampling,
        calibration=drawn,
        after=before,
        by=criterion,
        ways="best" if ways == "all" else _ways(ways),
        max_time=max_time,
    )
    print_problems(cell_warnings(session.cell))
    check_choice(session.task, choose)
    assessments, interrupted = _assess(session, job_count(jobs))
    if not assessments:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(assessments))
    ranked = rank(assessments, criterion)
    if report is not None and not interrupted:
        interrupted = not _page_is_written(session, ranked, criterion, report, context.obj, job_count(jobs))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(session, ranked, choose, program)
    ranking = Ranking(session, ranked, criterion, interrupted, all_ways=ways == "all")
    if as_json:
        say_raw(ranking.to_json())
    else:
        ranking.show()
    if message:
        note(message)
    return code


def _ways(text: str) -> WaysOption:
    """The value of `--ways`, other than `all`. Raises InputError for another one."""
    from sqrp_cli.api.arguments import WAYS

    for way in WAYS:
        if way == text:
            return way
    raise InputError(Problem("bad-option", f"--ways is `{text}`; {expected_names(text, (*WAYS, 'all'))}"))


def _checked_files(
    workspace: Path, seed: int, after: Path | None, program: Path | None, report: Path | None
) -> tuple[OpenCell, Path | None]:
    """The cell, and the program after which the task starts.

    Raises InputError, before anything is computed, if files cannot be read or written, or two are the same.
    """
    from sqrp_cli.api.session import world_before
    from sqrp_cli.platform.files import check_distinct, check_not_read

    check_distinct({"--program": program, "--report": report})
    before = world_before(after, program)
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([report], [program, after, *(file.path for file in cell.workspace.files.values())])
    return cell, before


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


def _page_is_written(
    session: Session, ranking: Sequence[Ranked], by: Criterion, file: Path, arguments: Sequence[str], jobs: int
) -> bool:
    """Write the page about a ranking; returns False if Ctrl-C came first."""
    from sqrp_cli.report.pages.candidate_page import write_ranking
    from sqrp_cli.terminal.console import note, progress

    task, assignment = session.task.text, session.assignment
    try:
        write_ranking(task, assignment, ranking, by, file, arguments=arguments, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        note(f"interrupted before {file} was written")
        return False
    note(f"open {file} in a browser")
    return True


def _write_chosen(
    session: Session, ranking: Sequence[Ranked], choose: str, program: Path | None
) -> tuple[ExitCode, str]:
    """Append the chosen candidate to a program, if one was named, unless it is infeasible.

    Returns the exit code and a message.
    """
    from sqrp_cli.api.session import ChosenStep, add_steps, choose_candidate

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
    step = ChosenStep(session.task.text, chosen.assessment, session.assignment.world)
    add_steps(session.cell, [step], session.assignment.sampling, program)
    return ExitCode.OK, f"{chosen.assessment.candidate.name} is now the last step of {program}"
