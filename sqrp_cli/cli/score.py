"""`sqrp score`: every task of many workspaces, with thresholds and a baseline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import (
    Jobs,
    Json,
    Report,
    SampleCount,
    SampleStep,
    Seed,
    Tolerance,
    job_count,
    read_sampling,
)
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from sqrp_cli.scoring.findings import Findings

NAME = "score"

DEFAULT_ALLOWANCE = 0.5
"""What may get worse without being a regression: points of Q, percent of times."""

Paths = Annotated[
    list[str],
    typer.Argument(metavar="PATH...", help="Workspaces, folders of workspaces, or patterns such as 'cells/*'."),
]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Keep results here as they finish; those there are used.")
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster", metavar="ADDRESS", help="Compute on this Dask cluster: tcp://HOST:PORT or scheduler file."
    ),
]
Allow = Annotated[
    float,
    typer.Option("--allow", metavar="POINTS", min=0.0, help="What may get worse: points of Q, percent of times."),
]


def command(
    context: typer.Context,
    paths: Paths,
    baseline: Annotated[
        Path | None, typer.Option("--baseline", metavar="FILE", help="Fail where something is worse than in this file.")
    ] = None,
    save_baseline: Annotated[
        Path | None,
        typer.Option("--save-baseline", metavar="FILE", help="Write the scores, to compare later ones with."),
    ] = None,
    allow: Allow = DEFAULT_ALLOWANCE,
    junit: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Write a JUnit file for a CI server.")
    ] = None,
    summary: Annotated[Path | None, typer.Option("--summary", metavar="FILE", help="Write a Markdown summary.")] = None,
    report: Report = None,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted run; needs its --out.")] = False,
    cluster: Cluster = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="PATH=FROM:TO:N", help="Score variants of a workspace, and name the best."),
    ] = None,
    draws: Annotated[
        int | None, typer.Option("--draws", min=1, max=10_000, help="With --vary: so many at random, not a grid.")
    ] = None,
    patch: Annotated[
        Path | None, typer.Option("--patch", metavar="FILE", help="With --vary: where the best variant is written to.")
    ] = None,
    seed: Seed = 0,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    jobs: Jobs = None,
    as_json: Json = False,
) -> ExitCode:
    """Score all tasks of many workspaces.

    Each task's best candidate is held against the thresholds that its workspace states, and against a baseline.
    """
    from sqrp_cli.cli.score_run import Outputs, ScoreRun
    from sqrp_cli.cli.sweep_run import SweepRequest, run_sweep
    from sqrp_cli.scoring.compute import Means

    if resume and out is None:
        mend = "name the folder of the interrupted run: --out DIR --resume"
        raise InputError(Problem("bad-option", "--resume needs the folder with the results", mend=mend))
    means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), cluster, out, seed)
    if vary:
        if any((baseline, save_baseline, junit, summary, report)):
            raise InputError(Problem("bad-option", "--vary goes without baselines and reports"))
        request = SweepRequest(paths, tuple(vary), draws, patch)
        return run_sweep(request, means, as_json=as_json)
    if draws is not None or patch is not None:
        given = "--draws" if draws is not None else "--patch"
        raise InputError(Problem("bad-option", f"{given} is about --vary, which is missing"))
    outputs = Outputs(junit, summary, save_baseline, report)
    outputs.check()
    if report is not None:
        from sqrp_cli.cli.report_page import check_report

        check_report(report)
    with ScoreRun.open(paths, outputs, means) as run:
        findings = run.findings(baseline, allow)
        if not findings.interrupted:
            run.write(findings, outputs)
    if report is not None and findings.results and not findings.interrupted:
        from sqrp_cli.cli.report_page import write_scores

        write_scores(run.cells, findings, means.sampling, report, context.obj, job_count(jobs))
    return show(findings, as_json=as_json)


def show(findings: Findings, *, as_json: bool) -> ExitCode:
    """Print what was found; returns the exit code that it stands for."""
    from sqrp_cli.cli.console import say_raw
    from sqrp_cli.cli.documents import as_text
    from sqrp_cli.cli.score_document import score_document
    from sqrp_cli.cli.score_table import print_report

    if as_json:
        say_raw(as_text(score_document(findings)))
    else:
        print_report(findings)
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    if findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE
