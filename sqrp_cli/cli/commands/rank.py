"""`sqrp rank`: the candidates of a task, best first."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli import completion
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
    Ways,
    WorkspacePath,
    answer,
    check_max_time,
    check_report,
    job_count,
    open_with_warnings,
    page_is_written,
    read_bounds,
    read_calibration,
    read_sampling,
    read_ways,
)
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.cell import OpenCell
    from sqrp_cli.api.session import Session
    from sqrp_cli.programming.coverage.assessment import Assessment
    from sqrp_cli.programming.ranking import Criterion, Ranked

NAME = "rank"

By = Annotated[str, typer.Option("--by", metavar="q_eoi|q_avg|time|delay|expected_time", help="What counts first.")]
ProgramFile = Annotated[
    Path | None, typer.Option("--program", metavar="FILE", help="Append the chosen candidate to this program file.")
]
Choice = Annotated[
    str,
    typer.Option(
        "--choose",
        metavar="best|N|NAME",
        autocompletion=completion.candidates,
        help="Which candidate goes into the program: by its place in the ranking, or its name.",
    ),
]
AllRows = Annotated[bool, typer.Option("--all", help="Show all candidates, also of a long ranking.")]
CameraErrors = Annotated[
    str | None,
    typer.Option("--calibration", metavar='"5 mm, 0.5 deg"', help="What if the cameras are off by this (1 sigma)?"),
]

CameraBounds = Annotated[
    str | None,
    typer.Option("--certify", metavar='"2 mm, 0.2 deg"', help="Prove what holds wherever each camera is within this."),
]


def command(
    context: typer.Context,
    workspace: WorkspacePath,
    task: TaskText,
    by: By = "q_eoi",
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    program: ProgramFile = None,
    choose: Choice = "best",
    ways: Ways = "best",
    all_rows: AllRows = False,
    max_time: MaxTime = None,
    after: After = None,
    calibration: CameraErrors = None,
    certify: CameraBounds = None,
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
    from sqrp_cli.terminal.console import note, print_problems

    criterion, (wanted, all_ways) = read_criterion(by), read_ways(ways)
    sampling, drawn = read_sampling(samples, dt, tolerance), read_calibration(calibration, seed)
    bounds = read_bounds(certify, sampling)
    check_max_time(max_time)
    cell, before = _checked_files(workspace, seed, after, program, report)
    session = cell.begin(
        task,
        sampling=sampling,
        calibration=drawn,
        certify=bounds,
        after=before,
        by=criterion,
        ways=wanted,
        max_time=max_time,
    )
    print_problems(cell_warnings(session.cell))
    check_choice(session.task, choose)
    assessments, interrupted = _assess(session, job_count(jobs))
    if not assessments:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(assessments))
    ranked = rank(assessments, criterion)
    interrupted = interrupted or not _page_is_written(session, ranked, criterion, report, context.obj, job_count(jobs))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(session, ranked, choose, program)
    answer(Ranking(session, ranked, criterion, interrupted, all_ways=all_ways, all_rows=all_rows), as_json=as_json)
    if message:
        note(message)
    return code


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
    session: Session, ranking: Sequence[Ranked], by: Criterion, file: Path | None, arguments: Sequence[str], jobs: int
) -> bool:
    """Write the page about a ranking, if it is wanted; returns False if Ctrl-C came first."""
    if file is None:
        return True
    from sqrp_cli.report.pages.candidate_page import write_ranking
    from sqrp_cli.terminal.console import progress

    def write(path: Path) -> None:
        task, assignment = session.task.text, session.assignment
        write_ranking(task, assignment, ranking, by, path, arguments=arguments, jobs=jobs, progress=progress)

    return page_is_written(file, write)


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
