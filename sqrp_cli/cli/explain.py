"""`sqrp explain`: the coverage of a candidate over time, with the cause of every blind stretch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import (
    After,
    Images,
    Jobs,
    Json,
    SampleCount,
    SampleStep,
    Seed,
    TaskText,
    Tolerance,
    WorkspacePath,
    job_count,
    open_workspace,
    read_sampling,
)
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqrp_cli.cli.session import Session
    from sqrp_cli.programming.assessment import Study
    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.ranking import Ranked
    from sqrp_cli.report.documents.document import TaskDocument

NAME = "explain"


def command(
    workspace: WorkspacePath,
    task: TaskText,
    choose: Annotated[
        str | None,
        typer.Option("--choose", metavar="best|NAME", help="Which candidate to explain; the first-ranked by default."),
    ] = None,
    all_candidates: Annotated[bool, typer.Option("--all", help="Compare all candidates side by side.")] = False,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    after: After = None,
    images: Images = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Explain how well a way of doing a task is seen.

    Shows when each camera sees each literal, and what is in the way when it does not.
    """
    from sqrp_cli.cli.choice import check_choice, choose_candidate
    from sqrp_cli.cli.console import print_problems, say_raw
    from sqrp_cli.cli.session import Session, assess
    from sqrp_cli.cli.timeline_chart import print_comparison, print_study
    from sqrp_cli.programming.outside import intervals_outside
    from sqrp_cli.programming.ranking import rank
    from sqrp_cli.report.documents.document import as_text

    if all_candidates and choose is not None:
        raise InputError(Problem("bad-option", "--all and --choose exclude each other; give one of them"))
    choice = choose or "best"
    if images is not None:
        from sqrp_cli.report.pictures import check_pictures

        check_pictures(images)
    sampling = read_sampling(samples, dt, tolerance)
    session = Session.begin(open_workspace(workspace), task, after, sampling, seed=seed)
    print_problems(session.cell.warnings)
    check_choice(session.task, choice)
    assessments = list(assess(session, job_count(jobs)))
    print_problems(intervals_outside(assessments))
    ranking = rank(assessments, "q_eoi")
    explained = _explain(session, list(ranking) if all_candidates else [choose_candidate(ranking, choice)])
    if as_json:
        say_raw(as_text(_document(session, task, explained, several=all_candidates)))
    elif all_candidates:
        print_comparison(explained, sampling)
    else:
        print_study(session.cell, *explained[0], sampling)
    if images is not None:
        studies = [found for _, found in explained if found is not None]
        _write_images(session.cell, studies, images, several=all_candidates)
    return ExitCode.OK if any(found is not None for _, found in explained) else ExitCode.NONE_FEASIBLE


def _explain(session: Session, chosen: Sequence[Ranked]) -> list[tuple[Ranked, Study | None]]:
    """Each with its causes; without where it is infeasible."""
    from sqrp_cli.cli.console import progress
    from sqrp_cli.cli.session import explain

    explained = []
    with progress("Looking up causes", len(chosen)) as advance:
        for ranked in chosen:
            explained.append(explain(session.assignment, ranked))
            advance()
    return explained


def _document(
    session: Session, task: str, explained: Sequence[tuple[Ranked, Study | None]], *, several: bool
) -> TaskDocument:
    from sqrp_cli.report.documents.explanation import CandidateStudy, ExplainAllDocument, ExplainDocument

    cell, sampling = session.cell, session.assignment.sampling
    studies = [
        CandidateStudy.infeasible(ranked) if found is None else CandidateStudy.of_study(cell, found, ranked, sampling)
        for ranked, found in explained
    ]
    if several:
        return ExplainAllDocument(workspace=session.workspace.name, task=task, candidates=studies)
    return ExplainDocument(workspace=session.workspace.name, task=task, **vars(studies[0]))


def _write_images(cell: Cell, studies: Sequence[Study], images: Path, *, several: bool) -> None:
    """Pictures of every blind interval, in a folder per candidate if there may be several."""
    from sqrp_cli.cli.console import note, progress
    from sqrp_cli.report.pictures import SHEET, folder_of, write_pictures

    with progress("Taking pictures", len(studies)) as advance:
        for study in studies:
            folder = folder_of(study, images) if several else images
            blind = write_pictures(cell, study, folder)
            counted = f"{blind} blind interval{'s' if blind > 1 else ''}, see {folder / SHEET}"
            note(f"{study.candidate.name}: {counted if blind else 'never blind, so there are no pictures'}")
            advance()
