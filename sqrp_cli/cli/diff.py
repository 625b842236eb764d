"""`sqrp diff`: two versions of a workspace, what differs and what that does to its tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Jobs, Json, SampleCount, SampleStep, Seed, Tolerance, job_count, read_sampling
from sqrp_cli.cli.score import DEFAULT_ALLOWANCE, Allow, Cluster, Out
from sqrp_cli.errors import ExitCode

NAME = "diff"


def command(
    before: Annotated[Path, typer.Argument(metavar="A", help="A workspace as it was.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="The workspace as it is now.")],
    allow: Allow = DEFAULT_ALLOWANCE,
    out: Out = None,
    cluster: Cluster = None,
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
    from sqrp_cli.cli.console import progress, say_raw
    from sqrp_cli.cli.documents import as_text
    from sqrp_cli.cli.score_document import score_document
    from sqrp_cli.cli.score_table import print_difference
    from sqrp_cli.scoring.compute import Means, open_computer
    from sqrp_cli.scoring.difference import difference, read_versions

    means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), cluster, out, seed)
    old, new = read_versions(before, after)
    with open_computer(means) as computer:
        findings = difference(old, new, computer, allow, progress)
    if as_json:
        say_raw(as_text(score_document(findings)))
    else:
        print_difference(findings)
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE
