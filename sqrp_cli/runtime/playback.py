"""How the arm follows a step: as planned, or slowing down along the same path until it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot import JointLimits
from sqrp_cli.program import ProgramPrimitive
from sqrp_cli.trajectory import PiecewiseCubic, Trajectory

LEAST_STOP, LONGER = 0.05, 1.1
"""The first duration of a stop that is tried [s], and the factor to the next one."""

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


class Playback:
    """The reference of the arm: standing at first, then a step, then standing again where that left it.

    A stop slows time down along the path, so that the arm stays on it: the rate of the step's own clock falls from 1 to
    0 over the shortest time that keeps every joint's limit of acceleration and adds no more jerk than its limit to that
    of the motion.
    """

    def __init__(self, joints: Sequence[str], limits: Sequence[JointLimits], q: Array) -> None:
        """joints: names of the n joints with their limits; q: where they stand, shape (n,) [rad or m]."""
        self.joints = tuple(joints)
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        self._rest = np.array(q, dtype=float)
        self._primitives: tuple[ProgramPrimitive, ...] = ()
        self._start = 0.0
        self._stop: tuple[float, float] | None = None
        self._moving: list[Trajectory] = []
        self._ends: list[float] = []

    def play(self, primitives: Sequence[ProgramPrimitive], t: float) -> None:
        """Follow primitives from time t [s] on."""
        self._primitives, self._start, self._stop = tuple(primitives), t, None
        self._moving = [primitive.trajectory.trajectory for primitive in primitives]
        self._ends = [primitive.end for primitive in primitives]

    def stop(self, t: float) -> float:
        """Slow down from time t [s] on; returns when the arm stands [s]."""
        if self._stop is not None or not self._primitives:
            return t if self._stop is None else self._stop[0] + self._stop[1]
        begin = self.step_time(t)
        if begin >= self._ends[-1] or begin < 0:
            self._stop = (t, 0.0)
            return t
        duration = LEAST_STOP
        while not self._within_limits(begin, duration):
            duration *= LONGER
        self._stop = (t, duration)
        return t + duration

    def stand(self) -> None:
        """Forget the step; stay where the arm was told to be last."""
        if self._primitives:
            end = self._stop[0] + self._stop[1] if self._stop else self._start + self._ends[-1]
            self._rest = self.state(end)[0]
        self._primitives, self._stop = (), None

    def place(self, joints: Mapping[str, float]) -> None:
        """While standing, want some joints elsewhere at once: fingers, which only their motors hold back."""
        self._rest = np.array([joints.get(name, q) for name, q in zip(self.joints, self._rest, strict=True)])

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
        return q, velocity, acceleration

    def _clock(self, t: Array) -> tuple[Array, Array, Array]:
        """The step's own clock [s] at times t [s], its rate and the change of its rate [1/s], shape (m,) each."""
        if self._stop is None:
            return t - self._start, np.ones_like(t), np.zeros_like(t)
        begin, duration = self._stop
        if duration <= 0.0:
            return np.minimum(t, begin) - self._start, np.where(t <= begin, 1.0, 0.0), np.zeros_like(t)
        clock, rate, change, _ = _STOP.derivatives((t - begin) / duration)
        return np.minimum(t, begin) - self._start + duration * clock, rate, change / duration

    def _on_path(self, tau: Array, order: int) -> list[Array]:
        """Positions and their first derivatives by the step's own time [s], all in one primitive, shape (m, n) each.

        A primitive ends at rest, so later times stand still there.
        """
        index = min(int(np.searchsorted(self._ends, tau[0], side="right")), len(self._ends) - 1)
        trajectory = self._moving[index]
        local = np.clip(tau - self._primitives[index].start, 0.0, trajectory.duration)
        return [trajectory.positions(local), *(trajectory.derivatives(local, k) for k in range(1, order + 1))]

    def _within_limits(self, begin: float, duration: float) -> bool:
        """Whether a stop that begins at a time of the step's clock [s] keeps the limits."""
        clock, rate, change, second = _STOP.derivatives(np.linspace(0.0, 1.0, 33))
        _, v, a = self._on_path(begin + duration * clock, 2)
        rate, change, second = rate[:, None], change[:, None] / duration, second[:, None] / duration**2
        acceleration = a * rate**2 + v * change
        jerk = 3 * a * rate * change + v * second
        return bool(
            (np.abs(acceleration) <= LIMIT_SLACK * self._acceleration).all()
            and (np.abs(jerk) <= LIMIT_SLACK * self._jerk).all()
        )
