"""A task compared with its baseline, with the reason: what is no longer seen, by which camera, when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Literal

import numpy as np

from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.programming.coverage.blind_spans import BlindSpan, Coverage, TargetCoverage, difference, intersection
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.ways.grips import NOTHING_SPECIAL
from sqrp_cli.scoring.baselines.baseline import TaskRecord, WayRecord
from sqrp_cli.scoring.score import TaskScore

SHORTEST_LOSS = 0.01
"""Shorter losses are not reported [s]."""

Verdict = Literal["regressed", "improved", "unchanged", "new"]


@dataclass(frozen=True)
class Loss:
    """A stretch of time in which a literal is no longer covered, because a camera no longer sees it."""

    literal: str
    camera: str
    stretch: Stretch
    """On the present motion."""
    why: str
    """The commonest cause in a few words."""

    def __str__(self) -> str:
        return f"{self.camera} no longer sees {self.literal} {self.stretch.when}: {self.why}"


@dataclass(frozen=True)
class Shift:
    """A figure that got better or worse; values in 0..1 or s, None if undefined or infeasible."""

    metric: Literal["feasible", "q_eoi", "q_avg", "time", "delay"]
    """Which figure; `delay` is the longest time that a fault may remain unnoticed, null where it may for ever."""
    before: float | None
    """In the baseline; of `feasible`, 1 or 0."""
    now: float | None
    """At present; of `feasible`, 1 or 0."""
    worse: bool
    """Whether it got worse."""

    @property
    def size(self) -> float:
        """How far the figure moved: a difference of Q, or the share by which a time changed."""
        if self.before is None or self.now is None:
            return 0.0
        moved = abs(self.now - self.before)
        return moved / self.before if self.metric in ("time", "delay") and self.before > 0 else moved

    def __str__(self) -> str:
        match self.metric:
            case "feasible":
                return "can no longer be done" if self.worse else "can be done now"
            case "q_eoi" | "q_avg":
                verb = "fell" if self.worse else "rose"
                return f"{self.metric.replace('q_', 'Q_')} {verb} {_from_to(self.before, self.now, 100.0, 1, '%')}"
            case _:
                if self.now is None:
                    return "a fault may never be noticed any more"
                if self.before is None:
                    return f"no fault goes unnoticed any more: the worst delay is {self.now:.2f} s"
                what = "its time" if self.metric == "time" else "the worst delay of a fault"
                verb = "rose" if self.worse else "fell"
                return f"{what} {verb} {_from_to(self.before, self.now, 1.0, 2, 's')}"


@dataclass(frozen=True)
class WayChange:
    """How the best candidate for a choice of objects changed."""

    way: str
    before: str
    """Name of the candidate in the baseline."""
    now: str
    """Name of the candidate, now."""
    shifts: tuple[Shift, ...]
    losses: tuple[Loss, ...] = ()
    """The longest first; none where it goes another way, as times of different motions do not correspond."""
    reason: str = ""
    """Why it can no longer be done."""
    choice_before: str | None = None
    """The way behind the figures of the baseline, in a few words; None if it is not known."""
    choice: str | None = None
    """The way behind the figures now; None if it is infeasible."""

    @property
    def another_way(self) -> bool:
        """Whether the robot moves in another way than before, as far as the baseline says how it did."""
        known = self.choice is not None and self.choice_before is not None
        return self.now != self.before or (known and self.choice != self.choice_before)

    @property
    def worse(self) -> bool:
        """Whether anything got worse."""
        return any(shift.worse for shift in self.shifts)

    @property
    def better(self) -> bool:
        """Whether anything got better."""
        return any(not shift.worse for shift in self.shifts)

    @property
    def losses_matter(self) -> bool:
        """Whether what cameras no longer see tells why it got worse."""
        return self.worse and not self.another_way

    @property
    def severity(self) -> float:
        """Largest change for the worse: a difference of Q, or the share by which a time grew; 0 if none."""
        return max((shift.size for shift in self.shifts if shift.worse), default=0.0)

    def __str__(self) -> str:
        shown = [shift for shift in self.shifts if shift.worse] or list(self.shifts)
        parts = [", ".join(str(shift) for shift in shown)]
        if len(shown) < len(self.shifts):
            parts[0] += ", but " + ", ".join(str(shift) for shift in self.shifts if not shift.worse)
        if self.another_way:
            now, before = self._said(self.now, self.choice), self._said(self.before, self.choice_before)
            parts.append(f"{self.way} now goes another way: {now} instead of {before}")
        if self.reason:
            parts.append(self.reason)
        if self.losses:
            more = len(self.losses) - 1
            parts.append(
                f"{self.losses[0]}" + (f" ({more} more such stretch{'es' if more > 1 else ''})" if more else "")
            )
        return f"{self.way}: {'; '.join(parts)}"

    def _said(self, candidate: str, choice: str | None) -> str:
        """A way in words, with the name of its candidate where that differs, too."""
        if self.now == self.before:
            return str(choice)
        return candidate if choice in (None, NOTHING_SPECIAL) else f"{candidate}, {choice}"


@dataclass(frozen=True)
class Comparison:
    """How a task compares with its baseline."""

    verdict: Verdict
    ways: tuple[WayChange, ...] = ()
    """The changes, the worst first."""
    gone: tuple[str, ...] = ()
    """Ways of doing it that no longer exist."""


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
                before=old.candidate,
                now=new.candidate,
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
        changes.append(change if seen is None or sees is None else replace(change, losses=lost(seen, sees)))
    verdict: Verdict = "unchanged"
    if changes:
        verdict = "regressed" if any(change.worse for change in changes) else "improved"
    gone = tuple(name for name in before.ways if name not in now.ways)
    return Comparison(verdict, tuple(sorted(changes, key=lambda change: (not change.worse, -change.severity))), gone)


def lost(before: Coverage, now: Coverage) -> tuple[Loss, ...]:
    """What is no longer covered, for every camera that used to see it; the longest first.

    If the motion became faster or slower, an earlier time stands for the same share of the same primitive now.
    """
    losses: list[Loss] = []
    for atom, target in now.targets.items():
        old = before.targets.get(atom)
        if old is None:
            continue
        was_covered = _on_motion(old.covered, before, now)
        missing = difference(intersection(was_covered, target.required), target.covered)
        for camera in old.blind:
            gone = intersection(missing, _on_motion(old.seen_by(camera), before, now))
            losses += [
                Loss(atom, camera, stretch, _why(target, camera, stretch))
                for stretch in difference(gone, target.seen_by(camera))
                if stretch.length >= SHORTEST_LOSS
            ]
    return tuple(sorted(losses, key=lambda loss: -loss.stretch.length))


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


def _from_to(before: float | None, now: float | None, scale: float, digits: int, unit: str) -> str:
    """Two figures that differ, with two more digits where they would look the same."""

    def shown(figure: float | None, digits: int) -> str:
        return "-" if figure is None else f"{scale * figure:.{digits}f} {unit}"

    alike = shown(before, digits) == shown(now, digits)
    old, new = (shown(figure, digits + 2 * alike) for figure in (before, now))
    return f"from {old} to {new}"
