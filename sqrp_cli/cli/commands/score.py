"""`sqrp score`: every task of many workspaces, with thresholds and a baseline."""

from __future__ import annotations

import typer

from sqrp_cli.cli import score_options as option
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
from sqrp_cli.cli.score_outputs import Outputs
from sqrp_cli.errors import ExitCode, InputError, Problem

NAME = "score"


def command(
    context: typer.Context,
    paths: option.Paths,
    baseline: option.Baseline = None,
    save_baseline: option.SaveBaseline = None,
    allow: option.Allow = option.DEFAULT_ALLOWANCE,
    junit: option.Junit = None,
    summary: option.Summary = None,
    report: Report = None,
    out: option.Out = None,
    resume: option.Resume = False,
    cluster: option.Cluster = None,
    vary: option.Vary = None,
    draws: option.Draws = None,
    patch: option.Patch = None,
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
    from sqrp_cli.scoring.work.dask_client import connected

    if resume and out is None:
        mend = "name the folder of the interrupted run: --out DIR --resume"
        raise InputError(Problem("bad-option", "--resume needs the folder with the results", mend=mend))
    if not vary and (draws is not None or patch is not None):
        given = "--draws" if draws is not None else "--patch"
        raise InputError(Problem("bad-option", f"{given} is about --vary, which is missing"))
    outputs = Outputs(junit, summary, save_baseline, report)
    if vary and (baseline is not None or outputs.paths):
        raise InputError(Problem("bad-option", "--vary goes without baselines and reports"))
    outputs.check()
    with connected(cluster, option.tell) as workers:
        from sqrp_cli.scoring.work.compute import Means

        means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), workers, out, seed)
        if vary:
            from sqrp_cli.cli.sweep_run import SweepRequest, run_sweep

            return run_sweep(SweepRequest(paths, tuple(vary), draws, patch), means, as_json=as_json)
        from sqrp_cli.cli.score_run import ScoreRequest, run_score

        return run_score(ScoreRequest(paths, baseline, allow, outputs), means, context.obj, as_json=as_json)
