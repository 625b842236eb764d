"""Qualities that hold for every pose of the cameras within bounds: proven, where draws of poses only show examples.

The motion is observed twice: with what the cameras see surely, from every pose, and with what they see possibly, from
some pose at least. What they see from any one pose lies between. What of the rest is proven as a camera has one pose
throughout is added: a time is undecided if some poses see what must be seen and others do not, and where several such
times depend on one camera, no pose need be the worst in all. The centres of that camera are cut into parts: what is
lost from each part is added up over all these times, and the worst part counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.logic.formula_time import Stretch, merge
from sqrp_cli.programming.coverage.observation import look_at
from sqrp_cli.programming.coverage.quality import ROUNDING, Qualities, falls_short
from sqrp_cli.programming.coverage.sampling import Sampling, longest_step
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.coverage.timeline import Timeline, Watch, bisection_error, observe
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.centres import CentreParts
from sqrp_cli.programming.sensing.bounded.observer import BoundedObserver
from sqrp_cli.programming.sensing.observer import Observer, sees_all
from sqrp_cli.programming.targets import Target

_CELLS = 32
"""Cells into which an undecided time is cut, in each piece of the motion, at least: they last as long as samples may be
apart, at most."""

_FINEST, _AT_ONCE, _ROUNDS = 1 / 50, 2, 60
"""Half the side of the smallest parts, as a share of the ball's radius; how many parts are cut at once for each figure;
and how often at most."""


class Settled(NamedTuple):
    """Of all undecided time and of that in events of interest, shape (2,) [s] each."""

    covered: Array
    """How much is covered from every pose, at whatever instants."""
    uncovered: Array
    """How much is not, from every pose."""


def settled(watch: Watch, observer: Observer, bounds: PoseBounds, undecided: Sequence[Stretch]) -> Settled:
    """What is proven of undecided times, in order, by cutting the poses of one camera that decides most of them."""
    cause = max(_causes(watch, observer, undecided), key=lambda one: one.length, default=None)
    if cause is None or 2.0 * cause.length < sum(time.length for time in undecided):
        return Settled(np.zeros(2), np.zeros(2))  # little would be gained
    grid = _Grid.of(watch, cause, longest_step(observer.cameras))
    alone = replace(observer, cameras=(observer.cameras[cause.camera],))
    viewed = BoundedObserver.of(alone, bounds, surely=True).viewed(cause.target, watch.stage.states(grid.samples))
    parts = CentreParts.whole(len(grid.samples), bounds)
    rest = _Rest.of(watch, observer, bounds, grid, cause)
    asked = viewed.within & (rest.sure | ~rest.possible)
    for _ in range(_ROUNDS):
        which = _worth_cutting(grid, rest.times(grid, parts), parts.half > _FINEST * bounds.reach)
        if not len(which) or not asked.any():
            break
        parts = parts.split(which, viewed, asked)
    return Settled(*(of_part.min(axis=0) for of_part in rest.times(grid, parts)))


class _Cause(NamedTuple):
    """Undecided times in which all depends on how much a camera sees of a target."""

    target: Target
    camera: int
    times: Sequence[Stretch]

    @property
    def length(self) -> float:
        return sum(time.length for time in self.times)


def _causes(watch: Watch, observer: Observer, undecided: Sequence[Stretch]) -> Iterator[_Cause]:
    """Those of several times, by what the stated cameras see at both ends: only one of them sees the target at one."""
    starts = np.array([piece.start for piece in watch.stage.pieces])
    ends = np.array([(time.start, time.end) for time in undecided]).reshape(-1, 2)
    piece = np.searchsorted(starts, ends.mean(axis=1), side="right") - 1
    samples = Samples(np.repeat(piece, 2), ends.reshape(-1))
    targets = [one for one in watch.targets if one.cameras == 1 and all(b.limits.min_visible < 1 for b in one.boxes)]
    required = watch.stage.requires(targets, samples).T
    boxes = observer.verdicts(targets, watch.stage.states(samples), shares=False) if len(samples) else ()
    for target, of_target, asked in zip(targets, boxes, required, strict=False):
        sees = sees_all(of_target)
        changes = (sees[::2] != sees[1::2]) & asked[::2, None]
        changes &= changes.sum(axis=1, keepdims=True) == 1
        for camera, of_camera in enumerate(changes.T):
            if of_camera.sum() > 1:
                yield _Cause(target, camera, [undecided[time] for time in np.flatnonzero(of_camera).tolist()])


@dataclass(frozen=True, eq=False)
class _Grid:
    """Undecided times in n cells between some of m samples."""

    samples: Samples
    first: Indices
    """The sample before each cell; the next is the one after it; shape (n,)."""
    lengths: Array
    """Of each, and of what of it counts for events of interest, shape (n, 2) [s]."""

    @classmethod
    def of(cls, watch: Watch, cause: _Cause, longest: float) -> _Grid:
        """What of its times lies in pieces that require its target, in cells of so long at most [s]."""
        parts = [
            (number, max(piece.start, time.start), min(piece.end, time.end), piece.of_interest)
            for number, piece in enumerate(watch.stage.pieces)
            if any(literal.atom == cause.target.atom for literal in piece.literals)
            for time in cause.times
        ]
        piece, start, end, of_interest = np.array([part for part in parts if part[1] < part[2]]).reshape(-1, 4).T
        cells = max(_CELLS, int(np.ceil((end - start).max(initial=0.0) / longest)))
        t = np.linspace(start, end, cells + 1, axis=1)
        step = np.repeat((end - start) / cells, cells)
        return cls(
            samples=Samples(np.repeat(piece.astype(np.int64), cells + 1), t.reshape(-1)),
            first=np.arange(t.size).reshape(t.shape)[:, :-1].reshape(-1),
            lengths=np.stack([step, step * np.repeat(of_interest, cells)], axis=1),
        )

    def between(self, seen: Mask) -> Array:
        """The time between samples that are both seen, shape (p, 2) [s]; seen: shape (p, m)."""
        return (seen[:, self.first] & seen[:, self.first + 1]) @ self.lengths


class _Rest(NamedTuple):
    """What else decides m samples: other targets, and other cameras, which are anywhere within bounds."""

    sure: Mask
    """Whether all other targets are surely covered, shape (m,)."""
    possible: Mask
    """Whether any other camera may see the target, shape (m,)."""

    @classmethod
    def of(cls, watch: Watch, observer: Observer, bounds: PoseBounds, grid: _Grid, cause: _Cause) -> _Rest:
        """In the samples of a grid."""

        def covered(cell: BoundedObserver, targets: tuple[Target, ...]) -> Mask:
            seen = look_at(cell, [replace(watch, targets=targets, faults={}).look(grid.samples)])[0]
            found: Mask = np.all(seen.covered | ~seen.required, axis=1)
            return found

        cameras = tuple(one for index, one in enumerate(observer.cameras) if index != cause.camera)
        others = tuple(one for one in watch.targets if one is not cause.target)
        return cls(
            sure=covered(BoundedObserver.of(observer, bounds, surely=True), others),
            possible=covered(
                BoundedObserver.of(replace(observer, cameras=cameras), bounds, surely=False), (cause.target,)
            ),
        )

    def times(self, grid: _Grid, parts: CentreParts) -> Settled:
        """The same of each of p parts of the poses, shape (p, 2) each [s]."""
        return Settled(grid.between(parts.sure & self.sure), grid.between(~parts.possible & ~self.possible))


def _worth_cutting(grid: _Grid, times: Settled, coarse: Mask) -> Indices:
    """The parts that decide a figure, by index, as long as the worst of all is `coarse` (p,)."""
    chosen = [np.zeros(0, dtype=np.int64)]
    for column in np.flatnonzero(grid.lengths.any(axis=0)):
        for of_part in times:
            worst = np.argsort(of_part[:, column], kind="stable")[:_AT_ONCE]
            if coarse[worst[0]]:
                chosen.append(worst[coarse[worst]])
    return np.unique(np.concatenate(chosen))


_SHORT = 1e-3
"""Undecided times up to this [s] are left out: bisection leaves some around changes that both timelines have."""


@dataclass(frozen=True)
class Certificate:
    """What is proven of a candidate's qualities, as they would be computed from any pose of each camera in bounds."""

    least: Qualities
    """No pose gives less."""
    most: Qualities
    """No pose gives more."""
    undecided: tuple[Stretch, ...]
    """When the state may be covered or not, depending on the poses, or no proof was found, for more than 1 ms."""


def certify(watch: Watch, observer: Observer, sampling: Sampling, bounds: PoseBounds) -> Certificate:
    """What is proven of a motion."""
    sure, possible = (
        observe(watch, BoundedObserver.of(observer, bounds, surely=surely), sampling, full=False)
        for surely in (True, False)
    )
    undecided = tuple(one for one in _without(_covered(possible), _covered(sure)) if one.length > _SHORT)
    # Bisection leaves an error, that of the figures that the least is about, and that of the most.
    error = ROUNDING + bisection_error(sampling)
    by_one_pose = settled(watch, observer, bounds, undecided)
    least, most = _added(Qualities.of(sure), watch, by_one_pose.covered), Qualities.of(possible)
    most = _added(most, watch, -by_one_pose.uncovered)
    return Certificate(
        least=Qualities(_lowered(least.q_avg, error), _lowered(least.q_eoi, error)),
        most=Qualities(_raised(most.q_avg, error), _raised(most.q_eoi, error)),
        undecided=undecided,
    )


def _added(qualities: Qualities, watch: Watch, times: Array) -> Qualities:
    """Qualities with more of all time, and of that in events of interest, covered; times: shape (2,) [s]."""
    parts = zip((qualities.q_avg, qualities.q_eoi), times.tolist(), (watch.T, watch.T_eoi), strict=True)
    return Qualities(*(None if quality is None else quality + more / total for quality, more, total in parts))


def _lowered(quality: float | None, error: float) -> float | None:
    """A quality that nothing can be lost of if all is seen: then it is 1, whatever the rounding of sums of times."""
    if quality is None:
        return None
    return max(0.0, quality - error) if falls_short(quality, 1.0) else 1.0


def _raised(quality: float | None, error: float) -> float | None:
    """A quality that nothing can be added to if nothing is seen."""
    return quality if not quality else min(1.0, quality + error)


def _covered(timeline: Timeline) -> list[Stretch]:
    """When the state is covered, as its qualities count it."""
    t, covered = timeline.samples.t, timeline.covered
    both = np.flatnonzero(covered[:-1] & covered[1:] & ~np.isnan(timeline.steps))
    return list(merge(Stretch(start, end) for start, end in zip(t[both].tolist(), t[both + 1].tolist(), strict=True)))


def _without(stretches: list[Stretch], others: list[Stretch]) -> Iterator[Stretch]:
    """Stretches without others, both in order."""
    for stretch in stretches:
        start = stretch.start
        for other in others:
            if other.start > start and start < stretch.end:
                yield Stretch(start, min(other.start, stretch.end))
            start = max(start, other.end)
        if start < stretch.end:
            yield Stretch(start, stretch.end)
