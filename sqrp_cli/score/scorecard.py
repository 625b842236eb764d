"""A scoring run: the scores of all tasks, compared with a baseline or with another version of the workspace."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field, replace
from pathlib import Path
from typing import Literal, NamedTuple

from sqrp_cli.cell.workspace_file import workspace_file
from sqrp_cli.document import LEFT_OUT, Document, how_many
from sqrp_cli.errors import InputError
from sqrp_cli.records import dataclass
from sqrp_cli.score.baselines.baseline import Baseline, TaskRecord, VanishedTask, baseline_of, identified, vanished
from sqrp_cli.score.baselines.comparison import changed_ways, compare
from sqrp_cli.score.changes import Change, workspace_changes
from sqrp_cli.score.score import ScoredCell, TaskScore, read_cell, score, scores_of
from sqrp_cli.score.work.compute import Computer, Wanted
from sqrp_cli.study.blind_spans import Coverage
from sqrp_cli.study.result import CandidateResult

Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Shows progress: takes a title and the number of parts; the result counts those that are done."""

CHANGES_SHOWN = 4
"""Most changes of a workspace in a sentence."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scorecard(Document):
    """A scoring run: every task, what changed since a baseline or another version, and whether it passed.

    The same bytes wherever it is computed.
    """

    VIEW = "sqrp_cli.show.terminal.score_table:print_scorecard"

    document: Literal["score", "diff"] = "score"
    results: tuple[TaskScore, ...]
    """One for each task, and for each workspace that cannot be used."""
    changes: Mapping[str, tuple[Change, ...]] = field(default_factory=dict)
    """By workspace, since the baseline; those without any are left out."""
    vanished: tuple[VanishedTask, ...] = ()
    """Tasks that exist only in the baseline."""
    may_vanish: bool = True
    """Whether that is no failure."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """The baseline's name of each workspace that it knows by another one, by its name now."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before everything was scored."""
    unfinished: int | None = field(default=None, metadata=LEFT_OUT)
    """If so, how many results are missing."""
    passed: bool = False
    """Whether every task passed and none is missing; a vanished one is, unless that is allowed. Found by itself."""

    def __post_init__(self) -> None:
        complete = (self.may_vanish or not self.vanished) and not self.interrupted
        object.__setattr__(self, "passed", complete and all(one.status == "passed" for one in self.results))

    def count(self, status: str) -> int:
        """How many results have a status."""
        return sum(one.status == status for one in self.results)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.count('passed')} of {how_many(self.results, 'task')} passed{cut}"


def score_cells(cells: Sequence[ScoredCell], computer: Computer, progress: Progress) -> Scorecard:
    """Score every task; at Ctrl-C those that are finished. Raises InputError where results cannot be kept."""
    total = sum(len(task.task.candidates) for cell in cells for task in cell.tasks if task.task is not None)
    try:
        with progress("Scoring", total) as advance:
            scores = score(cells, computer, advance)
    except KeyboardInterrupt:
        finished = tuple(result for cell in cells for result in scores_of(cell, computer))
        total = sum(1 if cell.workspace is None else len(cell.tasks) for cell in cells)
        return Scorecard(results=finished, interrupted=True, unfinished=total - len(finished))
    return Scorecard(results=tuple(scores))


class CoverageLookup:
    """The coverage of ways over time, computed in advance."""

    def __init__(self, cells: Sequence[ScoredCell], computer: Computer) -> None:
        self._workspaces = {cell.name: cell.workspace for cell in cells if cell.workspace is not None}
        self._computer = computer

    def prepare(self, ways: Sequence[tuple[TaskScore, CandidateResult]], progress: Progress) -> None:
        """Compute the coverage of feasible ways. Raises InputError where results cannot be kept."""
        wanted = [self._wanted(result, way) for result, way in ways if way.rank is not None]
        if wanted:
            with progress("Looking up causes", len(wanted)) as advance:
                self._computer.compute(wanted, advance, coverage=True)

    def __call__(self, result: TaskScore, way: CandidateResult) -> Coverage | None:
        """The coverage of a way of doing a task; None where it is infeasible or was not prepared."""
        outcome = self._computer.outcome(self._wanted(result, way), coverage=True)
        return None if outcome is None else outcome.coverage

    def _wanted(self, result: TaskScore, way: CandidateResult) -> Wanted:
        return Wanted(self._workspaces[result.workspace], result.content, way.way)


@dataclass(frozen=True, eq=False)
class Expected:
    """What scores are compared with."""

    baseline: Baseline
    allowance: float
    """What may get worse: points of Q, percent of times."""
    may_vanish: bool
    """Whether it is no failure if the baseline has a workspace, task or choice of objects that is no longer there."""


def compare_with(
    scorecard: Scorecard, cells: Sequence[ScoredCell], expected: Expected, lookup: CoverageLookup, progress: Progress
) -> Scorecard:
    """The scorecard with every task compared with its baseline; a task that got worse has failed.

    Raises InputError where results cannot be kept.
    """
    baseline = expected.baseline
    known = identified(baseline, cells)
    changes = {
        cell.name: workspace_changes(record.digest, record.files, baseline.fields, cell.workspace)
        for cell in cells
        if cell.workspace is not None and cell.name in known
        for record in [baseline.workspaces[known[cell.name]]]
    }
    tasks = {name: baseline.workspaces[before].tasks for name, before in known.items()}
    pairs = [(one, tasks.get(one.workspace, {}).get(one.task or "")) for one in scorecard.results]
    lookup.prepare(list(_ways_to_explain(pairs, expected.allowance)), progress)
    results = [_compared(one, record, expected, lookup, changes.get(one.workspace, ())) for one, record in pairs]
    names = {known.get(cell.name, ""): [task.text for task in cell.tasks] for cell in cells}
    unreadable = {known.get(cell.name) for cell in cells if cell.workspace is None}
    return replace(
        scorecard,
        results=tuple(results),
        changes={name: found for name, found in changes.items() if found},
        vanished=tuple(task for task in vanished(baseline, names) if task.workspace not in unreadable),
        may_vanish=expected.may_vanish,
        renamed={name: before for name, before in known.items() if name != before},
    )


def _ways_to_explain(
    pairs: Sequence[tuple[TaskScore, TaskRecord | None]], allowance: float
) -> Iterator[tuple[TaskScore, CandidateResult]]:
    """The ways whose losses are looked up, each with its task; pairs: every task, and what the baseline says of it."""
    for one, record in pairs:
        if record is not None:
            changes = changed_ways(record, one, allowance)
            yield from ((one, one.ways[change.way]) for change in changes if change.losses_matter)


def listed(changes: Sequence[Change]) -> str:
    """The first changes, and the number of others."""
    shown = ", ".join(str(change) for change in changes[:CHANGES_SHOWN])
    more = len(changes) - CHANGES_SHOWN
    return shown + (f" and {more} more" if more > 0 else "")


class Versions(NamedTuple):
    """Two versions of a workspace, both under the name of the later one."""

    before: ScoredCell
    after: ScoredCell


def read_versions(before: Path, after: Path) -> Versions:
    """Both versions of a workspace.

    Raises InputError where one of them, or a task of it, cannot be used.
    """
    old, new = _read_version(before), _read_version(after)
    name = "workspace" if new.workspace is None else new.workspace.name
    return Versions(replace(old, name=name), replace(new, name=name))


def difference(
    before: ScoredCell, after: ScoredCell, computer: Computer, allowance: float, progress: Progress
) -> Scorecard:
    """How the tasks of `after` compare with those of `before`; allowance: see `compare`.

    Raises InputError where results cannot be kept, or candidates cannot be computed.
    """
    first = replace(score_cells([before], computer, progress), document="diff")
    if first.interrupted:
        return replace(first, results=())
    lookup = CoverageLookup([before], computer)
    lookup.prepare([(score, way) for score in first.results for way in score.ways.values()], progress)
    baseline = baseline_of([before], first.results, lookup, computer.sampling)
    second = replace(score_cells([after], computer, progress), document="diff")
    if second.interrupted:
        return second
    # Only what is worse than before counts as failed, not what is below a threshold in both.
    results = (replace(one, status="passed", reasons=()) if one.status == "failed" else one for one in second.results)
    second = replace(second, results=tuple(results))
    lookup = CoverageLookup([after], computer)
    return compare_with(second, [after], Expected(baseline, allowance, may_vanish=True), lookup, progress)


def _compared(
    result: TaskScore, record: TaskRecord | None, expected: Expected, lookup: CoverageLookup, changes: Sequence[Change]
) -> TaskScore:
    if result.status == "error":
        return result
    comparison = compare(record, result, expected.allowance, lookup)
    since = f"; since the baseline {listed(changes)}" if changes else ""
    reasons = [f"{result.task} got worse for {change}{since}" for change in comparison.ways if change.worse]
    if not expected.may_vanish:
        reasons += [f"{result.task} for {way} is in the baseline, and no longer here{since}" for way in comparison.gone]
    status = "failed" if reasons else result.status
    return replace(result, status=status, reasons=(*result.reasons, *reasons), baseline=comparison)


def _read_version(path: Path) -> ScoredCell:
    cell = read_cell(workspace_file(path), "workspace")
    problems = [problem for problem in cell.problems if problem.severity == "error"]
    problems += [problem for task in cell.tasks for problem in task.problems]
    if problems:
        raise InputError(*problems)
    return cell
