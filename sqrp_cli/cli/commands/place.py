"""`sqrp place`: where cameras should go, with a proof."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli import completion
from sqrp_cli.cli.options import (
    Cluster,
    Jobs,
    Json,
    Out,
    Report,
    SampleCount,
    SampleStep,
    Seed,
    Tolerance,
    WorkspacePath,
    answer,
    check_patch,
    check_report,
    job_count,
    open_with_warnings,
    page_is_written,
    read_sampling,
    read_ways,
)
from sqrp_cli.errors import ExitCode, InputError, Problem
from sqrp_cli.platform.files import check_distinct, check_not_read, write_atomically

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.placing import CellPlacement

NAME = "place"

MARK = "# Cameras that `sqrp place` found"
"""How a patch begins; `patch` and `git apply` skip it. Only files that begin so are overwritten."""


def command(
    context: typer.Context,
    workspace: WorkspacePath,
    tasks: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TASK...",
            autocompletion=completion.tasks,
            help="Such as `pickup green`; by default all that the workspace lists.",
        ),
    ] = None,
    cameras: Annotated[
        int | None, typer.Option("--cameras", metavar="N", min=1, help="Most cameras on mounts.")
    ] = None,
    want: Annotated[
        str | None,
        typer.Option(
            "--want",
            metavar="WISH",
            help='As few cameras as possible with which every candidate has it, such as "q_eoi 100 %, delay 0.5 s".',
        ),
    ] = None,
    objective: Annotated[
        str, typer.Option("--objective", metavar="least|mean", help="Which quality of all candidates counts first.")
    ] = "least",
    survive: Annotated[
        int, typer.Option("--survive", metavar="N", min=0, max=1, help="1: any one camera may fail.")
    ] = 0,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep", metavar="CAMERA", autocompletion=completion.cameras, help="A camera of the workspace that stays."
        ),
    ] = None,
    budget: Annotated[
        float | None, typer.Option("--budget", metavar="PRICE", min=0.0, help="Most that the cameras may cost.")
    ] = None,
    ways: Annotated[
        str, typer.Option("--ways", metavar="best|fastest", help="fastest: ways are not chosen, too.")
    ] = "best",
    mounts: Annotated[
        Path | None,
        typer.Option("--mounts", metavar="FILE", help="Mounts and lenses; by default place.yaml beside the workspace."),
    ] = None,
    patches: Annotated[
        list[Path] | None,
        typer.Option("--patch", metavar="FILE", help="Write a patch of the workspace with these cameras."),
    ] = None,
    report: Report = None,
    out: Out = None,
    cluster: Cluster = None,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Find where cameras should go, and prove that no others do better.

    The mounts and lenses to choose from are in the file place.yaml beside the workspace.
    """
    from sqrp_cli.api.arguments import WAYS
    from sqrp_cli.api.placing import PlaceRequest, find_placement
    from sqrp_cli.scoring.work.cluster import connected
    from sqrp_cli.scoring.work.compute import Means
    from sqrp_cli.terminal.console import note, progress
    from sqrp_cli.terminal.place_table import Bounds

    sampling = read_sampling(samples, dt, tolerance)
    patch = _only(patches)
    check_distinct({"--patch": patch, "--report": report})
    if patch is not None:
        check_patch(patch, MARK, "of `sqrp place`")
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([patch, report], [mounts, *(file.path for file in cell.workspace.files.values())])
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
        write_atomically(patch, f"{MARK}\n{found.patch}")
        found = replace(found, written=True)
        note(f"the patch is in {patch}")
    interrupted = found.interrupted
    if report is not None and not interrupted:
        interrupted = not _page_is_written(found, report, context.obj, job_count(jobs))
    answer(found, as_json=as_json)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met else ExitCode.NONE_FEASIBLE


def _only(patches: Sequence[Path] | None) -> Path | None:
    """The file for the patch, if one is named. Raises InputError for several."""
    if patches is not None and len(patches) > 1:
        named = ", ".join(map(str, patches))
        raise InputError(Problem("bad-option", f"--patch is given {len(patches)} times: {named}", mend="name one file"))
    return patches[0] if patches else None


def _page_is_written(found: CellPlacement, file: Path, arguments: Sequence[str], jobs: int) -> bool:
    """Write the page about a placement; returns False if Ctrl-C came first."""
    from sqrp_cli.report.pages.place_page import write_placement
    from sqrp_cli.terminal.console import progress

    def write(path: Path) -> None:
        write_placement(found.found, found.document, path, arguments=arguments, jobs=jobs, progress=progress)

    return page_is_written(file, write)
