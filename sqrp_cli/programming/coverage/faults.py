"""Detection delay of faults, and its cost in time, on the nominal motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Mask, begins_run
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.coverage.timeline import Timeline
from sqrp_cli.programming.motion.stop_and_return import Recovery


def fault_metrics(
    timeline: Timeline, fault: str, intervals: Sequence[Stretch], recovery: Recovery, total: float
) -> FaultMetrics:
    """The metrics of a fault that may happen at any time of its intervals, on a motion of duration `total` [s].

    Means and shares are over all the time of the intervals together, the rest is the largest of any of them.
    """
    parts = [interval_metrics(timeline, fault, interval, recovery, total) for interval in intervals]
    length = sum(interval.length for interval in intervals)
    weights = [interval.length / length if length > 0 else 1.0 / len(parts) for interval in intervals]

    def mean(values: Iterable[float]) -> float:
        return float(sum(weight * value for weight, value in zip(weights, values, strict=True)))

    return FaultMetrics(
        delay_mean=mean(part.delay_mean for part in parts),
        delay_worst=max(part.delay_worst for part in parts),
        blind_longest=max(part.blind_longest for part in parts),
        unseen=mean(part.unseen for part in parts),
        expected_time=mean(part.expected_time for part in parts),
    )


@dataclass(frozen=True)
class _Range:
    """A range of x in which the delay falls linearly (slope -1) while blind, or stays constant while seen."""

    start: float
    """[s]."""
    end: float
    """[s]."""
    seen: bool
    """Whether a fault is visible at once."""
    noticed: float = 0.0
    """When a fault of this range is noticed if it is not [s]."""
    response: float = 0.0
    """Time from its visibility until images show it [s]."""
    ever: bool = True
    """Whether it is noticed before the end."""


def interval_metrics(
    timeline: Timeline, fault: str, interval: Stretch, recovery: Recovery, total: float
) -> FaultMetrics:
    """The metrics of a fault whose formula spans `interval`, on a motion of duration `total` [s].

    delay(x) = first time >= x at which all literals of the fault are covered, minus x, plus the response (one frame
    period and latency) of the cameras that see it then; without such a time, the fault is noticed at the end. Between
    neighbouring covered samples it is covered, with the slower of their responses; between others it is not.
    expected_time = mean over x of x + delay + stop + move back to the start + `total`.
    """
    ranges = list(_ranges(timeline, fault, interval, total))
    length = interval.length
    delays = [(r.response, r.response) if r.seen else (r.noticed - r.start, r.noticed - r.end) for r in ranges]
    blind = [r for r in ranges if not r.seen]
    if length <= 0.0:
        weights = [1.0 if index == len(ranges) - 1 else 0.0 for index in range(len(ranges))]
    else:
        weights = [(r.end - r.start) / length for r in ranges]
    return FaultMetrics(
        delay_mean=sum(w * 0.5 * (first + last) for w, (first, last) in zip(weights, delays, strict=True)),
        delay_worst=max(first for first, _ in delays),
        blind_longest=max((r.end - r.start for r in blind), default=0.0),
        unseen=float(sum(w for w, r in zip(weights, ranges, strict=True) if not r.ever)),
        expected_time=sum(w * _mean_end(r, recovery, total) for w, r in zip(weights, ranges, strict=True)),
    )


def _ranges(timeline: Timeline, fault: str, interval: Stretch, total: float) -> Iterator[_Range]:
    """The interval cut where the fault comes into sight or is lost, in order."""
    t, response = timeline.samples.t, timeline.fault_response(fault)
    covered, not_before = ~np.isnan(response), t >= interval.start
    together = covered[:-1] & covered[1:] & ~np.isnan(timeline.steps) & not_before[1:]
    covered &= not_before
    first, last, slower = _stretches(together, np.maximum(response[:-1], response[1:]))
    appears = np.flatnonzero(covered & ~np.append(False, together))
    sights = list(zip(t[appears].tolist(), t[appears].tolist(), response[appears].tolist(), strict=True))
    sights += zip(t[first].tolist(), t[last].tolist(), slower.tolist(), strict=True)
    x, found = interval.start, False
    for start, end, delay in sorted(sights):
        if end < x:
            continue
        if found and x >= interval.end:
            break
        if start > x:
            yield _Range(x, min(start, interval.end), seen=False, noticed=start + delay, response=delay)
            x = start
        if x <= interval.end:
            yield _Range(x, min(end, interval.end), seen=True, response=delay)
            x = end
        found = True
    if x < interval.end or not found:
        yield _Range(x, interval.end, seen=False, noticed=total, ever=False)


def _stretches(together: Mask, response: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """The stretches of covered samples with one response: their first and last sample, and the response [s].

    together, response: of each sample and the next, shape (m - 1,).
    """
    begins = together & begins_run(np.where(together, response, np.nan))
    goes_on = np.append(together[1:] & ~begins[1:], False)
    first, last = np.flatnonzero(begins), np.flatnonzero(together & ~goes_on) + 1
    return first, last, response[first]


def _mean_end(part: _Range, recovery: Recovery, total: float) -> float:
    """Mean time at which the retry ends, over the x of one range.

    It is noticed + recovery + total; the mean is exact for a piecewise linear recovery.
    """
    if not part.seen:
        return part.noticed + float(recovery.at(np.array([part.noticed]))[0]) + total
    bends = recovery.t - part.response
    x = np.concatenate([[part.start], bends[(bends > part.start) & (bends < part.end)], [part.end]])
    ends = x + part.response + recovery.at(x + part.response) + total
    length = part.end - part.start
    return float(np.trapezoid(ends, x) / length) if length > 0.0 else float(ends[0])
