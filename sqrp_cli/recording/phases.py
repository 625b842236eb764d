"""When a gripper grasps and releases, by how far it is closed, and the phases around each grasp.

Numbers of grippers are noisy, clocks jitter, and grippers also close on nothing: a grasp is a closing from open that
stays closed for a while, and not as far as with nothing between the jaws.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.records import dataclass

SHORTEST_HOLD = 0.2
"""Shorter than this, nothing is held [s]."""
SHORTEST_PHASE = 0.5
"""A grasp begins at least this long before something is held, and a release lasts at least as long [s], where there is
time: before and after, images tell whether it worked."""
SMOOTHED = 0.1  # a running median over this time takes noise from the gripper [s]
HYSTERESIS = 0.1  # of the range of its numbers: by so much it opens beyond where it counts as closed
SHORTEST_STILL, STILL = 0.3, 0.08
"""What slips out was held if the jaws stood still before, for so long [s], within so much of the range."""
SETTLED = 0.1  # of the way between open and closed: it has arrived when no more than this is left


@dataclass(frozen=True)
class Grasp:
    """Something taken and let go; all in seconds from the start of the episode."""

    closing: float
    """When the gripper begins to close."""
    start: float
    """From when it holds."""
    end: float | None
    """When it begins to open, or shuts on nothing; None where it holds to the end."""
    opened: float
    """When it is open again, or shut; the end where it never is."""


@dataclass(frozen=True)
class Phase:
    """A part of an episode: approach, grasp, carry, release or retreat, of the n-th grasp, from 0."""

    name: str
    start: float
    end: float
    grasp: int


def find_grasps(times: Array, closed: Array, limit: float, empty: float) -> list[Grasp]:
    """The grasps of an episode, in order.

    times: shape (T,) [s]. closed: how far the gripper is open, in any unit, shape (T,): it holds, or is closed, below
    `limit`; below `empty` nothing is between its jaws.
    """
    # A running median, of an odd number of samples, and the state with hysteresis.
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    half, still = max(1, round(0.5 * SMOOTHED / step)), 1 + max(1, round(SHORTEST_STILL / step))
    padded = np.concatenate([np.full(half, closed[0]), closed, np.full(half, closed[-1])])
    s = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    opens = limit + HYSTERESIS * float(np.ptp(s))
    mark = np.where(s < limit, 1, np.where(s > opens, 0, -1))
    mark[0] = int(s[0] < limit)
    known = np.maximum.accumulate(np.where(mark >= 0, np.arange(len(mark)), 0))
    is_closed = mark[known] == 1
    edges = np.flatnonzero(np.diff(is_closed.astype(np.int8))) + 1
    if is_closed[0]:
        edges = edges[1:]  # closed from the start: nothing was taken
    found, after = list[Grasp](), 0
    for number in range(0, len(edges), 2):
        first = int(edges[number])
        last = int(edges[number + 1]) if number + 1 < len(edges) else len(s)
        following = int(edges[number + 2]) if number + 2 < len(edges) else len(s)
        held, gone = float(np.median(s[first:last])), last
        if lasting := [at for at in range(first, last - still) if (s[at : at + still] <= empty).all()]:
            # It shuts: what was held before, if it stood still then, has slipped out of it.
            gone = lasting[0]
            spans = [(float(np.ptp(s[at : at + still])), at) for at in range(first, gone - still)]
            spread, at = min(spans, default=(inf, 0))
            held = float(np.median(s[at : at + still])) if spread < STILL * float(np.ptp(s)) else -inf
        if times[gone - 1] - times[first] >= SHORTEST_HOLD and held > empty:
            open_before = float(s[after:first].max())
            near, far = (held + share * (open_before - held) for share in (SETTLED, 1.0 - SETTLED))
            closing = after + int(np.flatnonzero(s[after:first] >= far)[-1])
            start = closing + int(np.argmax(s[closing:last] <= near))
            end, opened = None, float(times[-1])
            if last < len(s):
                open_after = float(s[last:following].max())
                near, far = (held + share * (open_after - held) for share in (SETTLED, 1.0 - SETTLED))
                end = float(times[start + int(np.flatnonzero(s[start:last] <= near)[-1])])
                opened = float(times[last + int(np.argmax(s[last:following] >= far))])
            if gone < last:
                least = held - SETTLED * (held - float(s[gone]))
                end = float(times[start + int(np.flatnonzero(s[start:gone] >= least)[-1])])
                opened = float(times[gone])
            found.append(Grasp(float(times[closing]), float(times[start]), end, opened))
        after = last
    return found


def held_at(times: Array, held: Mask) -> list[Grasp]:
    """The grasps of an episode that says at each of its times whether the tool holds something from then on, (T,)."""
    edges = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0))
    found = []
    for number in range(0, len(edges), 2):
        start = float(times[edges[number]])
        end = float(times[edges[number + 1]]) if number + 1 < len(edges) else None
        found.append(Grasp(start, start, end, float(times[-1]) if end is None else end))
    return found


def phases(grasps: Sequence[Grasp], total: float) -> Iterator[Phase]:
    """The phases of an episode of `total` seconds, without gaps; without a grasp it is all approach.

    Between two grasps, half of the time is the retreat from the first, and half the approach to the second.
    """
    begin = 0.0
    for number, grasp in enumerate(grasps):
        suffix = "" if number == 0 else f"{number + 1}"
        following = grasps[number + 1].closing if number + 1 < len(grasps) else total
        ends = [max(begin, min(grasp.closing, grasp.start - SHORTEST_PHASE)), grasp.start]
        if grasp.end is None:
            ends.append(total)
        else:
            released = min(max(grasp.opened, grasp.end + SHORTEST_PHASE), following)
            last = number + 1 == len(grasps)
            ends += [grasp.end, released, total if last else 0.5 * (released + following)]
        for name, end in zip(("approach", "grasp", "carry", "release", "retreat"), ends, strict=False):
            if end > begin:
                yield Phase(f"{name}{suffix}", begin, end, number)
                begin = end
    if not grasps:
        yield Phase("approach", 0.0, total, 0)
