"""`sqrp advise`: the least change of a motion or a cell that meets a wish."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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
    read_sampling,
)
from sqrp_cli.errors import ExitCode, InputError, Problem, expected_names
from sqrp_cli.platform.files import check_distinct, check_not_read, write_atomically

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.advice import TaskAdvice
    from sqrp_cli.api.arguments import WaysOption

NAME = "advise"

MARK = "# A change that `sqrp advise` found"
"""How a patch begins; `patch` and `git apply` skip it. Only files that begin so are overwritten."""


def command(
    context: typer.Context,
    workspace: WorkspacePath,
    task: TaskText,
    want: Annotated[
        str | None,
        typer.Option(
            "--want",
            metavar="WISH",
            help='Such as "q_eoi 100 %, time 20 s"; by default the thresholds of the task in the workspace.',
        ),
    ] = None,
    choose: Annotated[
        str,
        typer.Option("--choose", metavar="best|NAME", help="Which candidate; the first-ranked by default."),
    ] = "best",
    kinds: Annotated[
        str | None,
        typer.Option(
            "--kinds",
            metavar="KIND,...",
            help="What may change, all of it: way, path, object, aim, position, lens, camera.",
        ),
    ] = None,
    ways: Annotated[
        str,
        typer.Option("--ways", metavar="best|fastest", help="fastest: the motion stays the fastest one as it is."),
    ] = "best",
    apply: Annotated[
        int | None,
        typer.Option("--apply", metavar="N", min=1, help="Write the N-th change into the workspace; comments stay."),
    ] = None,
    patch: Annotated[
        Path | None,
        typer.Option("--patch", metavar="FILE", help="Write the first change, or that of --apply, as a patch instead."),
    ] = None,
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
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.terminal.console import note, print_problems, progress

    sampling = read_sampling(samples, dt, tolerance)
    check_distinct({"--patch": patch, "--report": report})
    if patch is not None:
        check_patch(patch, MARK, "of `sqrp advise`")
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([patch, report], [after, *(file.path for file in cell.workspace.files.values())])
    print_problems(cell_warnings(cell.cell))
    found = cell.advise(
        task,
        want=want,
        choose=choose,
        kinds=None if kinds is None else [kind.strip() for kind in kinds.split(",")],
        ways=_ways(ways),
        sampling=sampling,
        after=after,
        out=out,
        jobs=job_count(jobs),
        progress=progress,
    )
    interrupted = found.interrupted
    if report is not None and not interrupted:
        interrupted = not _page_is_written(found, report, context.obj, job_count(jobs))
    try:
        message = "" if interrupted else _write(found, apply, patch)
    except InputError:
        answer(found, as_json=as_json)  # the search took long, and says which change can be written
        raise
    answer(found, as_json=as_json)
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.found else ExitCode.NONE_FEASIBLE


def _ways(text: str) -> WaysOption:
    """The value of `--ways`. Raises InputError for another one."""
    from sqrp_cli.api.arguments import WAYS

    for ways in WAYS:
        if ways == text:
            return ways
    raise InputError(Problem("bad-option", f"--ways is `{text}`; {expected_names(text, WAYS)}"))


def _page_is_written(found: TaskAdvice, file: Path, arguments: Sequence[str], jobs: int) -> bool:
    """Write the page about an advice; returns False if Ctrl-C came first."""
    from sqrp_cli.report.pages.advice_page import write_advice
    from sqrp_cli.terminal.console import note, progress

    try:
        write_advice(found.shown, file, arguments=arguments, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        note(f"interrupted before {file} was written")
        return False
    note(f"open {file} in a browser")
    return True


def _write(found: TaskAdvice, number: int | None, patch: Path | None) -> str:
    """Write a change as it was asked for; returns what was done."""
    if not found.advice or (number is None and patch is None):
        return ""
    if found.is_there(number or 1):  # refuses a number that none has
        return f"change {number or 1} is in {found.path} already; nothing was written"
    if patch is not None:
        write_atomically(patch, f"{MARK}\n{found.document.advice[(number or 1) - 1].patch}")
        return f"change {number or 1} is in {patch}"
    found.apply(number or 1)
    return f"change {number} is in {found.path} now"
