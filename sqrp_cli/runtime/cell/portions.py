"""How a motion reaches a robot: in portions that each end in standing still, so that silence stops it.

Every `EVERY` seconds, and at once when the wanted motion changes, a new trajectory replaces the one before. It follows
the motion for `AHEAD` seconds and ends in a protective stop along the same path. Whoever sends it may be killed, cut
off or hang: the controller then plays what it has, which brakes within its last part and holds where it ends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.runtime.cell.interface import JointStates, StoppableReference

AHEAD = 0.4
"""How much of the motion a portion holds before its stop [s]."""

EVERY = 0.08
"""Time between two portions [s]."""

LEAD = 0.02
"""From when a portion is sent to its first point [s]; until then the controller leads over from what it does."""

SPACING = 0.02
"""Between two points [s]; with their velocities and accelerations a controller follows the path to micrometres."""


class Portion(NamedTuple):
    """Points of a trajectory, the last one at rest."""

    times: Array
    """From when it is sent, which is when it begins [s], rising, shape (m,)."""
    states: JointStates
    """At these times, shape (m, n) each."""


class Portions:
    """Sends a motion in portions."""

    def __init__(self, send: Callable[[Portion], None]) -> None:
        self._send = send
        self._revision: int | None = None
        self._next = -float("inf")
        self._brakes_at = float("inf")

    def follow(self, reference: StoppableReference, now: float) -> None:
        """Send what is due at a time [s], if anything is."""
        if reference.revision == self._revision and now < self._next:
            return
        self._revision, self._next = reference.revision, now + EVERY
        self._brakes_at = now + LEAD + AHEAD
        ends = reference.rests_at <= self._brakes_at
        if ends:
            self._next = self._brakes_at = float("inf")
        self._send(_portion(reference if ends else reference.stopped(self._brakes_at), now))

    def begin(self, reference: StoppableReference) -> None:
        """Nothing is to be sent until the reference changes: the robot stands where it begins."""
        self._revision, self._next, self._brakes_at = reference.revision, float("inf"), float("inf")

    def stop(self, reference: StoppableReference, now: float) -> float:
        """Have the robot stop at once, whatever the motion wants; returns when it stands [s]."""
        stopped = reference.stopped(now)
        self.follow(stopped, now)
        return max(now, stopped.rests_at)

    def late_by(self, now: float) -> float:
        """For how long the robot has been braking because nothing was sent [s]; 0 while all is well."""
        return max(0.0, now - self._brakes_at)


def _portion(reference: StoppableReference, now: float) -> Portion:
    """A motion from `LEAD` after a time [s] on to its end."""
    first = now + LEAD
    last = max(first, reference.rests_at)
    inner = np.arange(first, last - 0.5 * SPACING, SPACING)
    times = np.append(inner, last) if last > first else np.array([first])
    positions, velocities, accelerations = reference.states(times)
    velocities[-1] = accelerations[-1] = 0.0
    return Portion(times - now, JointStates(positions, velocities, accelerations))
