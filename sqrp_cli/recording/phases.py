"""When a gripper grasps and releases, by how far it is closed, and the phases around each grasp.

Numbers of grippers are noisy, clocks jitter, and grippers also close on nothing: a grasp is a closing from open that
stays closed for a while, and not as far as with nothing between the jaws.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from math import inf
from typing import NamedTuple

import numpy as np

from sqrp_cli.cell.recordings import GRASP_PHASES
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.records import dataclass

SHORTEST_HOLD = 0.2  # Shorter than this, nothing is held [s]
SHORTEST_PHASE = 0.5
"""A grasp begins at least this long before something is held, and a release lasts at least as long [s], where there is
time: before and after, images tell whether it worked."""
SMOOTHED = 0.1  # a running median over this time takes noise from the gripper [s]
HYSTERESIS = 0.1  # of the way from there to wide open: by so much it opens beyond where it counts as closed
SHORTEST_STILL, STILL = 0.3, 0.08
"""What slips out was held if the jaws stood still before, for so long [s], within so much of the range."""
SETTLED = 0.1  # of the way between open and closed: it has arrived when no more than this is left


@dataclass(frozen=True)
class Grasp:
    """Something taken and let go; all in seconds from the start of the episode."""

    closing: float  # When the gripper begins to close
    start: float  # From when it holds
    end: float | None  # When it begins to open, or shuts on nothing; None where it holds to the end
    opened: float  # When it is open again, or shut; the end where it never is


class Phase(NamedTuple):
    """A part of an episode: approach, grasp, carry, release or retreat, of the n-th grasp, from 0."""

    name: str
    start: float
    end: float
    grasp: int


def find_grasps(times: Array, opening: Array, limit: float, empty: float) -> list[Grasp]:
    """The grasps of an episode, in order.

    times: shape (T,) [s]. opening: how far the gripper is open, in any unit, shape (T,): it holds, or is closed, below
    `limit`; below `empty` nothing is between its jaws.
    """
    # A running median, of an odd number of samples, and the state with hysteresis.
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    half, still = max(1, round(0.5 * SMOOTHED / step)), 1 + max(1, round(SHORTEST_STILL / step))
    padded = np.pad(opening, half, mode="edge")
    s = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    opens = limit + HYSTERESIS * max(0.0, float(s.max()) - limit)
    mark = np.where(s < limit, 1, np.where(s > opens, 0, -1))
    mark[0] = int(s[0] < limit)
    known = np.maximum.accumulate(np.where(mark >= 0, np.arange(len(mark)), 0))
    is_closed = mark[known] == 1
    edges = np.flatnonzero(np.diff(is_closed.astype(np.int8))) + 1
    if is_closed[0]:
        edges = edges[1:]  # closed from the start: nothing was taken
    found, after, bounds = list[Grasp](), 0, [*edges.tolist(), len(s), len(s)]
    for number in range(0, len(edges), 2):
        first, last, following = bounds[number : number + 3]
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
            open_at = np.flatnonzero(s[after:first] >= far)  # none where it opened further while it was closed
            closing = after + int(open_at[-1]) if len(open_at) else first
            start = closing + int(np.argmax(s[closing:last] <= near))
            end, opened = None, float(times[-1])
            if gone < last:
                least = held - SETTLED * (held - float(s[gone]))
                end = float(times[start + int(np.flatnonzero(s[start:gone] >= least)[-1])])
                opened = float(times[gone])
            elif last < len(s):
                open_after = float(s[last:following].max())
                near, far = (held + share * (open_after - held) for share in (SETTLED, 1.0 - SETTLED))
                settled = np.flatnonzero(s[start:last] <= near)
                end = float(times[start + int(settled[-1]) if len(settled) else last])
                opened = float(times[last + int(np.argmax(s[last:following] >= far))])
            found.append(Grasp(float(times[closing]), float(times[start]), end, opened))
        after = last
    return found


def held_at(times: Array, held: Mask) -> list[Grasp]:
    """The grasps of an episode that says at each of its times whether the tool holds something from then on, (T,)."""
    edges = times[np.flatnonzero(np.diff(held.astype(np.int8), prepend=0))].tolist()
    until = float(times[-1])
    return [Grasp(at, at, end, until if end is None else end) for at, end in zip_longest(edges[::2], edges[1::2])]


def phases(grasps: Sequence[Grasp], total: float) -> Iterator[Phase]:
    """The phases of an episode of `total` seconds, without gaps; without a grasp it is all approach.

    Between two grasps, half of the time is the retreat from the first, and half the approach to the second.
    """
    begin = 0.0
    for number, grasp in enumerate(grasps):
        last, suffix = number + 1 == len(grasps), f"{number + 1}" if number else ""
        ends = [max(begin, min(grasp.closing, grasp.start - SHORTEST_PHASE)), grasp.start]
        ends.append(total if grasp.end is None else grasp.end)
        if grasp.end is not None:
            following = total if last else grasps[number + 1].closing
            released = min(max(grasp.opened, grasp.end + SHORTEST_PHASE), following)
            ends += [released, total if last else 0.5 * (released + following)]
        for name, end in zip(GRASP_PHASES, ends, strict=False):
            if end > begin:
                yield Phase(f"{name}{suffix}", begin, end, number)
                begin = end
    if not grasps:
        yield Phase("approach", 0.0, total, 0)
