"""What `sqrp score` and `sqrp diff` have in common: workspaces read, workers hired, files written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.cli.console import note, print_problems, progress
from sqrp_cli.files import check_not_read, check_writable
from sqrp_cli.scoring.baseline import baseline_of, load_baseline, save_baseline
from sqrp_cli.scoring.cells import ScoredCell, read_cells
from sqrp_cli.scoring.compute import Computer, Means, open_computer
from sqrp_cli.scoring.discovery import find_workspaces
from sqrp_cli.scoring.findings import CoverageLookup, Findings, compare_with, score_cells
from sqrp_cli.scoring.junit import write_junit
from sqrp_cli.scoring.score import wanted_of
from sqrp_cli.scoring.summary import write_summary


@dataclass(frozen=True)
class Outputs:
    """Files to write."""

    junit: Path | None
    summary: Path | None
    baseline: Path | None
    report: Path | None = None

    def check(self) -> None:
        """Raises InputError before anything is computed where one of them cannot be written."""
        for path in (self.junit, self.summary, self.baseline):
            if path is not None:
                check_writable(path)

    def check_not_read(self, inputs: Iterable[Path]) -> None:
        """Raises InputError where one of them is a file that is read."""
        check_not_read((self.junit, self.summary, self.baseline, self.report), inputs)


@dataclass(frozen=True, eq=False)
class ScoreRun:
    """Workspaces, and what computes their candidates."""

    cells: tuple[ScoredCell, ...]
    computer: Computer

    @classmethod
    @contextmanager
    def open(cls, paths: Sequence[str], outputs: Outputs, means: Means) -> Iterator[ScoreRun]:
        """Hire workers and read the workspaces; workers begin with those that are read.

        Raises InputError for paths, clusters and folders of no use, and where an output is a file of a workspace.
        """
        files = find_workspaces(paths)
        outputs.check_not_read(files)
        cells: list[ScoredCell] = []
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for cell in read_cells(files):
                    outputs.check_not_read(_files(cell))
                    computer.begin(wanted_of(cell))
                    cells.append(cell)
                    advance()
            for cell in cells:
                print_problems(problem for problem in cell.problems if problem.severity == "warning")
                if cell.workspace is not None and not cell.tasks:
                    note(f"{cell.name} lists no tasks")
            yield cls(tuple(cells), computer)

    def findings(self, baseline: Path | None, allowance: float) -> Findings:
        """Score all and compare with a baseline if there is one."""
        known = None if baseline is None else load_baseline(baseline, self.computer.sampling)
        findings = score_cells(self.cells, self.computer, progress)
        candidates = sum(len(task.task.candidates) for cell in self.cells for task in cell.tasks if task.task)
        known_before = ", the others were known" if self.computer.computed < candidates else ""
        rest = ", then interrupted" if findings.interrupted else known_before
        note(f"{self.computer.computed} of {candidates} candidates were computed{rest}")
        if findings.interrupted or known is None:
            return findings
        return compare_with(findings, self.cells, known, allowance, self._lookup, progress)

    def write(self, findings: Findings, outputs: Outputs) -> None:
        """Write the files that were asked for."""
        if outputs.junit is not None:
            write_junit(findings, outputs.junit)
        if outputs.summary is not None:
            write_summary(findings, outputs.summary)
        if outputs.baseline is not None:
            scores = [result.score for result in findings.results]
            self._lookup.prepare([(score, way) for score in scores for way in score.ways.values()], progress)
            save_baseline(baseline_of(self.cells, scores, self._lookup, self.computer.sampling), outputs.baseline)

    @property
    def _lookup(self) -> CoverageLookup:
        return CoverageLookup(self.cells, self.computer)


def _files(cell: ScoredCell) -> list[Path]:
    return [] if cell.workspace is None else [file.path for file in cell.workspace.files.values()]
