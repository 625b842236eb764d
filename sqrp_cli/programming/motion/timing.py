"""Time laws along paths: jerk-limited, from rest to rest. The only module that uses ruckig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig
from ruckig import Trajectory as RuckigTrajectory

from sqrp_cli.geometry import Array, ranges
from sqrp_cli.trajectory import JointPath, PiecewiseCubic, Trajectory, chain_rule, side_by_side

SAMPLES_PER_DEGREE, LEAST_SAMPLES = 32, 17
"""Instants at which limits are checked: along the whole path for each of its coefficients, and more in each phase."""

STRETCH_MARGIN = 1e-3
"""Extra stretch of `time_path` beyond that required by its samples, for peaks between samples."""

STANDSTILL = 1e-9
"""A joint line on which no joint moves further than this [rad or m] counts as no motion."""

SHORTEST_RAMP = 1e-7
"""Least share of the way on which a law accelerates; ruckig cannot resolve much less."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Upper limits of the magnitudes of velocity, acceleration and jerk: scalars, or one value per joint, shape (n,).

    Units: rad or m, and s.
    """

    velocity: Array
    acceleration: Array
    jerk: Array

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
    ramp = np.where(v * j < a * a, 2 * np.sqrt(v / j), v / a + a / j)
    triangle = np.where(
        distance * j * j < 2 * a**3, 4 * np.cbrt(distance / (2 * j)), a / j + np.sqrt((a / j) ** 2 + 4 * distance / a)
    )
    return np.where(distance < v * ramp, triangle, distance / v + ramp)


def _ramp(v: float, a: float, j: float) -> float:
    """Time [s] from rest to velocity v under limits of acceleration and jerk; see `rest_to_rest_duration`."""
    return 2.0 * (v / j) ** 0.5 if v * j < a * a else v / a + a / j


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
    ramp = min(_ramp(velocity, acceleration, jerk), 0.5 * duration)
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
    result = Ruckig(1).calculate(request, solution)
    if result != Result.Working:
        raise RuntimeError(f"ruckig finds no law for {request}: {result}")
    profile = solution.profiles[0][0]
    lasting = np.array(profile.t) > 0
    breaks = np.concatenate([[0.0], np.cumsum(profile.t)[lasting]])
    p, v, a, j = (np.array(values)[:7][lasting] for values in (profile.p, profile.v, profile.a, profile.j))
    coefficients = np.column_stack([p, v, a / 2, j / 6]) * (ramp * peak)
    return PiecewiseCubic(breaks, coefficients).stretched(ramp)


def time_path(path: JointPath, limits: MotionLimits, along: MotionLimits | None = None) -> Trajectory:
    """A motion along a curved path, from rest to rest, that keeps the limits of every joint, shape (n,).

    along: scalar limits of the path parameter (for a tool line: those of the tool, divided by its length). By default
    those that the joints would put on it if the path were a straight line as steep as its steepest place.

    The fastest law under `along` is slowed down as a whole by k = max(1, r_v, sqrt(r_a), cbrt(r_j)), where r are the
    largest ratios of a joint's velocity, acceleration and jerk to its limit. They are taken at the instants that
    `phase_samples` gives, and k gets a margin of `STRETCH_MARGIN`; where bounds of the derivatives already show that no
    limit is met, none are taken.
    """
    (trajectory,) = time_paths([path], limits, along or limits.along(path.derivative_bounds().max(axis=0)))
    return trajectory


def time_paths(paths: Sequence[JointPath], limits: MotionLimits, along: MotionLimits) -> list[Trajectory]:
    """As `time_path` of each of several paths that have the same breaks."""
    law = rest_to_rest(along)
    factors = np.ones(len(paths))
    for rows, joined in side_by_side(paths):
        factors[rows] = _stretches(Trajectory(joined, law), limits)
    return [
        Trajectory(path, law.stretched(factor) if factor > 1.0 else law)
        for path, factor in zip(paths, factors.tolist(), strict=True)
    ]


def _stretches(trajectory: Trajectory, limits: MotionLimits) -> Array:
    """By how much b motions of n joints each, as one of b n joints, have to be slowed down, shape (b,); at least 1.

    An order of derivatives is not sampled if its bounds require no larger factor than already found.
    """
    path, law = trajectory.path, trajectory.law
    every = (limits.velocity, limits.acceleration, limits.jerk)

    def ratios(motion: Array, order: int) -> Array:
        """The largest ratio of each motion's joints to their limits, shape (1, b); of magnitudes of shape (b n,)."""
        largest: Array = (motion.reshape(-1, len(limits.velocity)) / every[order - 1]).max(axis=1)[None]
        return largest

    def factors(ratios: Array, order: int) -> Array:
        factors: Array = (ratios ** (1.0 / np.array([[order]])))[0] * (1.0 + STRETCH_MARGIN)
        return factors

    ends = np.concatenate([law.breaks[:-1], np.nextafter(law.breaks[1:], 0.0)])
    peaks = np.abs(law.derivatives(ends)[1:]).max(axis=1)
    slopes = [path.derivative_bounds(order).max(axis=0) for order in (1, 2, 3)]
    bounds = [ratios(chain_rule(peaks, slopes[:order]), order) for order in (1, 2, 3)]
    stretches = np.ones(bounds[0].shape[1])
    if max(bound.max() for bound in bounds) <= 1.0:
        return stretches
    sampled = law.derivatives(phase_samples(trajectory, LEAST_SAMPLES, SAMPLES_PER_DEGREE * path.coefficients.shape[1]))
    slopes = [path.derivatives(sampled[0], order) for order in (1, 2, 3)]
    for order in (3, 2, 1):
        if (factors(bounds[order - 1], order) > stretches).any():
            motion = np.abs(chain_rule(sampled[1:, :, None], slopes[:order])).max(axis=0)
            stretches = np.maximum(stretches, factors(ratios(motion, order), order))
    return stretches


def phase_samples(trajectory: Trajectory, least: int, whole: int = 0) -> Array:
    """Instants [s] in each phase of a trajectory, both its ends included as seen from within, shape (m,).

    A phase lasts from one break of law or path to the next. Each gets `least` of them, 2 or more, and its share of
    another `whole`, by how much of the path it covers.
    """
    law, breaks = trajectory.law, trajectory.law.breaks
    if joints := [law.time_at(s) for s in trajectory.path.breaks[1:-1]]:
        breaks = np.unique(np.concatenate([breaks, joints]))
    counts = least + np.ceil(whole * np.diff(law.positions(breaks))).astype(int)
    starts, ends = breaks[:-1], np.nextafter(breaks[1:], 0.0)
    phase, number = ranges(np.zeros(len(counts)), counts)
    instants: Array = number * ((ends - starts) / (counts - 1))[phase] + starts[phase]
    instants[np.cumsum(counts) - 1] = ends
    return instants
