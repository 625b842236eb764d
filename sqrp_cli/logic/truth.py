"""Three-valued truth over time.

Times are rounded to whole nanoseconds, so that sums of them compare exactly.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from itertools import accumulate, chain

from sqrp_cli.records import dataclass


class Truth(IntEnum):
    """Kleene's three truth values, ordered so that `and` is the minimum and `or` the maximum."""

    FALSE = -1
    UNKNOWN = 0
    TRUE = 1

    def __invert__(self) -> Truth:
        """Negation; unknown stays unknown."""
        return Truth(-self)

    @property
    def word(self) -> str:
        """Its name in output about images: `true`, `false`, or `blind`."""
        return "blind" if self is Truth.UNKNOWN else self.name.lower()


def nanoseconds(seconds: float) -> int:
    """A time [s] in whole nanoseconds."""
    return round(seconds * 1e9)


@dataclass(frozen=True)
class Signal:
    """A truth value for every instant of [0, total]."""

    times: tuple[int, ...]
    """Instants at which the value may change [ns], ascending, from 0 to total."""
    values: tuple[Truth, ...]
    """Values at the first time, in the open gap after it, at the second, and so on; 2 n - 1 values for n times."""

    def at(self, time: float) -> Truth:
        """The value at a time [s] in [0, total]."""
        return self.values[self._cell(nanoseconds(time))]

    def _cell(self, time: int) -> int:
        index = bisect_right(self.times, time) - 1
        return 2 * index + (self.times[index] != time)

    def _resampled(self, times: Sequence[int]) -> list[Truth]:
        """The values at `times`, which include the signal's own, and in the gaps between them."""
        points = [self.values[self._cell(time)] for time in times]
        gaps = [self.values[2 * bisect_right(self.times, time) - 1] for time in times[:-1]]
        return [value for pair in zip(points, [*gaps, points[-1]], strict=True) for value in pair][:-1]


def step_signal(steps: Sequence[tuple[int, Truth]], end: int, total: int) -> Signal:
    """The signal that takes each value from its time [ns] on until the next one's, the last up to `end` [ns], included.

    Unknown before the first and after the end. steps: in order of time; they and the end may lie outside [0, total].
    """
    inside = sorted({0, total, *(time for time in (end, *(time for time, _ in steps)) if 0 <= time <= total)})
    starts = [time for time, _ in steps]

    def after(time: int) -> Truth:
        index = bisect_right(starts, time)
        return steps[index - 1][1] if index else Truth.UNKNOWN

    points = [after(time) if time <= end else Truth.UNKNOWN for time in inside]
    gaps = [after(time) if time < end else Truth.UNKNOWN for time in inside]
    return _simplified(inside, [value for pair in zip(points, gaps, strict=True) for value in pair][:-1])


def combine(signals: Sequence[Signal], join: Callable[[Iterable[Truth]], Truth]) -> Signal:
    """Joins the values of several signals instant by instant."""
    times = sorted(set(chain.from_iterable(signal.times for signal in signals)))
    columns = zip(*(signal._resampled(times) for signal in signals), strict=True)
    return _simplified(times, [join(column) for column in columns])


def negated(signal: Signal) -> Signal:
    """The opposite value at each instant."""
    return Signal(signal.times, tuple(~value for value in signal.values))


def always(signal: Signal, start: int, end: int) -> Signal:
    """At each instant t the least value of the signal in the part of [t + start, t + end] [ns] within [0, total].

    True where that part is empty.
    """
    total = signal.times[-1]
    shifted = (time - bound for time in signal.times for bound in (start, end))
    times = sorted({0, total, *(time for time in shifted if 0 <= time <= total)})
    count_false = [0, *accumulate(value == Truth.FALSE for value in signal.values)]
    count_unknown = [0, *accumulate(value == Truth.UNKNOWN for value in signal.values)]

    def least(first: int, last: int) -> Truth:
        if count_false[last + 1] > count_false[first]:
            return Truth.FALSE
        return Truth.UNKNOWN if count_unknown[last + 1] > count_unknown[first] else Truth.TRUE

    def at(time: int) -> Truth:
        if time + end < 0 or time + start > total:
            return Truth.TRUE
        return least(signal._cell(max(time + start, 0)), signal._cell(min(time + end, total)))

    def gap_after(time: int) -> int:
        return 2 * bisect_right(signal.times, time) - 1

    def within(left: int) -> Truth:
        """The value in the gap that begins at `left`: the window's ends stay in one cell of the signal each."""
        if left + end < 0 or left + start >= total:
            return Truth.TRUE
        first = 0 if left + start < 0 else gap_after(left + start)
        last = len(signal.values) - 1 if left + end >= total else gap_after(left + end)
        return least(first, last)

    values = [value for left in times for value in (at(left), within(left))][:-1]
    return _simplified(times, values)


def _simplified(times: Sequence[int], values: Sequence[Truth]) -> Signal:
    """The signal without the times at which nothing changes."""
    kept_times, kept_values = [times[0]], [values[0]]
    for index in range(1, len(times)):
        before, here = values[2 * index - 1], values[2 * index]
        last = index == len(times) - 1
        if last or not before == here == values[2 * index + 1]:
            kept_times.append(times[index])
            kept_values += [before, here]
    return Signal(tuple(kept_times), tuple(kept_values))
