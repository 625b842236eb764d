"""`sqrp place`: where cameras should go, with a proof."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.api.arguments import WAYS
from sqrp_cli.cli import completion
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import answer, job_count, open_to_write, page_is_written, read_sampling, read_ways
from sqrp_cli.errors import ExitCode, bad_option

if TYPE_CHECKING:
    from collections.abc import Sequence

NAME = "place"

PATCHES = option.Patches("# Cameras that `sqrp place` found", "of `sqrp place`")

Tasks = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="TASK...",
        autocompletion=completion.tasks,
        help="Such as `pickup green`; by default all that the workspace lists.",
    ),
]
Most = Annotated[int | None, typer.Option("--cameras", metavar="N", min=1, help="Most cameras on mounts.")]
Want = Annotated[
    str | None,
    typer.Option(
        "--want",
        metavar="WISH",
        help='As few cameras as possible with which every candidate has it, such as "q_eoi 100 %, delay 0.5 s".',
    ),
]
Objective = Annotated[
    str, typer.Option("--objective", metavar="least|mean", help="Which quality of all candidates counts first.")
]
Survive = Annotated[int, typer.Option("--survive", metavar="N", min=0, max=1, help="1: any one camera may fail.")]
Keep = Annotated[
    list[str] | None,
    typer.Option(
        "--keep", metavar="CAMERA", autocompletion=completion.cameras, help="A camera of the workspace that stays."
    ),
]
Budget = Annotated[
    float | None, typer.Option("--budget", metavar="PRICE", min=0.0, help="Most that the cameras may cost.")
]
Ways = Annotated[
    str, typer.Option("--ways", metavar="best|fastest", help="fastest: ways stay as rank --ways fastest has them.")
]
Mounts = Annotated[
    Path | None,
    typer.Option("--mounts", metavar="FILE", help="Mounts and lenses; by default place.yaml beside the workspace."),
]
PatchFiles = Annotated[
    list[Path] | None,
    typer.Option("--patch", metavar="FILE", help="Write a patch of the workspace with these cameras."),
]


def command(
    context: typer.Context,
    workspace: option.WorkspacePath,
    tasks: Tasks = None,
    cameras: Most = None,
    want: Want = None,
    objective: Objective = "least",
    survive: Survive = 0,
    keep: Keep = None,
    budget: Budget = None,
    ways: Ways = "best",
    mounts: Mounts = None,
    patches: PatchFiles = None,
    report: option.Report = None,
    out: option.Out = None,
    cluster: option.Cluster = None,
    samples: option.SampleCount = None,
    dt: option.SampleStep = None,
    tolerance: option.Tolerance = None,
    jobs: option.Jobs = None,
    seed: option.Seed = 0,
    as_json: option.Json = False,
) -> ExitCode:
    """Find where cameras should go, and prove that no others do better.

    The mounts and lenses to choose from are in the file place.yaml beside the workspace.
    """
    from sqrp_cli.api.placing import PlaceRequest, find_placement
    from sqrp_cli.scoring.work.cluster import connected
    from sqrp_cli.scoring.work.compute import Means
    from sqrp_cli.terminal.console import note, progress
    from sqrp_cli.terminal.search_tables import Bounds

    sampling = read_sampling(samples, dt, tolerance)
    patch = _only(patches)
    cell = open_to_write(workspace, seed, [mounts], report=report, patch=patch, patches=PATCHES)
    request = PlaceRequest(
        tasks=tasks or (),
        cameras=cameras,
        want=want,
        objective=objective,
        survive=survive,
        keep=keep or (),
        budget=budget,
        ways=read_ways(ways, WAYS).wanted,
        mounts=mounts,
    )
    with connected(cluster, note) as workers:
        means = Means(sampling, job_count(jobs), workers, out, seed)
        found = find_placement(cell.cell, request, means=means, progress=progress, watch=Bounds())
    if patch is not None and found.patch:
        PATCHES.write(patch, found.patch)
        found = replace(found, written=True)
        note(f"the patch is in {patch}")
    interrupted = found.interrupted
    if report is not None and not interrupted:
        from sqrp_cli.report.pages.search_pages import write_placement

        write = partial(write_placement, found.found, found.document)
        interrupted = not page_is_written(report, write, context.obj, job_count(jobs))
    answer(found, as_json=as_json)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met else ExitCode.NONE_FEASIBLE


def _only(patches: Sequence[Path] | None) -> Path | None:
    """The file for the patch, if one is named. Raises InputError for several."""
    if patches is not None and len(patches) > 1:
        named = ", ".join(map(str, patches))
        raise bad_option(f"--patch is given {len(patches)} times: {named}", mend="name one file")
    return patches[0] if patches else None
