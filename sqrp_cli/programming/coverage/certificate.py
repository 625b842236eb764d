"""Qualities that hold for every pose of the cameras within bounds: proven, where draws of poses only show examples.

The motion is observed twice: with what the cameras see surely, from every pose, and with what they see possibly, from
some pose at least. What they see from any one pose lies between. What of the rest is proven as a camera has one pose
throughout is added.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import Stretch, merge
from sqrp_cli.programming.coverage.one_pose import settled
from sqrp_cli.programming.coverage.quality import ROUNDING, Qualities, falls_short
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import Timeline, Watch, bisection_error, observe
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.observer import BoundedObserver
from sqrp_cli.programming.sensing.observer import Observer

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
