"""`sqrp diff`: two versions of a workspace, what differs and what that does to its tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli import score_options as option
from sqrp_cli.cli.options import Jobs, Json, SampleCount, SampleStep, Seed, Tolerance, job_count, read_sampling
from sqrp_cli.errors import ExitCode, InputError

NAME = "diff"


def command(
    before: Annotated[Path, typer.Argument(metavar="A", help="A workspace as it was.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="The workspace as it is now.")],
    allow: option.Allow = option.DEFAULT_ALLOWANCE,
    out: option.Out = None,
    cluster: option.Cluster = None,
    seed: Seed = 0,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    jobs: Jobs = None,
    as_json: Json = False,
) -> ExitCode:
    """Compare two versions of a workspace.

    Say what differs, field by field, and which literal is no longer seen by which camera, and when, because of it.
    """
    from sqrp_cli.scoring.work.dask_client import connected

    with connected(cluster, option.tell) as workers:
        from sqrp_cli.cli.score_run import show, why_not_scored
        from sqrp_cli.scoring.baselines.difference import difference, read_versions
        from sqrp_cli.scoring.work.compute import Means, open_computer
        from sqrp_cli.terminal.console import progress
        from sqrp_cli.terminal.score_table import print_difference

        means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), workers, out, seed)
        old, new = read_versions(before, after)
        with open_computer(means) as computer:
            findings = difference(old, new, computer, allow, progress)
        if findings.count("error"):
            raise InputError(*why_not_scored(findings))
        return show(findings, print_difference, as_json=as_json)
