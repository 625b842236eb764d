"""A task compared with its baseline, with the reason: what is no longer seen, by which camera, when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.score.baselines.baseline import TaskRecord, WayRecord
from sqrp_cli.score.changes import Comparison, LostView, Shift, Verdict, WayChange
from sqrp_cli.score.score import TaskScore
from sqrp_cli.study.blind_spans import BlindSpan, Coverage, TargetCoverage, difference, intersection
from sqrp_cli.study.result import CandidateResult

SHORTEST_LOSS = 0.01
"""Shorter losses are not reported [s]."""


def changed_ways(before: TaskRecord, now: TaskScore, allowance: float) -> tuple[WayChange, ...]:
    """The ways of doing a task with changes beyond the allowance, without their losses.

    allowance: points of Q, percent of times.
    """
    found = []
    for name, way in now.ways.items():
        old = before.ways.get(name)
        if old is None:
            continue
        new = WayRecord.of(way, None)
        shifts = tuple(_shifts(old, new, allowance))
        if shifts:
            reason = new.reasons[0] if old.feasible and not new.feasible else ""
            change = WayChange(
                way=name,
                candidate_before=old.candidate,
                candidate=new.candidate,
                shifts=shifts,
                reason=reason,
                choice_before=old.choice,
                choice=new.choice,
            )
            found.append(change)
    return tuple(found)


def compare(
    before: TaskRecord | None,
    now: TaskScore,
    allowance: float,
    coverage: Callable[[TaskScore, CandidateResult], Coverage | None],
) -> Comparison:
    """Compare a task with its baseline, the worst change first; None without one. coverage: of a way now."""
    if before is None:
        return Comparison("new")
    changes = []
    for change in changed_ways(before, now, allowance):
        seen = before.ways[change.way].seen
        sees = coverage(now, now.ways[change.way]) if change.losses_matter else None
        changes.append(change if seen is None or sees is None else replace(change, lost=lost(seen, sees)))
    verdict: Verdict = "unchanged"
    if changes:
        verdict = "regressed" if any(change.worse for change in changes) else "improved"
    gone = tuple(name for name in before.ways if name not in now.ways)
    return Comparison(verdict, tuple(sorted(changes, key=lambda change: (not change.worse, -change.severity))), gone)


def lost(before: Coverage, now: Coverage) -> tuple[LostView, ...]:
    """What is no longer covered, for every camera that used to see it; the longest first.

    If the motion became faster or slower, an earlier time stands for the same share of the same primitive now.
    """
    losses: list[LostView] = []
    for atom, target in now.targets.items():
        old = before.targets.get(atom)
        if old is None:
            continue
        was_covered = _on_motion(old.covered, before, now)
        missing = difference(intersection(was_covered, target.required), target.covered)
        for camera in old.blind:
            gone = intersection(missing, _on_motion(old.seen_by(camera), before, now))
            losses += [
                LostView(atom, camera, stretch.start, stretch.end, _why(target, camera, stretch))
                for stretch in difference(gone, target.seen_by(camera))
                if stretch.length >= SHORTEST_LOSS
            ]
    return tuple(sorted(losses, key=lambda loss: loss.start - loss.end))


def _why(target: TargetCoverage, camera: str, stretch: Stretch) -> str:
    if camera not in target.blind:
        return "there is no such camera any more"

    def within(span: BlindSpan) -> float:
        return min(span.stretch.end, stretch.end) - max(span.stretch.start, stretch.start)

    return max(target.blind[camera], key=within).words


def _on_motion(stretches: Sequence[Stretch], before: Coverage, now: Coverage) -> tuple[Stretch, ...]:
    """Stretches of an earlier motion on the present one."""
    if list(before.primitives) != list(now.primitives):
        return tuple(stretches)
    old, new = [0.0, *before.primitives.values()], [0.0, *now.primitives.values()]
    return tuple(
        Stretch(float(np.interp(stretch.start, old, new)), float(np.interp(stretch.end, old, new)))
        for stretch in stretches
    )


def _shifts(old: WayRecord, new: WayRecord, allowance: float) -> Iterator[Shift]:
    if old.feasible != new.feasible:
        yield Shift("feasible", float(old.feasible), float(new.feasible), worse=old.feasible)
        return
    share = allowance / 100
    for metric, before, now in (("q_eoi", old.q_eoi, new.q_eoi), ("q_avg", old.q_avg, new.q_avg)):
        if before is not None and now is not None and abs(now - before) > share:
            yield Shift(metric, before, now, worse=now < before)  # type: ignore[arg-type]
    worst = (inf if old.unseen else old.delay, inf if new.unseen else new.delay)
    for metric, before, now in (("time", old.time, new.time), ("delay", *worst)):
        if (
            before is not None
            and now is not None
            and abs(now - before) > (share * before if before < inf else 0) + 1e-6
        ):
            known = [None if one == inf else one for one in (before, now)]
            yield Shift(metric, known[0], known[1], worse=now > before)  # type: ignore[arg-type]
