"""`sqrp advise`: the least change of a motion or a cell that meets a wish."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.cell import advised
from sqrp_cli.ask.request import option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import Patches, answer, open_to_write, page_is_written
from sqrp_cli.cli.start import Start
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.search.advice_result import AdviceDocument

NAME = "advise"

PATCHES = Patches("# A change that `sqrp advise` found", "of `sqrp advise`")


class AdviseCommand(requests.AdviseRequest, requests.Paged, requests.Seeded, requests.Printed, requests.StartCommand):
    """Find the least change that lets the cameras see enough.

    The motion comes first, then what it handles, cameras last: their aim, position, lens, and another camera.
    """

    apply: int | None = option(
        "--apply",
        "Write the N-th change into the workspace; comments stay.",
        values.count(1),
        default=None,
        metavar="N",
    )
    patch: Path | None = option(
        "--patch",
        "Write the first change that has one, or that of --apply, as a patch instead.",
        PATH,
        default=None,
        metavar="FILE",
    )


def advise(context: Any, ask: AdviseCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Search, write what is to be written, and print."""
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    workspace, after = Start.of(ask.workspace, ask.after)
    cell = open_to_write(workspace, ask.seed, [after], report=ask.report, patch=ask.patch, patches=PATCHES)
    print_problems(cell_warnings(cell.cell))
    found = advised(cell, ask.but(after=after, progress=progress))
    interrupted = bool(found.interrupted)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.search_pages import write_advice

        interrupted = not page_is_written(ask.report, partial(write_advice, found), context.obj, ask.jobs)
    message = ""
    try:
        message = "" if interrupted else _write(found, cell.path, ask.apply, ask.patch)
    finally:  # the search took long, and says which change can be written
        answer(found, as_json=ask.json, written=bool(message))
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.found else ExitCode.NONE_FEASIBLE


def _write(found: AdviceDocument, path: Path, number: int | None, patch: Path | None) -> str:
    """Write a change as it was asked for, by default the first that has a patch; returns what was done.

    path: of the workspace, as it was given.
    """
    if (number is None and patch is None) or not found.found:
        return ""
    if found.met and number in (None, 1):
        return f"the wish is met already, so {path if patch is None else patch} is not written"
    chosen = next((n for n, one in enumerate(found.advice, 1) if one.patch), 1) if number is None else number
    if found.patched(chosen) == found.session.file.content:  # refuses a number that none has
        return f"change {chosen} is in {path} already; nothing was written"
    if patch is not None:
        PATCHES.write(patch, found.advice[chosen - 1].patch)
        return f"change {chosen} is in {patch}"
    found.apply(chosen)
    return f"change {chosen} is in {path} now"


command = command_of(AdviseCommand, advise)
