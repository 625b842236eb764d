"""`sqrp explain`: the coverage of a candidate over time, with the cause of every blind stretch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from sqrp_cli.cli.options import (
    After,
    Jobs,
    Json,
    SampleCount,
    SampleStep,
    TaskText,
    Tolerance,
    WorkspacePath,
    job_count,
    open_workspace,
    read_sampling,
)
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.cli.session import Session
    from sqrp_cli.programming.ranking import Ranked

NAME = "explain"


def command(
    workspace: WorkspacePath,
    task: TaskText,
    choose: Annotated[
        str,
        typer.Option("--choose", metavar="best|NAME", help="Which candidate to explain; the first-ranked by default."),
    ] = "best",
    all_candidates: Annotated[bool, typer.Option("--all", help="Explain every candidate.")] = False,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    after: After = None,
    jobs: Jobs = None,
    as_json: Json = False,
) -> ExitCode:
    """Explain how well a way of doing a task is seen: when, by which camera, and why not."""
    from sqrp_cli.cli.console import progress, say_raw
    from sqrp_cli.cli.documents import as_text, header
    from sqrp_cli.cli.rank import choose_candidate
    from sqrp_cli.cli.session import Session
    from sqrp_cli.programming.pipeline import assess_all
    from sqrp_cli.programming.ranking import rank

    sampling = read_sampling(samples, dt, tolerance)
    session = Session.begin(open_workspace(workspace), task, after, sampling)
    with progress(f"Assessing {task}", len(session.task.candidates)) as advance:
        assessments = []
        for assessment in assess_all(session.assignment, session.task.candidates, job_count(jobs)):
            assessments.append(assessment)
            advance()
    ranking = rank(assessments, "q_eoi")
    chosen = list(ranking) if all_candidates else [choose_candidate(ranking, choose)]
    documents = [_explain(session, ranked, as_json=as_json) for ranked in chosen]
    if as_json:
        fields = header(session.workspace, task)
        say_raw(as_text({**fields, "candidates": documents} if all_candidates else {**fields, **documents[0]}))
    return ExitCode.OK if any(ranked.rank is not None for ranked in chosen) else ExitCode.NONE_FEASIBLE


def _explain(session: Session, ranked: Ranked, *, as_json: bool) -> dict[str, Any]:
    """Compute a candidate again with every camera's verdicts; print it, or give its document."""
    from dataclasses import replace

    from sqrp_cli.cli.console import say
    from sqrp_cli.cli.documents import infeasible_document, study_document
    from sqrp_cli.cli.timeline_chart import print_study
    from sqrp_cli.programming.assessment import study
    from sqrp_cli.programming.infeasible import Infeasible
    from sqrp_cli.programming.verdict import verdict

    assignment = session.assignment
    candidate = ranked.assessment.candidate
    found = study(assignment.cell, candidate, assignment.world, assignment.sampling, full=True)
    if isinstance(found, Infeasible):
        if as_json:
            return infeasible_document(ranked)
        say(f"{candidate.name} is infeasible: {'; '.join(found.reasons)}")
        return {}
    detailed = replace(ranked, assessment=found.assessment(verdict(assignment.cell, found)))
    if as_json:
        return study_document(assignment.cell, found, detailed, assignment.sampling)
    print_study(assignment.cell, found, detailed)
    return {}
