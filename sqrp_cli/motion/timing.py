"""Time laws along paths: jerk-limited, from rest to rest. The only module that uses ruckig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as RuckigTrajectory

from sqrp_cli.geometry import Array, Indices
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import FingerModel, RobotModel
from sqrp_cli.trajectory import JointPath, PiecewiseCubic, Trajectory, chain_rule, side_by_side

FEW_SAMPLES = (5, 5, 5, 17, 5, 5, 5)
"""Instants in each phase of a law at which limits are looked at while a law is sought."""
LEAST_SAMPLES, MORE_SAMPLES = 17, (4, 16, 16, 32, 16, 16, 4)
"""Those at which a found law is checked: in each phase, and for each coefficient of the path more where it is long."""
STRETCH_MARGIN = 1e-3  # extra stretch of a law beyond that required by its samples, for peaks between them
ROUNDS, ROUNDS_OF_SHARES = 3, 6
"""Times that the limits of a law are adapted: of all, and of its ramps alone at each of `SPEEDS`."""
SPEEDS = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25)
"""Shares of the speed that are tried where it fell below `REACHED` of the stated one; the fastest motion wins."""
REACHED = 0.95
LEAST_RATIO = 1e-9  # least ratio of a motion to its limit, so that what stands may be divided by it
_ORDERS = np.array([[1], [2], [3]])
"""Of velocity, acceleration and jerk: a law k times as slow has derivatives smaller by k to this power."""
STANDSTILL = 1e-9  # a joint line on which no joint moves further than this [rad or m] counts as no motion
SHORTEST_RAMP = 1e-7  # least share of the way on which a law accelerates; ruckig cannot resolve much less


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Upper limits of the magnitudes of velocity, acceleration and jerk: scalars, or one value per joint, shape (n,).

    Units: rad or m, and s.
    """

    velocity: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def of(cls, joints: RobotModel | FingerModel, speed: float = 1.0) -> MotionLimits:
        """Those of the joints of an arm or of fingers; speed: the share of their velocity that a move may take."""
        return cls(speed * joints.velocity, joints.acceleration, joints.jerk)

    def along(self, direction: Array) -> MotionLimits:
        """The limits that these, of shape (n,), put on the parameter of motions along `direction`, shape (..., n).

        Moving by s * direction keeps every joint's limit iff s keeps these, which have shape (...); they are infinite
        for a direction of zero.
        """
        with np.errstate(divide="ignore"):
            return MotionLimits(
                *((limit / np.abs(direction)).min(axis=-1) for limit in (self.velocity, self.acceleration, self.jerk))
            )


def rest_to_rest_duration(distance: ArrayLike, limits: MotionLimits) -> Array:
    """Shortest time [s] from rest to rest over a distance under limits of velocity, acceleration and jerk; broadcasts.

    The time-optimal law has jerk +j, 0, -j, 0, -j, 0, +j; phases vanish as the distance shrinks. With the time to
    reach a peak velocity v, `ramp` = v/j doubled while v j < a^2 and v/a + a/j from there on, a law that reaches the
    velocity limit takes distance/v + ramp(v); otherwise it takes 2 ramp with ramp * peak = distance.
    """
    distance = np.asarray(distance, dtype=float)
    v, a, j = limits.velocity, limits.acceleration, limits.jerk
    ramp = _ramp(v, a, j)
    triangle = np.where(
        distance * j * j < 2 * a**3, 4 * np.cbrt(distance / (2 * j)), a / j + np.sqrt((a / j) ** 2 + 4 * distance / a)
    )
    return np.where(distance < v * ramp, triangle, distance / v + ramp)


def _ramp(v: ArrayLike, a: ArrayLike, j: ArrayLike) -> Array:
    """Time [s] from rest to velocity v under limits of acceleration and jerk; see `rest_to_rest_duration`."""
    v, a, j = np.asarray(v), np.asarray(a), np.asarray(j)
    ramp: Array = np.where(v * j < a * a, 2 * np.sqrt(v / j), v / a + a / j)
    return ramp


def joint_move_duration(q0: Array, q1: Array, limits: MotionLimits) -> Array:
    """Duration [s] of the joint moves between q0 and q1, shapes (..., n) that broadcast, as `joint_move` makes them."""
    direction = np.abs(q1 - q0)
    moving = direction.max(axis=-1) > STANDSTILL
    shares = ((direction / limit).max(axis=-1) for limit in (limits.velocity, limits.acceleration, limits.jerk))
    along = MotionLimits(*(1.0 / np.where(moving, share, 1.0) for share in shares))
    return np.where(moving, rest_to_rest_duration(1.0, along), 0.0)


def joint_move(q0: Array, q1: Array, limits: MotionLimits) -> Trajectory:
    """The fastest motion from q0 to q1, shape (n,), on the straight line in joint space, all joints on one phase.

    The limits hold for each joint, shape (n,).
    """
    if np.abs(q1 - q0).max() <= STANDSTILL:
        return Trajectory.standstill(q1, 0.0)
    return Trajectory(JointPath.line(q0, q1), rest_to_rest(limits.along(q1 - q0)))


def rest_to_rest(limits: MotionLimits) -> PiecewiseCubic:
    """The fastest law from 0 to 1, at rest at both ends, under scalar limits.

    ruckig's tolerances are absolute, so it gets units in which acceleration takes time 1 and reaches speed 1. If that
    takes a share of the way below `SHORTEST_RAMP`, it accelerates more gently, which takes hardly longer.
    """
    duration = float(rest_to_rest_duration(1.0, limits))
    velocity, acceleration, jerk = (float(limit) for limit in (limits.velocity, limits.acceleration, limits.jerk))
    ramp = min(float(_ramp(velocity, acceleration, jerk)), 0.5 * duration)
    peak = 1.0 / (duration - ramp)
    if ramp * peak < SHORTEST_RAMP:
        ramp = SHORTEST_RAMP / peak
        acceleration, jerk = 2.0 * peak / ramp, 4.0 * peak / ramp**2
    request = InputParameter(1)
    request.target_position = [1.0 / (ramp * peak)]
    request.max_velocity = [velocity / peak]
    request.max_acceleration = [acceleration * ramp / peak]
    request.max_jerk = [jerk * ramp**2 / peak]
    solution = RuckigTrajectory(1)
    try:
        result = Ruckig(1).calculate(request, solution)
    except RuckigError:  # where all limits are reached at one instant only, rounding decides whether it finds a law
        request.max_jerk = [(1.0 - 1e-12) * request.max_jerk[0]]
        result = Ruckig(1).calculate(request, solution)
    if result != Result.Working:
        raise RuntimeError(f"ruckig finds no law for {request}: {result}")
    profile = solution.profiles[0][0]
    lasting = np.array(profile.t) > 0
    breaks = np.concatenate([[0.0], np.cumsum(profile.t)[lasting]])
    p, v, a, j = (np.array(values)[:7][lasting] for values in (profile.p, profile.v, profile.a, profile.j))
    coefficients = np.column_stack([p, v, a / 2, j / 6]) * (ramp * peak)
    return PiecewiseCubic(breaks, coefficients).stretched(ramp)


def time_paths(paths: Sequence[JointPath], limits: MotionLimits, along: MotionLimits) -> list[Trajectory]:
    """A motion along each of several paths with the same breaks, from rest to rest, that keeps every joint's limits.

    limits: of the joints, shape (n,). along: limits of the path parameter (for a tool line: those of the tool,
    divided by its length), or one of each path, shape (b,).

    The law is that of `rest_to_rest` under limits of its own, `along` or lower: where a joint's jerk or acceleration is
    too high on a ramp, the ramp gets softer; where its velocity is, or anything at full speed, the speed falls. Where
    it fell, shares of the speed are also tried with the hardest ramps that fit. The fastest law is slowed down as a
    whole by what is still too high at many samples, and by `STRETCH_MARGIN` for peaks between them.
    """
    every = np.array([along.velocity, along.acceleration, along.jerk], dtype=float).reshape(3, -1)
    timed: dict[int, Trajectory] = {}
    for rows, joined in side_by_side(paths):
        # Slopes by piece and path, then by order and joint, then by polynomial.
        p, degree = joined.coefficients.shape[:2]
        slopes = np.zeros((3, degree, p, joined.coefficients.shape[2]))
        for order in (1, 2, 3):
            derived = joined.derived(order)
            slopes[order - 1, : len(derived)] = derived * (2.0 / np.diff(joined.breaks)[:, None]) ** order
        slopes = slopes.reshape(3, degree, p, len(rows), -1).transpose(2, 3, 0, 4, 1).reshape(p, len(rows), -1, degree)
        curves, stated = (joined.breaks, slopes, limits), np.broadcast_to(every, (3, len(paths)))[:, rows]
        best = _fastest_laws(curves, stated, np.arange(len(rows)), ROUNDS)
        slow = np.flatnonzero(best[0] < REACHED * stated[0])
        for share in SPEEDS if len(slow) else ():
            shortest = rest_to_rest_duration(1.0, MotionLimits(*best))
            slower = stated * [[share], [1.0], [1.0]]
            going = slow[(rest_to_rest_duration(1.0, MotionLimits(*slower)) < shortest)[slow]]
            if len(going):
                tried = _fastest_laws(curves, slower[:, going], going, ROUNDS_OF_SHARES, ramps_alone=True)
                faster = rest_to_rest_duration(1.0, MotionLimits(*tried)) < shortest[going]
                best[:, going[faster]] = tried[:, faster]
        many = [LEAST_SAMPLES + joined.coefficients[:, :, 0].size * more for more in MORE_SAMPLES]
        excess = _ratios(curves, _sampled(best, many)[0], np.arange(len(rows))).max(axis=2)
        spare = (1.0 + STRETCH_MARGIN) ** _ORDERS
        stretches = (np.maximum(excess * spare, best / stated) ** (1 / _ORDERS)).max(axis=0)
        for row, law, stretch in zip(rows.tolist(), best.T, stretches.tolist(), strict=True):
            timed[row] = Trajectory(paths[row], rest_to_rest(MotionLimits(*law)).stretched(stretch))
    return [timed[row] for row in range(len(paths))]


def _sampled(limits: Array, counts: Sequence[int]) -> tuple[Array, Array, Array]:
    """The laws that `rest_to_rest` makes under limits, shape (3, r), at `counts` instants in each of seven phases.

    The parameter and its first three derivatives at m instants, shape (4, r, m), at both ends of a phase as seen from
    within; and the highest speed and acceleration of each law, shape (r,) each.
    """
    v, a, j = limits
    ramp = _ramp(v, a, j)
    speed = np.where(v * ramp < 1.0, v, 2.0 / rest_to_rest_duration(1.0, MotionLimits(v, a, j)))
    acceleration = np.minimum(a, np.sqrt(speed * j))
    rise = acceleration / j
    hold = np.maximum(speed / acceleration - rise, 0.0)
    cruise = np.maximum(1.0 / speed - 2.0 * rise - hold, 0.0)
    lasting = np.stack([rise, hold, rise, cruise, rise, hold, rise])
    jerks = np.multiply.outer([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0], j)
    starts = np.zeros((3, *lasting.shape))  # the parameter and its first two derivatives where each phase begins
    for k in range(6):
        t, jerk, (s, ds, dds) = lasting[k], jerks[k], starts[:, k]
        starts[:, k + 1] = (
            s + t * (ds + t * (dds / 2 + t * (jerk / 6))),
            ds + t * (dds + t * (jerk / 2)),
            dds + t * jerk,
        )
    phase = np.repeat(np.arange(7), counts)
    t = lasting.T[:, phase] * np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])
    jerk, (s, ds, dds) = jerks.T[:, phase], starts.swapaxes(1, 2)[:, :, phase]
    law = [s + t * (ds + t * (dds / 2 + t * (jerk / 6))), ds + t * (dds + t * (jerk / 2)), dds + t * jerk, jerk]
    return np.array(law), speed, acceleration


def _fastest_laws(curves: _Curves, stated: Array, rows: Indices, rounds: int, *, ramps_alone: bool = False) -> Array:
    """The limits of the fastest law that each adaptation gives, shape (3, r), so low that samples keep all limits.

    stated: limits of the parameter that are not exceeded, shape (3, r). rows: the path of each, shape (r,).
    ramps_alone: adapt the jerk alone.
    """
    limits, best, shortest = stated, stated.copy(), np.full(len(rows), np.inf)
    few = [count * len(curves[1]) for count in FEW_SAMPLES]
    cruise = slice(sum(few[:3]), sum(few[:4]))
    for _ in range(rounds):
        law, fastest, steepest = _sampled(limits, few)
        ratios = _ratios(curves, law, rows)
        highest = ratios.max(axis=2)
        fitting = limits / (np.maximum(highest, limits / stated) ** (1 / _ORDERS)).max(axis=0) ** _ORDERS
        duration = rest_to_rest_duration(1.0, MotionLimits(*fitting))
        best, shortest = np.where(duration < shortest, fitting, best), np.minimum(duration, shortest)
        if ramps_alone:
            softer = np.stack([*limits[:2], limits[2] / (highest ** [[2], [2], [1]]).max(axis=0)])
        else:
            speed = np.maximum(highest[0], (ratios[:, :, cruise].max(axis=2) ** (1 / _ORDERS)).max(axis=0))
            reached = np.where(speed > 1.0, fastest, limits[0])
            ramps = np.delete(ratios, cruise, axis=2).max(axis=2)
            softer = np.stack([reached / speed, steepest / ramps[1], limits[2] / ramps[2]])
        before, limits = limits, np.minimum(stated, softer)
        if np.array_equal(limits, before):  # as where nothing is too high
            break
    return best


_Curves = tuple[Array, Array, MotionLimits]
"""Breaks of r paths of n joints each, their slopes, (p, r, 3 n, degree), and the limits of the joints, (n,)."""


def _ratios(curves: _Curves, law: Array, rows: Indices) -> Array:
    """The largest ratio of a joint's velocity, acceleration and jerk to its limit, shape (3, r, m').

    law: of each row, as of `_sampled`, shape (4, r, m). rows: the path of each, shape (r,). At breaks of the path, both
    sides are taken in addition.
    """
    breaks, every_slope, limits = curves
    inner = breaks[1:-1]
    piece = np.searchsorted(inner, law[0], side="right")
    if len(inner):
        every = (zip(law[0], order, strict=True) for order in law)
        at_breaks = [[np.interp(inner, s, values) for s, values in pairs] for pairs in every]
        law = np.concatenate([law, at_breaks, at_breaks], axis=2)
        sides = np.concatenate([np.arange(len(inner)), np.arange(1, len(inner) + 1)])
        piece = np.concatenate([piece, np.tile(sides, (len(rows), 1))], axis=1)
    x = np.clip(2.0 * (law[0] - breaks[piece]) / np.diff(breaks)[piece] - 1.0, -1.0, 1.0)
    T = [np.ones_like(x), x]
    while len(T) < every_slope.shape[3]:
        T.append(2.0 * x * T[-1] - T[-2])
    values = np.stack(T[: every_slope.shape[3]], axis=1)
    slopes = every_slope[0][rows] @ values
    for k in range(1, len(every_slope)):
        slopes = np.where((piece == k)[:, None], every_slope[k][rows] @ values, slopes)
    # Joints along an axis before that of the instants: NumPy is several times as fast along long rows.
    by_order = slopes.reshape(len(rows), 3, -1, x.shape[1]).swapaxes(0, 1)
    motions = (np.abs(chain_rule(law[1:, :, None], by_order[: order + 1])) for order in range(3))
    of_joints = (limits.velocity, limits.acceleration, limits.jerk)
    ratios = (motion / limit[:, None] for motion, limit in zip(motions, of_joints, strict=True))
    return np.stack([ratio.max(axis=1, initial=LEAST_RATIO) for ratio in ratios])
