"""`sqrp advise`: the least change of a motion or a cell that meets a wish."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli import completion
from sqrp_cli.cli.options import (
    After,
    Jobs,
    Json,
    Out,
    Report,
    SampleCount,
    SampleStep,
    Seed,
    TaskText,
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
from sqrp_cli.errors import ExitCode
from sqrp_cli.platform.files import check_distinct, check_not_read, write_atomically

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.advice import TaskAdvice
    from sqrp_cli.api.cell import OpenCell

NAME = "advise"

MARK = "# A change that `sqrp advise` found"
"""How a patch begins; `patch` and `git apply` skip it. Only files that begin so are overwritten."""


Want = Annotated[
    str | None,
    typer.Option(
        "--want",
        metavar="WISH",
        help='Such as "q_eoi 100 %, time 20 s"; by default the thresholds of the task in the workspace.',
    ),
]
Choice = Annotated[
    str,
    typer.Option(
        "--choose",
        metavar="best|N|NAME",
        autocompletion=completion.candidates,
        help="Which candidate; the first-ranked by default.",
    ),
]
Kinds = Annotated[
    str | None,
    typer.Option(
        "--kinds",
        metavar="KIND,...",
        help="What may change, all of it: way, path, object, aim, position, lens, camera.",
    ),
]
Ways = Annotated[
    str, typer.Option("--ways", metavar="best|fastest", help="fastest: the motion stays the fastest one as it is.")
]
Apply = Annotated[
    int | None,
    typer.Option("--apply", metavar="N", min=1, help="Write the N-th change into the workspace; comments stay."),
]
Patch = Annotated[
    Path | None,
    typer.Option(
        "--patch",
        metavar="FILE",
        help="Write the first change that has one, or that of --apply, as a patch instead.",
    ),
]


def command(
    context: typer.Context,
    workspace: WorkspacePath,
    task: TaskText,
    want: Want = None,
    choose: Choice = "best",
    kinds: Kinds = None,
    ways: Ways = "best",
    apply: Apply = None,
    patch: Patch = None,
    report: Report = None,
    out: Out = None,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    after: After = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Find the least change that lets the cameras see enough.

    The motion comes first, then what it handles, cameras last: their aim, position, lens, and another camera.
    """
    from sqrp_cli.api.arguments import WAYS
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.terminal.console import note, print_problems, progress

    sampling, wanted = read_sampling(samples, dt, tolerance), read_ways(ways, WAYS).wanted
    cell = _checked_files(workspace, seed, after, patch, report)
    print_problems(cell_warnings(cell.cell))
    found = cell.advise(
        task,
        want=want,
        choose=choose,
        kinds=None if kinds is None else [kind.strip() for kind in kinds.split(",")],
        ways=wanted,
        sampling=sampling,
        after=after,
        out=out,
        jobs=job_count(jobs),
        progress=progress,
    )
    interrupted = found.interrupted or not _page_is_written(found, report, context.obj, job_count(jobs))
    try:
        message = "" if interrupted else _write(found, apply, patch)
    finally:  # the search took long, and says which change can be written
        answer(found, as_json=as_json)
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.found else ExitCode.NONE_FEASIBLE


def _checked_files(workspace: Path, seed: int, after: Path | None, patch: Path | None, report: Path | None) -> OpenCell:
    """The cell. Raises InputError, before anything is computed, if files cannot be read or written."""
    check_distinct({"--patch": patch, "--report": report})
    if patch is not None:
        check_patch(patch, MARK, "of `sqrp advise`")
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([patch, report], [after, *(file.path for file in cell.workspace.files.values())])
    return cell


def _page_is_written(found: TaskAdvice, file: Path | None, arguments: Sequence[str], jobs: int) -> bool:
    """Write the page about an advice, if it is wanted; returns False if Ctrl-C came first."""
    if file is None:
        return True
    from sqrp_cli.report.pages.advice_page import write_advice
    from sqrp_cli.terminal.console import progress

    def write(path: Path) -> None:
        write_advice(found.shown, path, arguments=arguments, jobs=jobs, progress=progress)

    return page_is_written(file, write)


def _write(found: TaskAdvice, number: int | None, patch: Path | None) -> str:
    """Write a change as it was asked for; returns what was done."""
    if not found.advice or (number is None and patch is None):
        return ""
    chosen = found.first_with_patch if number is None else number
    if found.is_there(chosen):  # refuses a number that none has
        return f"change {chosen} is in {found.path} already; nothing was written"
    if patch is not None:
        write_atomically(patch, f"{MARK}\n{found.document.advice[chosen - 1].patch}")
        return f"change {chosen} is in {patch}"
    found.apply(chosen)
    return f"change {chosen} is in {found.path} now"
