"""`sqrp place`: where cameras should go, with a proof."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.request import option
from sqrp_cli.ask.values import PATHS
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import Patches, answer, open_to_write, page_is_written
from sqrp_cli.errors import ExitCode, bad_option

NAME = "place"

PATCHES = Patches("# Cameras that `sqrp place` found", "of `sqrp place`")


class PlaceCommand(
    requests.PlaceRequest, requests.Paged, requests.Clustered, requests.Seeded, requests.Printed, requests.CellCommand
):
    """Find where cameras should go, and prove that no others do better.

    The mounts and lenses to choose from are in the file place.yaml beside the workspace.
    """

    patch: Sequence[Path] = option(
        "--patch", "Write a patch of the workspace with these cameras.", PATHS, default=(), metavar="FILE"
    )


def place(context: Any, ask: PlaceCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Search, write what is to be written, and print."""
    from sqrp_cli.ask.api.placing import find_placement
    from sqrp_cli.score.work.cluster import connected
    from sqrp_cli.score.work.compute import Means
    from sqrp_cli.show.terminal.console import note, progress
    from sqrp_cli.show.terminal.search_tables import Bounds
    from sqrp_cli.study.sampling import Adaptive

    patch = _only(ask.patch)
    cell = open_to_write(ask.workspace, ask.seed, [ask.mounts], report=ask.report, patch=patch, patches=PATCHES)
    with connected(ask.cluster, note, ask.tls) as workers:
        means = Means(ask.sampling or Adaptive(), ask.jobs, workers, ask.out, ask.seed)
        found = find_placement(cell.cell, ask, means=means, progress=progress, watch=Bounds())
    if patch is not None and found.patch:
        PATCHES.write(patch, found.patch)
        note(f"the patch is in {patch}")
    interrupted = bool(found.interrupted)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.search_pages import write_placement

        write = partial(write_placement, found)
        interrupted = not page_is_written(ask.report, write, context.obj, ask.jobs)
    answer(found, as_json=ask.json, written=patch is not None)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met else ExitCode.NONE_FEASIBLE


def _only(patches: Sequence[Path]) -> Path | None:
    """The file for the patch, if one is named. Raises InputError for several."""
    if len(patches) > 1:
        named = ", ".join(map(str, patches))
        raise bad_option(f"--patch is given {len(patches)} times: {named}", mend="name one file")
    return patches[0] if patches else None


command = command_of(PlaceCommand, place)
