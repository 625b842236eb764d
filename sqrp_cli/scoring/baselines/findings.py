"""The whole of a scoring run: scores, what they are compared with, and what is wrong, in one record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

from sqrp_cli.programming.coverage.blind_spans import Coverage
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.scoring.baselines.baseline import Baseline, TaskRecord, vanished
from sqrp_cli.scoring.baselines.changes import Change, workspace_changes
from sqrp_cli.scoring.baselines.comparison import Comparison, changed_ways, compare
from sqrp_cli.scoring.cells import ScoredCell
from sqrp_cli.scoring.score import TaskScore, score, scores_of
from sqrp_cli.scoring.work.compute import Computer, Wanted

Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Shows how far something has come: its title and its number of parts; the result counts those that are done."""

CHANGES_SHOWN = 4
"""Changes of a workspace that a sentence lists."""


@dataclass(frozen=True, eq=False)
class Result:
    """The score of a task and how it compares with the baseline; None where there is none."""

    score: TaskScore
    comparison: Comparison | None


@dataclass(frozen=True, eq=False)
class Findings:
    """What a run found.

    changes: by workspace, since the baseline. vanished: workspace and text of tasks that only the baseline has.
    unfinished: how many results are missing because the run was interrupted.
    """

    results: tuple[Result, ...]
    changes: Mapping[str, tuple[Change, ...]] = field(default_factory=dict)
    vanished: tuple[tuple[str, str], ...] = ()
    interrupted: bool = False
    unfinished: int = 0

    def count(self, status: str) -> int:
        """How many results have a status."""
        return sum(result.score.status == status for result in self.results)

    @property
    def passed(self) -> bool:
        """Whether nothing failed and nothing is wrong."""
        return not self.interrupted and all(result.score.status == "passed" for result in self.results)


def score_cells(cells: Sequence[ScoredCell], computer: Computer, progress: Progress) -> Findings:
    """Score every task; at Ctrl-C those that are finished. Raises InputError where results cannot be kept."""
    total = sum(len(task.task.candidates) for cell in cells for task in cell.tasks if task.task is not None)
    try:
        with progress("Scoring", total) as advance:
            scores = score(cells, computer, advance)
    except KeyboardInterrupt:
        finished = tuple(Result(result, None) for cell in cells for result in scores_of(cell, computer))
        asked = sum(1 if cell.workspace is None else len(cell.tasks) for cell in cells)
        return Findings(finished, interrupted=True, unfinished=asked - len(finished))
    return Findings(tuple(Result(result, None) for result in scores))


class CoverageLookup:
    """The coverage of ways over time, computed before it is asked for."""

    def __init__(self, cells: Sequence[ScoredCell], computer: Computer) -> None:
        self._workspaces = {cell.name: cell.workspace for cell in cells if cell.workspace is not None}
        self._computer = computer

    def prepare(self, ways: Sequence[tuple[TaskScore, Ranked]], progress: Progress) -> None:
        """Compute the coverage of feasible ways. Raises InputError where results cannot be kept."""
        wanted = [self._wanted(result, way) for result, way in ways if way.rank is not None]
        if wanted:
            with progress("Looking up causes", len(wanted)) as advance:
                self._computer.compute(wanted, advance, coverage=True)

    def __call__(self, result: TaskScore, way: Ranked) -> Coverage | None:
        """The coverage of a way of doing a task; None where it is infeasible or was not prepared."""
        outcome = self._computer.outcome(self._wanted(result, way), coverage=True)
        return None if outcome is None else outcome.coverage

    def _wanted(self, result: TaskScore, way: Ranked) -> Wanted:
        return Wanted(self._workspaces[result.workspace], result.content, way.assessment.candidate)


def compare_with(
    findings: Findings,
    cells: Sequence[ScoredCell],
    baseline: Baseline,
    allowance: float,
    lookup: CoverageLookup,
    progress: Progress,
) -> Findings:
    """The findings with every task compared with its baseline; a task that got worse has failed.

    allowance: see `compare`. Raises InputError where results cannot be kept.
    """
    records = {
        (workspace, task): record
        for workspace, found in baseline.workspaces.items()
        for task, record in found.tasks.items()
    }
    changes = {
        cell.name: workspace_changes(baseline.workspaces[cell.name], baseline.fields, cell.workspace)
        for cell in cells
        if cell.workspace is not None and cell.name in baseline.workspaces
    }
    scores = [result.score for result in findings.results]
    pairs = [(one, records.get((one.workspace, one.task or ""))) for one in scores]
    lookup.prepare(
        [
            (one, one.ways[change.way])
            for one, record in pairs
            if record is not None
            for change in changed_ways(record, one, allowance)
            if change.worse
        ],
        progress,
    )
    results = [_compared(one, record, allowance, lookup, changes.get(one.workspace, ())) for one, record in pairs]
    names = {cell.name: [task.text for task in cell.tasks] for cell in cells if cell.workspace is not None}
    unreadable = {cell.name for cell in cells if cell.workspace is None}
    gone = tuple((workspace, task) for workspace, task in vanished(baseline, names) if workspace not in unreadable)
    return replace(findings, results=tuple(results), changes=changes, vanished=gone)


def _compared(
    result: TaskScore,
    record: TaskRecord | None,
    allowance: float,
    lookup: CoverageLookup,
    changes: Sequence[Change],
) -> Result:
    if result.status == "error":
        return Result(result, None)
    comparison = compare(record, result, allowance, lookup)
    worse = [change for change in comparison.ways if change.worse]
    if not worse:
        return Result(result, comparison)
    since = f"; since the baseline {listed(changes)}" if changes else ""
    reasons = tuple(f"{result.task} got worse for {change}{since}" for change in worse)
    return Result(replace(result, status="failed", reasons=(*result.reasons, *reasons)), comparison)


def listed(changes: Sequence[Change]) -> str:
    """The first few changes, and how many more there are."""
    shown = ", ".join(str(change) for change in changes[:CHANGES_SHOWN])
    more = len(changes) - CHANGES_SHOWN
    return shown + (f" and {more} more" if more > 0 else "")
