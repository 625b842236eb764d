"""`sqrp advise`: the least change of a motion or a cell that meets a wish."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.api.arguments import WAYS
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import answer, job_count, open_to_write, page_is_written, read_sampling, read_ways
from sqrp_cli.cli.start import Start
from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.api.advice import TaskAdvice

NAME = "advise"

PATCHES = option.Patches("# A change that `sqrp advise` found", "of `sqrp advise`")

Want = Annotated[
    str | None,
    typer.Option(
        "--want",
        metavar="WISH",
        help='Such as "q_eoi 100 %, time 20 s"; by default the thresholds of the task in the workspace.',
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
    str, typer.Option("--ways", metavar="best|fastest", help="fastest: the motion stays as rank --ways fastest has it.")
]
Apply = Annotated[
    int | None,
    typer.Option("--apply", metavar="N", min=1, help="Write the N-th change into the workspace; comments stay."),
]
Patch = Annotated[
    Path | None,
    typer.Option(
        "--patch", metavar="FILE", help="Write the first change that has one, or that of --apply, as a patch instead."
    ),
]


def command(
    context: typer.Context,
    workspace: option.StartPath,
    task: option.TaskText,
    want: Want = None,
    choose: option.Choose = None,
    kinds: Kinds = None,
    ways: Ways = "best",
    apply: Apply = None,
    patch: Patch = None,
    report: option.Report = None,
    out: option.Out = None,
    samples: option.SampleCount = None,
    dt: option.SampleStep = None,
    tolerance: option.Tolerance = None,
    after: option.After = None,
    jobs: option.Jobs = None,
    seed: option.Seed = 0,
    as_json: option.Json = False,
) -> ExitCode:
    """Find the least change that lets the cameras see enough.

    The motion comes first, then what it handles, cameras last: their aim, position, lens, and another camera.
    """
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.terminal.console import note, print_problems, progress

    workspace, after = Start.of(workspace, after)
    sampling, wanted = read_sampling(samples, dt, tolerance), read_ways(ways, WAYS).wanted
    cell = open_to_write(workspace, seed, [after], report=report, patch=patch, patches=PATCHES)
    print_problems(cell_warnings(cell.cell))
    found = cell.advise(
        task,
        want=want,
        choose="best" if choose is None else choose,
        kinds=None if kinds is None else [kind.strip() for kind in kinds.split(",")],
        ways=wanted,
        sampling=sampling,
        after=after,
        out=out,
        jobs=job_count(jobs),
        progress=progress,
    )
    interrupted = found.interrupted
    if report is not None and not interrupted:
        from sqrp_cli.report.pages.search_pages import write_advice

        write = partial(write_advice, found.shown)
        interrupted = not page_is_written(report, write, context.obj, job_count(jobs))
    message = ""
    try:
        message = "" if interrupted else _write(found, apply, patch)
    finally:  # the search took long, and says which change can be written
        if as_json or not message:
            answer(found, as_json=as_json)
        else:
            found.show(written=True)
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.found else ExitCode.NONE_FEASIBLE


def _write(found: TaskAdvice, number: int | None, patch: Path | None) -> str:
    """Write a change as it was asked for; returns what was done."""
    if not found.advice or (number is None and patch is None):
        return ""
    chosen = found.first_with_patch if number is None else number
    if found.is_there(chosen):  # refuses a number that none has
        return f"change {chosen} is in {found.path} already; nothing was written"
    if patch is not None:
        PATCHES.write(patch, found.document.advice[chosen - 1].patch)
        return f"change {chosen} is in {patch}"
    found.apply(chosen)
    return f"change {chosen} is in {found.path} now"
