"""`sqrp diff`: what differs between two versions of a workspace, and the effect on its tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.api.results import Difference
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import job_count, note_late, read_sampling
from sqrp_cli.errors import ExitCode, InputError

NAME = "diff"


def command(
    before: Annotated[Path, typer.Argument(metavar="A", help="A workspace as it was.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="The workspace as it is now.")],
    allow: option.Allow = option.DEFAULT_ALLOWANCE,
    out: option.Out = None,
    cluster: option.Cluster = None,
    seed: option.Seed = 0,
    samples: option.SampleCount = None,
    dt: option.SampleStep = None,
    tolerance: option.Tolerance = None,
    jobs: option.Jobs = None,
    as_json: option.Json = False,
) -> ExitCode:
    """Compare two versions of a workspace.

    Show what differs, field by field, and which camera therefore no longer sees which literal, and when.
    """
    from sqrp_cli.scoring.work.cluster import connected

    with connected(cluster, note_late) as workers:
        from sqrp_cli.api.scores import why_not_scored
        from sqrp_cli.cli.commands.score import show
        from sqrp_cli.scoring.scorecard import Scorecard, difference, read_versions
        from sqrp_cli.scoring.work.compute import Means, open_computer
        from sqrp_cli.terminal.console import progress

        means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), workers, out, seed)
        old, new = read_versions(before, after)
        if not as_json and old.content == new.content:  # nothing can differ, not even what is computed
            return show(Difference(Scorecard(())), as_json=as_json)
        with open_computer(means) as computer:
            findings = difference(old, new, computer, allow, progress)
        if findings.count("error"):
            raise InputError(*why_not_scored(findings))
        return show(Difference(findings), as_json=as_json)
