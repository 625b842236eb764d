"""`sqrp score --vary`: variants of one workspace, and the best of them as a patch."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.checks.outside import intervals_outside
from sqrp_cli.cli.score_run import nothing_scored, why_not_scored
from sqrp_cli.errors import ExitCode, InputError, Place, Problem
from sqrp_cli.platform.files import check_writable, write_atomically
from sqrp_cli.report.documents.document import as_text
from sqrp_cli.report.documents.scores import VaryDocument
from sqrp_cli.scoring.discovery import find_workspaces, short_names
from sqrp_cli.scoring.score import wanted_of
from sqrp_cli.scoring.sweep import Sweep, from_here, read_variants, sweep
from sqrp_cli.scoring.variation import grid_shape, read_variation, variants
from sqrp_cli.scoring.work.compute import Means, open_computer
from sqrp_cli.terminal.console import note, print_problems, progress, say, say_line, say_raw
from sqrp_cli.terminal.sweep_table import print_sweep

MARK = "# The best variant that `sqrp score --vary` found"
"""How the patch begins; `patch` and `git apply` skip it. Only files that begin so are overwritten."""


@dataclass(frozen=True)
class SweepRequest:
    """What the command line asks for. variations: as `read_variation` reads them.

    patch: the file to write; None: NAME-best.patch in the current folder.
    """

    paths: Sequence[str]
    variations: tuple[str, ...]
    draws: int | None
    patch: Path | None


def run_sweep(request: SweepRequest, means: Means, *, as_json: bool) -> ExitCode:
    """Score the variants, print them and write the best as a patch."""
    variations = [read_variation(text) for text in request.variations]
    values = variants(variations, request.draws, means.seed)
    files = find_workspaces(request.paths)
    if len(files) > 1:
        names = ", ".join(f"`{name}`" for name in short_names(files).values())
        raise InputError(Problem("bad-option", f"--vary is about one workspace, found {names}"))
    name = short_names(files)[files[0]]
    patch = request.patch or Path(f"{name}-best.patch")
    _check_patch(patch)
    with progress("Reading variants", len(values) + 1) as advance:
        document, read = read_variants(files[0], values, advance)
    with open_computer(means) as computer:
        found = sweep(document, read, grid_shape(variations, request.draws), computer, progress)
        wanted = [want for variant in read for want in wanted_of(variant.cell)]
        assessments = [outcome.assessment for outcome in map(computer.outcome, wanted) if outcome is not None]
    print_problems(problem for problem in read[0].cell.problems if problem.severity == "warning")
    print_problems(intervals_outside(assessments))
    if found.interrupted:
        count = len(read)
        note(f"interrupted before all {count} variants were scored, so none is named the best and no patch is written")
        return ExitCode.INTERRUPTED
    each = [variant.findings for variant in found.variants]
    if nothing_scored(*each):
        raise InputError(*why_not_scored(*each))
    if found.patch:
        write_atomically(patch, f"{MARK}\n{found.patch}")
    if as_json:
        say_raw(as_text(VaryDocument.of(found, name, str(patch) if found.patch else None)))
    else:
        print_sweep(found)
        say()
        _conclude(found, patch)
    if found.best.findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if found.best.findings.passed else ExitCode.NONE_FEASIBLE


def _check_patch(path: Path) -> None:
    """Raises InputError for a file that cannot be written, or that is there and that no sweep has written."""
    check_writable(path)
    if path.is_file():
        with path.open("rb") as file:
            own = file.read(len(MARK)) == MARK.encode()
        if not own:
            message = "this file is there already and is no patch that --vary wrote; it was left as it is"
            raise InputError(Problem("would-overwrite", message, Place(path), mend="choose another name: --patch FILE"))


def _conclude(found: Sweep, patch: Path) -> None:
    if not found.patch:
        say("None is better than the workspace as it is.")
        return
    values = ", ".join(f"{path} = {value}" for path, value in found.best.variant.values)
    among = "" if found.equals == 1 else f" Of {found.equals} that are as good it has the most room around it."
    say(f"Best is {values}.{among} To have it:")
    say_line(f"  patch {shlex.quote(from_here(found.document.path))} < {shlex.quote(str(patch))}")
