"""Tasks compared with their baseline, or another version: what got worse, and what is no longer seen, by whom, when."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from sqrp_cli.cell.workspace_file import workspace_file
from sqrp_cli.errors import InputError
from sqrp_cli.logic.formula_time import TimeInterval
from sqrp_cli.platform.processes import Progress
from sqrp_cli.score.baseline import Baseline, TaskRecord, WayRecord, seen, workspace_changes
from sqrp_cli.score.compute import Computer
from sqrp_cli.score.result import (
    METRICS,
    Change,
    Comparison,
    LostView,
    Scorecard,
    Shift,
    TaskScore,
    VanishedTask,
    WayChange,
    listed,
)
from sqrp_cli.score.score import ScoredCell, read_cell, score_cells
from sqrp_cli.study.blind_spans import Coverage, difference, intersection
from sqrp_cli.study.result import CandidateResult

SHORTEST_LOSS = 0.01  # shorter losses are not reported [s]


def look_up(ways: Iterable[tuple[TaskScore, CandidateResult]], computer: Computer, progress: Progress) -> None:
    """Compute the coverage of feasible ways, each with its task. Raises InputError where results cannot be kept."""
    pairs = [(one, way) for one, way in ways if way.rank is not None]
    requests = [replace(one.request, candidate=way.way, coverage=True) for one, way in pairs]
    if requests:
        with progress("Looking up causes", len(requests)) as advance:
            computer.compute(requests, advance)


def compare_with(
    baseline: Baseline,
    scorecard: Scorecard,
    cells: Sequence[ScoredCell],
    computer: Computer,
    progress: Progress,
    *,
    allowance: float,
    may_vanish: bool,
) -> Scorecard:
    """The scorecard with every task compared with its baseline; a task that got worse has failed.

    allowance: what may get worse, points of Q and percent of times. may_vanish: whether it is no failure if the
    baseline has a workspace, task or choice of objects that is no longer there. Raises InputError where results cannot
    be kept.
    """
    known = baseline.identified(cells)
    changes = {
        cell.name: workspace_changes(record.digest, record.files, baseline.fields, cell.workspace)
        for cell in cells
        if cell.workspace is not None and cell.name in known
        for record in [baseline.workspaces[known[cell.name]]]
    }
    tasks = {name: baseline.workspaces[before].tasks for name, before in known.items()}
    compared: list[tuple[TaskScore, TaskRecord | None, tuple[WayChange, ...]]] = []
    for one in scorecard.results:
        record = tasks.get(one.workspace, {}).get(one.task or "")
        compared.append((one, record, () if record is None else tuple(_changed_ways(record, one, allowance))))
    explained = (
        (one, one.ways[way.way]) for one, _, ways in compared for way in ways if way.worse and not way.another_way
    )
    look_up(explained, computer, progress)
    names = {known.get(cell.name, ""): [task.expected.task for task in cell.tasks] for cell in cells}
    unreadable = {known.get(cell.name) for cell in cells if cell.workspace is None}
    return replace(
        scorecard,
        results=tuple(
            _compared(*one, computer, changes.get(one[0].workspace, ()), may_vanish=may_vanish) for one in compared
        ),
        changes={name: found for name, found in changes.items() if found},
        vanished=tuple(
            VanishedTask(workspace, task)
            for workspace, record in baseline.workspaces.items()
            for task in record.tasks
            if task not in names.get(workspace, ()) and workspace not in unreadable
        ),
        may_vanish=may_vanish,
        renamed={name: before for name, before in known.items() if name != before},
    )


def _changed_ways(before: TaskRecord, now: TaskScore, allowance: float) -> Iterator[WayChange]:
    """The ways of doing a task with changes beyond the allowance, of Q or of a time before, without their losses."""
    share = allowance / 100
    for name, way in now.ways.items():
        old, new, shifts = before.ways.get(name), WayRecord.of(way, None), list[Shift]()
        if old is None:
            continue
        if old.feasible != new.feasible:
            shifts.append(Shift("feasible", float(old.feasible), float(new.feasible), worse=old.feasible))
        for metric in METRICS if old.feasible == new.feasible else ():
            was, is_now = (inf if metric == "delay" and one.unseen else getattr(one, metric) for one in (old, new))
            if was is None or is_now is None or is_now == was:
                continue
            quality = metric in ("q_eoi", "q_avg")
            allowed = share if quality else (share * was if was < inf else 0.0) + 1e-6
            if abs(is_now - was) > allowed:
                known = [None if one == inf else one for one in (was, is_now)]
                shifts.append(Shift(metric, known[0], known[1], worse=is_now < was if quality else is_now > was))
        if shifts:
            yield WayChange(
                way=name,
                candidate_before=old.candidate,
                candidate=new.candidate,
                shifts=tuple(shifts),
                reason=new.reasons[0] if old.feasible and not new.feasible else "",
                choice_before=old.choice,
                choice=new.choice,
            )


def _compared(
    score: TaskScore,
    record: TaskRecord | None,
    ways: Sequence[WayChange],
    computer: Computer,
    changes: Sequence[Change],
    *,
    may_vanish: bool,
) -> TaskScore:
    """A task with what changed since its baseline, the worst first. changes: of its workspace."""
    if score.status == "error" or record is None:
        return score if score.status == "error" else replace(score, baseline=Comparison("new"))
    found = []
    for change in ways:
        before = record.ways[change.way].coverage
        now = seen(computer, score, score.ways[change.way]) if change.worse and not change.another_way else None
        found.append(change if before is None or now is None else replace(change, lost=lost(before, now)))
    worse = any(change.worse for change in found)
    gone = tuple(name for name in record.ways if name not in score.ways)
    since = f"; since the baseline {listed(changes)}" if changes else ""
    found.sort(key=lambda change: (not change.worse, -change.severity))
    reasons = [f"{score.task} got worse for {change}{since}" for change in found if change.worse]
    if not may_vanish:
        reasons += [f"{score.task} for {way} is in the baseline, and no longer here{since}" for way in gone]
    return replace(
        score,
        status="failed" if reasons else score.status,
        reasons=(*score.reasons, *reasons),
        baseline=Comparison("regressed" if worse else "improved" if found else "unchanged", tuple(found), gone),
    )


def lost(before: Coverage, now: Coverage) -> tuple[LostView, ...]:
    """What is no longer covered, for every camera that used to see it; the longest first.

    If the motion became faster or slower, an earlier time stands for the same share of the same primitive now.
    """
    old_ends, new_ends = [0.0, *before.primitives.values()], [0.0, *now.primitives.values()]

    def moved(stretches: Sequence[TimeInterval]) -> list[TimeInterval]:
        """Stretches of the earlier motion on the present one."""
        if list(before.primitives) != list(now.primitives):
            return list(stretches)
        ends = (np.interp([one.start, one.end], old_ends, new_ends).tolist() for one in stretches)
        return [TimeInterval(start, end) for start, end in ends]

    losses: list[LostView] = []
    for atom, target in now.targets.items():
        old = before.targets.get(atom)
        if old is None:
            continue
        missing = difference(intersection(moved(old.covered), target.required), target.covered)
        for camera in old.blind:
            gone = intersection(missing, moved(old.seen_by(camera)))
            for stretch in difference(gone, target.seen_by(camera)):
                why, longest = "there is no such camera any more", -inf
                for span, reason in target.blind.get(camera, ()):
                    within = min(span.end, stretch.end) - max(span.start, stretch.start)
                    if within > longest:
                        why, longest = reason.words, within
                if stretch.length >= SHORTEST_LOSS:
                    losses.append(LostView(atom, camera, stretch.start, stretch.end, why, target.says))
    return tuple(sorted(losses, key=lambda loss: loss.start - loss.end))


def read_version(path: Path) -> ScoredCell:
    """A version of a workspace. Raises InputError where it, or a task of it, cannot be used."""
    cell = read_cell(workspace_file(path), "workspace")
    problems = [problem for problem in cell.problems if problem.severity == "error"]
    problems += [problem for task in cell.tasks for problem in task.problems]
    if problems or cell.workspace is None:
        raise InputError(*problems)
    return replace(cell, name=cell.workspace.name)


def compare_versions(
    before: ScoredCell, after: ScoredCell, computer: Computer, allowance: float, progress: Progress
) -> Scorecard:
    """How the tasks of a version compare with those of one before it, under the later one's name.

    allowance: see `compare_with`. Raises InputError where results cannot be kept, or candidates cannot be computed.
    """
    before = replace(before, name=after.name)
    first = replace(score_cells([before], computer, progress), document="diff")
    if first.interrupted:
        return replace(first, results=())
    look_up(((score, way) for score in first.results for way in score.ways.values()), computer, progress)
    baseline = Baseline.of([before], first.results, computer)
    second = replace(score_cells([after], computer, progress), document="diff")
    if second.interrupted:
        return second
    # Only what is worse than before counts as failed, not what is below a threshold in both.
    results = (replace(one, status="passed", reasons=()) if one.status == "failed" else one for one in second.results)
    second = replace(second, results=tuple(results))
    return compare_with(baseline, second, [after], computer, progress, allowance=allowance, may_vanish=True)
