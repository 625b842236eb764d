"""What a joint trajectory controller makes of trajectories: the reference of a simulated arm.

As joint_trajectory_controller of ros2_control: a new trajectory replaces the one before at once, the way from where the
arm is then wanted leads to its first point, and the arm holds where the last point is. Between points, positions alone
give lines, with velocities cubics, with accelerations quintics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sqrp_cli.errors import SqrpError
from sqrp_cli.geometry import Array
from sqrp_cli.ros.messages import Message, nanoseconds
from sqrp_cli.runtime.cell.interface import JointStates

MOST = 1e4
"""No joint goes so far [rad or m], or moves so [per s, per s^2]."""


class RefusedTrajectory(SqrpError):  # noqa: N818 - it is an answer
    """A trajectory that no controller would follow; the message says why."""


class FollowedTrajectory:
    """The reference of an arm that stands at first."""

    def __init__(self, names: Mapping[str, str], at: Mapping[str, float], fixed: Mapping[str, float]) -> None:
        """names: of the joints, by those in messages. at: where they stand. fixed: other joints, which stay there."""
        self._names = dict(names)
        self.joints: Sequence[str] = (*names.values(), *fixed)
        self._fixed = np.array(list(fixed.values()), dtype=float)
        q = np.array([[at[name] for name in names.values()]])
        self._times = np.zeros(1)
        self._points = JointStates(q, np.zeros_like(q), np.zeros_like(q))
        self._order = 5

    def replace(self, message: Message, t: float, start: float | None) -> float:
        """Follow another trajectory from time t [s] on; returns when it ends. Raises RefusedTrajectory.

        start: what its times count from [s], None: from now on.
        """
        points = self._ordered(message)
        times = np.array([nanoseconds(point.time_from_start) * 1e-9 for point in message.points])
        start = t if start is None else start
        if (np.diff(times) <= 0).any() or times[0] < 0:
            raise RefusedTrajectory("the times of its points do not rise")
        wanted = self.states(np.array([t]))
        first = message.points[0]
        self._order = 1 if not len(first.velocities) else 3 if not len(first.accelerations) else 5
        count = len(self._names)
        before = JointStates(*(values[:, :count] for values in wanted))
        later = start + times > t
        self._times = np.concatenate([[t], (start + times)[later]])
        self._points = JointStates(*(np.concatenate([a, b[later]]) for a, b in zip(before, points, strict=True)))
        return float(self._times[-1])

    @property
    def ends(self) -> float:
        """When its last point is reached [s]."""
        return float(self._times[-1])

    def moves_from(self, message: Message) -> bool:
        """Whether a trajectory leads away from where the arm is wanted."""
        points = self._ordered(message)
        return bool((np.abs(points.positions - self._points.positions[-1]) > 1e-9).any())

    def states(self, t: Array) -> JointStates:
        """As `ArmReference` says."""
        last = len(self._times) - 1
        piece = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, last)
        following = np.minimum(piece + 1, last)
        span = np.maximum(self._times[following] - self._times[piece], 1e-9)[:, None]
        u = np.clip((t - self._times[piece])[:, None], 0.0, span)
        begin, end = (JointStates(*(values[i] for values in self._points)) for i in (piece, following))
        found = between(begin, end, u, span, self._order)
        held = (piece == following)[:, None]
        still = np.zeros_like(end.positions)
        moved = [np.where(held, rest, one) for one, rest in zip(found, (end.positions, still, still), strict=True)]
        fixed = np.tile(self._fixed, (len(t), 1))
        return JointStates(*(np.hstack([a, b]) for a, b in zip(moved, (fixed, 0 * fixed, 0 * fixed), strict=True)))

    def _ordered(self, message: Message) -> JointStates:
        """Positions, velocities and accelerations, with the joints in our order. Raises RefusedTrajectory."""
        if sorted(message.joint_names) != sorted(self._names):
            raise RefusedTrajectory(
                f"its joints are {', '.join(message.joint_names)}; expected {', '.join(self._names)}"
            )
        if not message.points:
            raise RefusedTrajectory("it has no points")
        order = [list(message.joint_names).index(name) for name in self._names]
        rows = []
        for kind in ("positions", "velocities", "accelerations"):
            values = [getattr(point, kind) for point in message.points]
            if any(len(one) not in ((len(order),) if kind == "positions" else (0, len(order))) for one in values):
                raise RefusedTrajectory(f"its points have not one of the {kind} for each joint")
            rows.append(np.array([one[order] if len(one) else np.zeros(len(order)) for one in values]))
        if not all((np.abs(row) < MOST).all() for row in rows):
            raise RefusedTrajectory("it holds values that no joint can have")
        return JointStates(*rows)


def between(begin: JointStates, end: JointStates, u: Array, span: Array, order: int) -> JointStates:
    """The states a time u after the beginning of a span [s], (m, 1) each: the polynomial of an order that fits both."""
    q0, v0, a0 = begin
    q1, v1, a1 = end
    x = u / span
    if order == 1:
        return JointStates(q0 + (q1 - q0) * x, (q1 - q0) / span + 0 * x, 0 * q0 * x)
    if order == 3:
        c2, c3 = 3 * (q1 - q0) - span * (2 * v0 + v1), 2 * (q0 - q1) + span * (v0 + v1)
        c4 = c5 = np.zeros_like(c2)
    else:
        c2 = 0.5 * a0 * span**2
        c3 = 10 * (q1 - q0) - span * (6 * v0 + 4 * v1) - span**2 * (1.5 * a0 - 0.5 * a1)
        c4 = -15 * (q1 - q0) + span * (8 * v0 + 7 * v1) + span**2 * (1.5 * a0 - a1)
        c5 = 6 * (q1 - q0) - 3 * span * (v0 + v1) - 0.5 * span**2 * (a0 - a1)
    c1 = v0 * span
    return JointStates(
        q0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))),
        (c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / span,
        (2 * c2 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))) / span**2,
    )
