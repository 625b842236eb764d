"""Finds a program's motion in recorded joint states."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Sequence
from dataclasses import field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.errors import Place, bad_input, first_names
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.program.record import Program, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.nominal_step import planned_joints

SPACING = 0.02
"""Between the starts of a step that are tried [s]."""

POINTS = 64
"""Points of a step's motion that are compared."""

NEAR = 0.03
"""A joint this close to where the program wants it follows the program [rad or m]."""

LEAST_SHARE = 0.35
"""Least share of a step's motion that must be there, from its beginning on: it may have been stopped on the way."""

GAP = 0.2
"""Between joint states farther apart than this [s] the joints are not known."""

LONGEST = 12 * 3600.0
"""Longest recording that is searched [s]; that of a longer one, or of one in which a clock jumped, is refused."""

_ONE_RUN = 2.0
"""Starts that fit as well as the first one, and are not later than this after it [s], are of the same run."""

_BLOCK = 4096
"""Starts that are tried at once."""


@dataclass
class JointTracks:
    """Where joints were, as recorded: positions over times of the robot's clock, by topic and name."""

    _points: dict[str, dict[str, tuple[array[float], array[float]]]] = field(default_factory=dict)
    _tracks: dict[str, tuple[Array, Array]] = field(default_factory=dict)

    def add(self, topic: str, t: float, names: Sequence[str], positions: Sequence[float]) -> None:
        """A joint state of time t [s]; positions that are missing or not finite are left out."""
        tracks = self._points.setdefault(topic, {})
        for name, position in zip(names, positions, strict=False):
            if np.isfinite(position):
                times, values = tracks.setdefault(name, (array("d"), array("d")))
                times.append(t)
                values.append(float(position))

    def sorted(self) -> JointTracks:
        """Ready to be asked: of a joint on several topics, that with the most states."""
        for tracks in self._points.values():
            for name, (times, values) in tracks.items():
                if len(times) > len(self._tracks.get(name, ((), ()))[0]):
                    order, first = np.unique(np.array(times), return_index=True)
                    self._tracks[name] = (order, np.array(values)[first])
        self._points = {}
        return self

    @property
    def names(self) -> list[str]:
        """The joints."""
        return list(self._tracks)

    def position(self, name: str, t: Array) -> Array:
        """Of a joint at times t (m,) [s]; between two states linear."""
        times, values = self._tracks[name]
        return np.interp(t, times, values)

    def covers(self, names: Collection[str], t: Array) -> Mask:
        """Whether all of some joints are known at times t (m,) [s]."""
        known = np.ones(len(t), dtype=bool)
        for name in names:
            times, _ = self._tracks[name]
            after = np.clip(np.searchsorted(times, t), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(t), int)
            known &= (t >= times[0] - GAP) & (t <= times[-1] + GAP) & (times[after] - times[after - 1] <= GAP)
        return known

    def span(self, names: Collection[str]) -> Stretch:
        """When all of some joints are known."""
        tracks = [self._tracks[name][0] for name in names]
        return Stretch(max(float(t[0]) for t in tracks), min(float(t[-1]) for t in tracks))


class FoundMotion(NamedTuple):
    """A program's motion in a recording."""

    starts: list[float]
    """When that of each step began, by the robot's clock [s]; of several runs in the first one."""
    runs: int
    """How many times all of its steps are there, one after the other."""


def found_steps(program: Program, arm: Sequence[str], tracks: JointTracks, path: Path) -> FoundMotion:
    """Find each step; arm: the joints to go by.

    Raises InputError where a joint was not recorded, or a step is not in the recording.
    """
    missing = [name for name in arm if name not in tracks.names]
    if missing:
        there = first_names(sorted(tracks.names)) or "none"
        message = f"the joint states of this recording lack {', '.join(missing)}; they have {there}"
        raise bad_input("no-joints", message, Place(path))
    columns = [program.joints.index(name) for name in arm]
    left = known = tracks.span(arm)
    if known.length > LONGEST:
        hours = known.length / 3600
        message = f"the joint states of this recording span {hours:,.0f} hours, more than {LONGEST / 3600:.0f}"
        raise bad_input("file-too-large", message, Place(path), mend="cut the recording to the run of the program")
    fits: list[_Fit] = []
    for number, step in enumerate(program.steps, 1):
        fit = _best_start(step, columns, arm, tracks, left)
        if fit.share < LEAST_SHARE:
            motion, least = f"the motion of step {number}, {step.short_task}", f"the first {LEAST_SHARE:.0%} of it"
            near = f"where they are nearest to it, at {fit.start - known.start:.2f} s, {fit.share:.0%} of it fits"
            message = f"{motion}, is not in the joint states of this recording: {near}; expected at least {least}"
            if fit.start + (fit.share + 1 / POINTS) * step.time > known.end:
                early = f"this recording ends at {known.length:.2f} s, too early in {motion}"
                message = f"{early}; expected at least {least}"
            raise bad_input("other-motion", message, Place(path))
        fits.append(fit)
        left = Stretch(fit.start + 0.5 * step.time, known.end)
    runs, t = -1, -np.inf
    while t < np.inf:  # all steps once more, one after the other, until one is not there
        runs += 1
        for fit, step in zip(fits, program.steps, strict=True):
            t = next((one for one in fit.all_starts if one >= t), np.inf) + max(0.5 * step.time, SPACING)
    return FoundMotion([fit.start for fit in fits], runs)


class _Fit(NamedTuple):
    """Where a step's motion begins [s], the share of it that is there, and all times about when it begins [s]."""

    start: float
    share: float
    all_starts: Sequence[float]


def _best_start(step: Step, columns: Sequence[int], arm: Sequence[str], tracks: JointTracks, span: Stretch) -> _Fit:
    """The first start of a step from which on the robot follows it for the longest time.

    So a retry after a fault is not taken for it, which follows other ways to where it begins. It is then refined to
    that at which the recorded motion fits best, by least squares over what follows the program.
    """
    tau = np.linspace(0.0, step.time, POINTS)
    planned = planned_joints(step, tau)[:, columns]
    starts = np.arange(span.start - SPACING, span.end + SPACING, SPACING)
    costs, shares = np.empty(len(starts)), np.empty(len(starts))
    for first in range(0, len(starts), _BLOCK):
        t = starts[first : first + _BLOCK, None] + tau
        errors = np.max([np.abs(tracks.position(n, t) - planned[:, i]) for i, n in enumerate(arm)], axis=0)
        errors = np.where((t < span.start - SPACING) | (t > span.end + SPACING), np.inf, errors)
        costs[first : first + _BLOCK] = np.minimum(errors, NEAR).mean(axis=1)
        shares[first : first + _BLOCK] = np.logical_and.accumulate(errors < NEAR, axis=1).mean(axis=1)
    good = np.flatnonzero(shares >= max(LEAST_SHARE, shares.max() - 0.05))
    if not len(good):
        return _Fit(float(starts[np.argmax(shares)]), float(shares.max(initial=0.0)), ())
    # Of several runs the first one.
    run = good[starts[good] <= starts[good[0]] + _ONE_RUN]
    best = int(run[np.argmin(costs[run])])
    fresh = np.diff(starts[good], prepend=-np.inf) > _ONE_RUN
    start, h = float(starts[best]), SPACING / 2
    tau = np.arange(0.0, step.time, h)
    planned = planned_joints(step, tau)[:, columns]
    for _ in range(10):
        before, after = (np.column_stack([tracks.position(n, start + tau + d) for n in arm]) for d in (-h, h))
        slope, error = (after - before) / (2 * h), (after + before) / 2 - planned
        kept = np.abs(error).max(axis=1) < NEAR
        weight = float((slope[kept] ** 2).sum())
        change = -float((slope[kept] * error[kept]).sum()) / weight if weight >= 1e-9 else 0.0  # 0: it stands
        start += float(np.clip(change, -SPACING, SPACING))
        if abs(change) < 1e-6:
            break
    return _Fit(start, float(shares[best]), starts[good[fresh]].tolist())
