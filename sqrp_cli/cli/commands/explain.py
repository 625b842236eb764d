"""`sqrp explain`: the coverage of a candidate over time, with the cause of every blind stretch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import (
    After,
    Images,
    Jobs,
    Json,
    MaxTime,
    SampleCount,
    SampleStep,
    Seed,
    TaskText,
    Tolerance,
    WorkspacePath,
    check_max_time,
    job_count,
    open_with_warnings,
    read_sampling,
)
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.coverage.assessment import Study

NAME = "explain"


def command(
    workspace: WorkspacePath,
    task: TaskText,
    choose: Annotated[
        str | None,
        typer.Option("--choose", metavar="best|NAME", help="Which candidate to explain; the first-ranked by default."),
    ] = None,
    all_candidates: Annotated[bool, typer.Option("--all", help="Compare all candidates side by side.")] = False,
    ways: Annotated[
        bool, typer.Option("--ways", help="Show the other Pareto-optimal ways of the candidate, too.")
    ] = False,
    max_time: MaxTime = None,
    samples: SampleCount = None,
    dt: SampleStep = None,
    tolerance: Tolerance = None,
    after: After = None,
    images: Images = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Explain how well the cameras see a way of doing a task.

    Shows when each camera sees each literal, and what is in the way when it does not.
    """
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.terminal.console import print_problems, progress, say_raw
    from sqrp_cli.terminal.ways_table import print_ways

    if all_candidates and choose is not None:
        raise InputError(Problem("bad-option", "--all and --choose exclude each other; give one of them"))
    if images is not None:
        from sqrp_cli.report.pictures.pictures import check_pictures

        check_pictures(images)
    sampling = read_sampling(samples, dt, tolerance)
    check_max_time(max_time)
    cell = open_with_warnings(workspace, seed)
    choice = None if all_candidates else "best" if choose is None else choose
    explanation = cell.explain(
        task, choice, sampling=sampling, after=after, max_time=max_time, jobs=job_count(jobs), progress=progress
    )
    print_problems((*cell_warnings(cell.cell), *intervals_outside(one.assessment for one in explanation.ranking)))
    if as_json:
        say_raw(explanation.to_json())
    else:
        explanation.show()
        if ways:
            print_ways([one.ranked.assessment for one in explanation.explained])
    studies = [found for _, found in explanation.explained if found is not None]
    if images is not None:
        _write_images(cell.cell, studies, images, several=all_candidates)
    return ExitCode.OK if studies else ExitCode.NONE_FEASIBLE


def _write_images(cell: Cell, studies: Sequence[Study], images: Path, *, several: bool) -> None:
    """Take pictures of every blind interval, in a folder per candidate if there may be several."""
    from sqrp_cli.report.pictures.pictures import SHEET, folder_of, write_pictures
    from sqrp_cli.terminal.console import note, progress

    with progress("Taking pictures", len(studies)) as advance:
        for study in studies:
            folder = folder_of(study, images) if several else images
            blind = write_pictures(cell, study, folder)
            counted = f"{blind} blind interval{'s' if blind > 1 else ''}, see {folder / SHEET}"
            note(f"{study.candidate.name}: {counted if blind else 'never blind, so there are no pictures'}")
            advance()
