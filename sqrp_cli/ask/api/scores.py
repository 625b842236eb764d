"""Scoring many workspaces: read them, compute, compare with a baseline, and write files for a CI server."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.checks.formulas import intervals_outside
from sqrp_cli.errors import Problem
from sqrp_cli.platform.files import check_not_read
from sqrp_cli.platform.memory import keep_all_so_far
from sqrp_cli.platform.processes import Progress
from sqrp_cli.records import dataclass
from sqrp_cli.score.compute import Computer, Means, open_computer
from sqrp_cli.score.result import Scorecard
from sqrp_cli.score.score import ScoredCell, find_workspaces, read_cells, score_cells

if TYPE_CHECKING:
    from sqrp_cli.score.baseline import Baseline


@dataclass(frozen=True, eq=False)
class ScoreRun:
    """Workspaces, and what computes their candidates. `progress` shows the progress of each part."""

    cells: tuple[ScoredCell, ...]
    computer: Computer
    progress: Progress

    @classmethod
    @contextmanager
    def open(
        cls, paths: Sequence[str], outputs: Sequence[Path], means: Means, progress: Progress
    ) -> Iterator[ScoreRun]:
        """Read the workspaces.

        Raises InputError for unusable paths and folders, and if an output is a file of a workspace.
        """
        files = find_workspaces(paths)
        check_not_read(outputs, files)
        cells: list[ScoredCell] = []
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for cell in read_cells(files):
                    check_not_read(outputs, _files(cell))
                    cells.append(cell)
                    advance(1)
            keep_all_so_far()
            yield cls(tuple(cells), computer, progress)

    def score(self) -> Scorecard:
        """Score all, at Ctrl-C only the finished ones. Raises InputError if results cannot be kept."""
        return score_cells(self.cells, self.computer, self.progress)

    @property
    def doubts(self) -> Iterator[Problem]:
        """Warnings about formulas with intervals outside the motion; valid after `score`."""
        for cell in self.cells:
            outcomes = filter(None, map(self.computer.outcome, cell.wanted))
            yield from intervals_outside(outcome.assessment for outcome in outcomes)

    def count(self, *, interrupted: bool) -> str:
        """How many candidates were computed, failed, or were known."""
        total = sum(len(cell.wanted) for cell in self.cells)
        computed, failed = self.computer.computed, self.computer.failed
        parts = [f"{computed} of {total} candidates were computed"]
        parts += [f"{failed} could not be"] if failed else []
        parts += ["the others were known"] if not interrupted and computed + failed < total else []
        return ", ".join(parts) + (", then interrupted" if interrupted else "")

    def compare(self, findings: Scorecard, baseline: Baseline, allowance: float, *, may_vanish: bool) -> Scorecard:
        """The findings compared with a baseline, see `compare_with`; at Ctrl-C without."""
        from sqrp_cli.score.comparison import compare_with

        about = (self.cells, self.computer, self.progress)
        try:
            return compare_with(baseline, findings, *about, allowance=allowance, may_vanish=may_vanish)
        except KeyboardInterrupt:
            return replace(findings, interrupted=True, unfinished=0)

    def write(self, findings: Scorecard, *, junit: Path | None, summary: Path | None, baseline: Path | None) -> None:
        """Write the requested files. Raises InputError for one that cannot be written."""
        from sqrp_cli.score.ci_files import write_junit, write_summary

        if junit is not None:
            write_junit(findings, junit)
        if summary is not None:
            write_summary(findings, summary)
        if baseline is not None:
            from sqrp_cli.score.baseline import Baseline
            from sqrp_cli.score.comparison import look_up

            scores = findings.results
            look_up(((score, way) for score in scores for way in score.ways.values()), self.computer, self.progress)
            Baseline.of(self.cells, scores, self.computer).save(baseline)


def nothing_scored(*found: Scorecard) -> bool:
    """Whether every task or workspace is an error, so that there is nothing to print."""
    statuses = {result.status for findings in found for result in findings.results}
    return statuses == {"error"} and not any(findings.interrupted for findings in found)


def why_not_scored(*found: Scorecard) -> list[Problem]:
    """The reasons for tasks that could not be scored, each once."""
    scores = (one for findings in found for one in findings.results if one.status == "error")
    return [Problem("not-scored", why) for why in dict.fromkeys(reason for one in scores for reason in one.reasons)]


def _files(cell: ScoredCell) -> list[Path]:
    return [] if cell.workspace is None else [file.path for file in cell.workspace.files.values()]
