"""How the arm follows a step: as planned, or slowing down along the same path until it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import NamedTuple, Protocol

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.program.record import ProgramPrimitive
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import JointLimits
from sqrp_cli.trajectory import PiecewiseCubic, Trajectory

LEAST_STOP, FINENESS = 0.05, 1.02
"""The shortest duration of a stop [s], and the factor to one that is too short at which the search for it ends."""
LIMIT_SLACK = 1.01  # Factor by which a stop may exceed the limits between its samples
HALT = 0.01  # In what time a guarded move comes to rest at contact [s]
JOINT_MOVE = "JointMove"
"""The action of a primitive after which the arm is where it was planned to be, whatever contact did before."""
_RAMP = 0.4  # Share of a stop in which the deceleration goes to its peak, and as much in which it falls to zero
_ON = PiecewiseCubic(np.array([0.0, 1.0]), np.array([[0.0, 1.0, 0.0, 0.0]]))  # A clock that goes on at its usual rate


class JointStates(NamedTuple):
    """Where joints are, and how they move."""

    positions: Array  # [rad or m]
    velocities: Array  # [rad/s or m/s]
    accelerations: Array  # [rad/s^2 or m/s^2]


class ArmReference(Protocol):
    """The motion that an arm is to follow."""

    joints: tuple[str, ...]
    """Names of the n joints that it moves: those of the arm, and the fingers of a gripper where it has some."""

    def states(self, t: Array) -> JointStates:
        """The joints at times t [s] of the cell's clock, (m,); shape (m, n) each."""


class ArmMotion:
    """The reference of the arm: standing at first, then following steps, and standing where each of them ends.

    A stop slows time down along the path, so that the arm stays on it: the rate of the step's own clock falls from 1 to
    0 over the shortest time that keeps every joint's limit of acceleration and adds no more jerk than its limit to that
    of the motion. Where the primitive that is under way comes to rest sooner than that, it is played to its end. A
    protective stop takes over from one within the limits of every motion, if the arm then stands sooner.
    """

    def __init__(
        self,
        joints: Sequence[str],
        limits: Sequence[JointLimits[float]],
        protective: Sequence[JointLimits[float]],
        q: Array,
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
        self._stops: list[PathStop] = []
        self._moving: list[Trajectory] = []
        self._ends: list[float] = []
        self._offsets: list[Array] = []
        self._halts: dict[int, float] = {}
        self.revision = 0
        """Another one whenever the states at any later time are others than before."""

    @property
    def rests_at(self) -> float:
        """From when on it stands if nothing more is wanted of it [s]."""
        if not self._primitives:
            return -float("inf")
        return self._stops[-1].stands if self._stops else self._start + self._ends[-1]

    def stopped(self, t: float) -> ArmMotion:
        """The same up to a time [s], from when on it stops as fast as a protective stop may."""
        other = copy(self)
        other._stops, other._offsets = [stop for stop in self._stops if stop.t < t], list(self._offsets)
        other._placed, other._halts = dict(self._placed), dict(self._halts)
        other.stop(t, protective=True)
        return other

    def play(self, primitives: Sequence[ProgramPrimitive], t: float) -> None:
        """Follow primitives from time t [s] on; what a guarded move left over is kept, as within a step."""
        left = np.zeros_like(self._rest)
        if self._primitives and primitives and self._offsets[-1].any():
            left = self.state(t)[0] - primitives[0].trajectory.positions([0.0])[0]
        self._primitives, self._start, self._stops, self._placed = tuple(primitives), t, [], {}
        self._moving = [one.trajectory if one.guard is None else one.guard.trajectory for one in primitives]
        self._ends = [primitive.end for primitive in primitives]
        self._halts, self._offsets = {}, [left]
        self._set_offsets(0)

    def force_limit(self, t: float) -> float | None:
        """What counts as contact at time t [s], in N; None unless a guarded move looks for it."""
        if not self._primitives:
            return None
        tau = self.step_time(t)
        index = self._index(tau)
        primitive = self._primitives[index]
        looks = primitive.guard is not None and index not in self._halts and primitive.start <= tau < self._ends[index]
        return primitive.guard.force if looks and primitive.guard is not None else None

    def halt_primitive(self, t: float) -> None:
        """End the motion of the guarded move that is under way at time t [s]: it met what it looked for.

        The arm stands within `HALT` seconds. What it lacks of the planned motion it goes on lacking, up to the
        next joint move, which takes it back.
        """
        tau = self.step_time(t)
        index = self._index(tau)
        self._halts[index] = tau - self._primitives[index].start
        self._set_offsets(index)

    def _index(self, tau: float) -> int:
        """Of the primitive under way at a time of the step's own clock [s], the last one after its end."""
        return max(0, min(int(np.searchsorted(self._ends, tau, side="right")), len(self._ends) - 1))

    def _set_offsets(self, first: int) -> None:
        """Compute how far each primitive from one on begins from where it was planned, and the last one ends."""
        del self._offsets[first + 1 :]
        for index in range(first, len(self._primitives)):
            primitive, offset = self._primitives[index], self._offsets[index]
            if primitive.action == JOINT_MOVE:
                offset = np.zeros_like(offset)
            elif primitive.guard is not None:
                planned = primitive.trajectory.positions([primitive.trajectory.duration])[0]
                offset = self._on_path(index, np.array([primitive.end]))[0][0] - planned
            self._offsets.append(offset)
        self.revision += 1

    def stop(self, t: float, *, protective: bool = False) -> float:
        """Slow down from time t [s] on; returns when the arm stands [s].

        protective: within the limits of a protective stop, else within those of every motion.
        """
        if not self._primitives:
            return t
        if not self._stops or (protective and not self._stops[-1].protective):
            stop = self._planned_stop(t, protective=protective)
            if stop not in self._stops:
                self._stops.append(stop)
                self.revision += 1
        return max(t, self._stops[-1].stands)

    def standing_time(self, tau: float) -> float:
        """The time of the step's own clock [s] at which the arm would stand if it began to stop at time tau [s]."""
        stop = self._planned_stop(self._start + tau, protective=False)
        return min(stop.tau + stop.duration * float(stop.law.derivatives(1.0, 0)[0]), stop.last)

    def place(self, joints: Mapping[str, float]) -> None:
        """Want some joints elsewhere at once and until the next step, such as fingers, which their motors hold back."""
        self._placed.update({self.joints.index(name): q for name, q in joints.items() if name in self.joints})
        self.revision += 1

    def step_time(self, t: float) -> float:
        """The time of the step's own clock [s] at time t [s]."""
        return float(self._clock(np.array([t]))[0][0])

    def state(self, t: float) -> JointStates:
        """The joints at time t [s], shape (n,) each."""
        return JointStates(*(values[0] for values in self.states(np.array([t]))))

    def states(self, t: Array) -> JointStates:
        """The joints at times t [s], (m,); shape (m, n) each."""
        q = np.tile(self._rest, (len(t), 1))
        velocity, acceleration = np.zeros_like(q), np.zeros_like(q)
        if self._primitives:
            tau, rate, change = self._clock(t)
            index = np.minimum(np.searchsorted(self._ends, tau, side="right"), len(self._ends) - 1)
            for primitive in np.unique(index).tolist():
                rows = index == primitive
                q[rows], velocity[rows], acceleration[rows] = self._on_path(primitive, tau[rows])
            acceleration = acceleration * rate[:, None] ** 2 + velocity * change[:, None]
            velocity = velocity * rate[:, None]
        for joint, wanted in self._placed.items():
            q[:, joint], velocity[:, joint], acceleration[:, joint] = wanted, 0.0, 0.0
        return JointStates(q, velocity, acceleration)

    def _clock(self, t: Array) -> tuple[Array, Array, Array]:
        """The step's own clock at times t [s], (m,): what it shows [s], its rate, and the change of that [1/s]."""
        tau, rate, change = t - self._start, np.ones_like(t), np.zeros_like(t)
        for stop in self._stops:
            rows = t > stop.t
            if not stop.duration:
                tau[rows], rate[rows], change[rows] = stop.tau, 1.0, 0.0
                continue
            clock, rate[rows], slower, _ = stop.law.derivatives((t[rows] - stop.t) / stop.duration)
            tau[rows], change[rows] = np.minimum(stop.tau + stop.duration * clock, stop.last), slower / stop.duration
        return tau, rate, change

    def _on_path(self, index: int, tau: Array) -> list[Array]:
        """Positions and two derivatives by the step's own time [s], all in one primitive, shape (m, n) each.

        A primitive ends at rest, so later times stand still there; a guarded move comes to rest where it was halted.
        What guarded moves left over fades in a joint move.
        """
        primitive, offset, halt = self._primitives[index], self._offsets[index], self._halts.get(index)
        local = np.clip(tau - primitive.start, 0.0, self._moving[index].duration)
        if halt is None:
            motion = self._moving[index].motion(local, 2)
        else:
            share = np.clip((local - halt) / HALT, 0.0, 1.0)
            slowed = np.where(local <= halt, local, halt + HALT * (share - share**2 / 2))
            rate = np.where(local <= halt, 1.0, 1.0 - share)[:, None]
            change = np.where((local > halt) & (share < 1.0), -1.0 / HALT, 0.0)[:, None]
            q, velocity, acceleration = self._moving[index].motion(slowed, 2)
            motion = [q, velocity * rate, acceleration * rate**2 + velocity * change]
        if not offset.any():
            return motion
        duration = primitive.trajectory.duration
        if primitive.action != JOINT_MOVE or not duration:
            return [motion[0] + offset, *motion[1:]]
        x = np.clip(local / duration, 0.0, 1.0)
        fade = [1 - x**3 * (10 - 15 * x + 6 * x**2), -30 * x**2 * (1 - x) ** 2, -60 * x * (1 - x) * (1 - 2 * x)]
        return [
            planned + one[:, None] * offset / duration**k
            for k, (planned, one) in enumerate(zip(motion, fade, strict=True))
        ]

    def _planned_stop(self, t: float, *, protective: bool) -> PathStop:
        """The stop that begins at time t [s], or the one under way where that is over sooner."""
        (tau,), (rate,), (change,) = (values.tolist() for values in self._clock(np.array([t])))
        if tau < 0.0 or tau >= self._ends[-1]:
            return PathStop(t, max(tau, 0.0), 0.0, t, max(tau, 0.0), _ON, protective)
        index = self._index(tau)
        last = self._ends[index]
        most_acceleration, most_jerk = self._protective if protective else self._limits
        # Without a stop the clock goes on as it would, to the end of the primitive.
        left = max(last - tau, 0.0)
        usual = self._stops[-1] if self._stops else PathStop(t, tau, left, t + left, last, _ON, protective)
        longest = usual.stands - t
        # The shortest duration that keeps the limits: doubled until it does, then halved in between.
        too_short, enough, duration = 0.0, np.inf, LEAST_STOP
        while enough == np.inf or (too_short > 0.0 and enough > FINENESS * too_short):
            law = slowing(rate, duration * change)
            clock, *rates = law.derivatives(np.linspace(0.0, 1.0, 65))
            _, v, a = self._on_path(index, tau + duration * clock)
            first, second, third = (one[:, None] / duration**k for k, one in enumerate(rates))
            acceleration, jerk = np.abs(a * first**2 + v * second), np.abs(3 * a * first * second + v * third)
            if (acceleration <= LIMIT_SLACK * most_acceleration).all() and (jerk <= LIMIT_SLACK * most_jerk).all():
                enough = duration
            else:
                too_short = duration
                if enough == np.inf and too_short >= longest:
                    return usual
            duration = 2.0 * too_short if enough == np.inf else 0.5 * (too_short + enough)
        if enough >= longest:
            return usual
        return PathStop(t, tau, enough, t + enough, last, slowing(rate, enough * change), protective)


@dataclass(frozen=True, eq=False)
class PathStop:
    """A stop that begins at a time t [s], when the step's own clock shows tau [s], and lasts for a duration [s]."""

    t: float
    tau: float
    duration: float
    stands: float  # When the arm stands [s]
    last: float  # What the clock never passes [s]
    law: PiecewiseCubic  # The clock, less tau, over the time since t, both as shares of the duration
    protective: bool  # Whether it may go to the limits of a protective stop


def slowing(rate: float, change: float) -> PiecewiseCubic:
    """The law of a clock that slows down to 0, with a trapezoidal deceleration that continues the present one.

    rate: at which the clock passes before, 1 where no stop has begun. change: of that rate, not above 0, over the
    whole stop. The deceleration goes from -change to the peak p at which all of the rate is lost, stays there, and
    falls to 0.
    """
    begin, ramp = -change, _RAMP
    peak = (rate - begin * ramp / 2) / (1.0 - ramp)
    second = rate - (begin + peak) * ramp / 2
    third = peak * ramp / 2
    rising = [0.0, rate, -begin / 2, -(peak - begin) / (6 * ramp)]
    after = rising[0] + ramp * (rising[1] + ramp * (rising[2] + ramp * rising[3]))
    steady = 1.0 - 2 * ramp
    later = after + steady * (second - steady * peak / 2)
    return PiecewiseCubic(
        np.array([0.0, ramp, 1.0 - ramp, 1.0]),
        np.array([rising, [after, second, -peak / 2, 0.0], [later, third, -peak / 2, peak / (6 * ramp)]]),
    )
