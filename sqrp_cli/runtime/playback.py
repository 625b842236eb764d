"""How the arm follows a step: as planned, or slowing down along the same path until it stands."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot import JointLimits, StopLimits
from sqrp_cli.program import ProgramPrimitive
from sqrp_cli.trajectory import PiecewiseCubic, Trajectory

LEAST_STOP, FINENESS = 0.05, 1.02
"""The shortest duration of a stop [s], and the factor to one that is too short at which the search for it ends."""

LIMIT_SLACK = 1.01
"""Factor by which a stop may exceed the limits between its samples."""

_RAMP = 0.4
"""Share of a stop in which the deceleration rises, and as much in which it falls."""

_PEAK = 1.0 / (1.0 - _RAMP)

_STOP = PiecewiseCubic(
    np.array([0.0, _RAMP, 1.0 - _RAMP, 1.0]),
    np.array(
        [
            [0.0, 1.0, 0.0, -_PEAK / (6 * _RAMP)],
            [_RAMP - _PEAK * _RAMP**2 / 6, 1.0 - _PEAK * _RAMP / 2, -_PEAK / 2, 0.0],
            [0.5 - _PEAK * _RAMP**2 / 6, _PEAK * _RAMP / 2, -_PEAK / 2, _PEAK / (6 * _RAMP)],
        ]
    ),
)
"""The step's own clock during a stop that lasts 1: its rate falls from 1 to 0 with a trapezoidal deceleration."""

_STOP_LENGTH = float(_STOP.derivatives(1.0)[0])
"""How far the step's own clock gets in that time."""


@dataclass(frozen=True)
class _Stop:
    """A stop that begins at a time t [s] and lasts for a duration [s]; last: time of the step's clock never passed [s].

    duration 0: the step goes on as it would, up to that time.
    """

    t: float
    duration: float
    last: float


class Playback:
    """The reference of the arm: standing at first, then following steps, and standing where each of them ends.

    A stop slows time down along the path, so that the arm stays on it: the rate of the step's own clock falls from 1 to
    0 over the shortest time that keeps every joint's limit of acceleration and adds no more jerk than its limit to that
    of the motion. Where the primitive that is under way comes to rest sooner than that, it is played to its end.
    """

    def __init__(
        self, joints: Sequence[str], limits: Sequence[JointLimits], protective: Sequence[StopLimits], q: Array
    ) -> None:
        """joints: names of the n joints, with their limits in motion and in a protective stop.

        q: where they stand, shape (n,) [rad or m].
        """
        self.joints = tuple(joints)
        self._limits = np.array([(limit.acceleration, limit.jerk) for limit in limits]).T
        self._protective = np.array([(limit.acceleration, limit.jerk) for limit in protective]).T
        self._rest = np.array(q, dtype=float)
        self._placed: dict[int, float] = {}
        self._primitives: tuple[ProgramPrimitive, ...] = ()
        self._start = 0.0
        self._stop: _Stop | None = None
        self._moving: list[Trajectory] = []
        self._ends: list[float] = []

    def play(self, primitives: Sequence[ProgramPrimitive], t: float) -> None:
        """Follow primitives from time t [s] on."""
        self._primitives, self._start, self._stop, self._placed = tuple(primitives), t, None, {}
        self._moving = [primitive.trajectory.trajectory for primitive in primitives]
        self._ends = [primitive.end for primitive in primitives]

    def stop(self, t: float, *, protective: bool = False) -> float:
        """Slow down from time t [s] on; returns when the arm stands [s].

        protective: within the limits of a protective stop, else within those of every motion.
        """
        if not self._primitives:
            return t
        if self._stop is None:
            self._stop = self._planned_stop(t, *(self._protective if protective else self._limits))
        lasts = self._stop.duration or self._start + self._stop.last - self._stop.t
        return max(t, self._stop.t + lasts)

    def standing_time(self, tau: float) -> float:
        """The time of the step's own clock [s] at which the arm would stand if it began to stop at time tau [s]."""
        stop = self._planned_stop(self._start + tau, *self._limits)
        return min(tau + _STOP_LENGTH * stop.duration, stop.last) if stop.duration else stop.last

    def place(self, joints: Mapping[str, float]) -> None:
        """Want some joints elsewhere at once and until the next step, such as fingers, which their motors hold back."""
        self._placed.update({self.joints.index(name): q for name, q in joints.items() if name in self.joints})

    def keep(self, joints: Collection[str], t: float) -> None:
        """Want some joints to stay where they are wanted at time t [s], until the next step."""
        wanted = dict(zip(self.joints, self.state(t)[0].tolist(), strict=True))
        self.place({name: wanted[name] for name in joints if name in wanted})

    def step_time(self, t: float) -> float:
        """The time of the step's own clock [s] at time t [s]."""
        return float(self._clock(np.array([t]))[0][0])

    def state(self, t: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at time t [s], shape (n,) each [rad or m, s]."""
        q, velocity, acceleration = self.states(np.array([t]))
        return q[0], velocity[0], acceleration[0]

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at times t [s], (m,); shape (m, n) each [rad or m, s]."""
        q = np.tile(self._rest, (len(t), 1))
        velocity, acceleration = np.zeros_like(q), np.zeros_like(q)
        if self._primitives:
            tau, rate, change = self._clock(t)
            index = np.minimum(np.searchsorted(self._ends, tau, side="right"), len(self._ends) - 1)
            for primitive in np.unique(index):
                rows = index == primitive
                q[rows], velocity[rows], acceleration[rows] = self._on_path(tau[rows], 2)
            acceleration = acceleration * rate[:, None] ** 2 + velocity * change[:, None]
            velocity = velocity * rate[:, None]
        for joint, wanted in self._placed.items():
            q[:, joint], velocity[:, joint], acceleration[:, joint] = wanted, 0.0, 0.0
        return q, velocity, acceleration

    def _clock(self, t: Array) -> tuple[Array, Array, Array]:
        """The step's own clock [s] at times t [s], its rate and the change of its rate [1/s], shape (m,) each."""
        if self._stop is None:
            return t - self._start, np.ones_like(t), np.zeros_like(t)
        stop = self._stop
        if not stop.duration:
            return np.minimum(t - self._start, stop.last), np.ones_like(t), np.zeros_like(t)
        clock, rate, change, _ = _STOP.derivatives((t - stop.t) / stop.duration)
        tau = np.minimum(t, stop.t) - self._start + stop.duration * clock
        return np.minimum(tau, stop.last), rate, change / stop.duration

    def _on_path(self, tau: Array, order: int) -> list[Array]:
        """Positions and their first derivatives by the step's own time [s], all in one primitive, shape (m, n) each.

        A primitive ends at rest, so later times stand still there.
        """
        index = min(int(np.searchsorted(self._ends, tau[0], side="right")), len(self._ends) - 1)
        trajectory = self._moving[index]
        local = np.clip(tau - self._primitives[index].start, 0.0, trajectory.duration)
        return trajectory.motion(local, order)

    def _planned_stop(self, t: float, acceleration: Array, jerk: Array) -> _Stop:
        """The stop that begins at time t [s], within limits of every joint, shape (n,) each."""
        begin = t - self._start
        if begin < 0.0 or begin >= self._ends[-1]:
            return _Stop(t, 0.0, max(begin, 0.0))
        last = self._ends[int(np.searchsorted(self._ends, begin, side="right"))]
        too_short, duration = 0.0, LEAST_STOP
        while not self._within_limits(begin, duration, acceleration, jerk):
            too_short, duration = duration, 2.0 * duration
            if too_short >= last - begin:
                return _Stop(t, 0.0, last)
        while duration > FINENESS * too_short and too_short > 0.0:
            between = 0.5 * (too_short + duration)
            if self._within_limits(begin, between, acceleration, jerk):
                duration = between
            else:
                too_short = between
        return _Stop(t, duration if duration < last - begin else 0.0, last)

    def _within_limits(self, begin: float, duration: float, most_acceleration: Array, most_jerk: Array) -> bool:
        """Whether a stop that begins at a time of the step's clock [s] keeps the limits."""
        clock, rate, change, second = _STOP.derivatives(np.linspace(0.0, 1.0, 65))
        _, v, a = self._on_path(begin + duration * clock, 2)
        rate, change, second = rate[:, None], change[:, None] / duration, second[:, None] / duration**2
        acceleration = a * rate**2 + v * change
        jerk = 3 * a * rate * change + v * second
        return bool(
            (np.abs(acceleration) <= LIMIT_SLACK * most_acceleration).all()
            and (np.abs(jerk) <= LIMIT_SLACK * most_jerk).all()
        )
