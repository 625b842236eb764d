"""A joint move around obstacles of the direct one: sampled, shortened, with blended corners.

The only module that uses OMPL. The planner: J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to
single-query path planning, 2000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.motion.collision.placed_scene import PlacedScene
from sqrp_cli.programming.motion.timing import MotionLimits, time_path
from sqrp_cli.trajectory import JointPath, JointSpan, PiecewiseCubic, Trajectory

SPARE = 2e-3
"""Extra distance beyond the clearance, roughly kept by straight pieces and curves [m]; saves time."""

SHORTCUTS = 60
"""Number of random shortcuts tried on a polyline."""

REACHES = (1.0, 0.5, 0.25, 0.125)
"""Shares of the longest possible reach of a corner's curve, tried until one is free."""

SPEEDS = (1.0, 0.8, 0.6, 0.4, 0.25)
"""Shares of the velocity limits tried along a curved path; the fastest motion wins."""

LEAST_SCALE = 0.1
"""Least distance from a joint's axis that counts for the size of its motions [m]."""

_LEAVING = np.array([45 / 128, 1 / 2, 5 / 32, 0.0, -1 / 128])

_ARRIVING = np.array([-45 / 128, 1 / 2, -5 / 32, 0.0, 1 / 128])
"""Chebyshev coefficients of the curve around a corner: its shares of the directions after and before it."""

MARGIN = np.pi
"""Largest motion of joints beyond both ends of a way, within their limits [rad or m]."""

LONGEST_EDGE = 0.6
"""Longest straight piece that the planner adds at once, in the units of the scaled joints [m]."""


@dataclass(frozen=True, eq=False)
class WaySearch:
    """The result of a search for a way around."""

    trajectory: Trajectory | None
    """The motion, None if none was found, which does not prove that there is none."""

    tries: int
    """Straight pieces that the planner checked."""


def find_way(
    scene: PlacedScene,
    q0: Array,
    q1: Array,
    bounds: JointSpan,
    radii: Array,
    limits: MotionLimits,
    tries: int,
    seed: int,
) -> WaySearch:
    """A motion from q0 to q1, shape (n,), from rest to rest, that keeps every clearance at all times.

    bounds: position limits of the joints. radii: sizes of the joints' motions, as of `MotionBound`. tries: most
    straight pieces that the planner may check. The result depends only on the arguments.

    A sampled polyline is shortened at random, and its corners are blended by the widest free curves; where that is
    faster, or no curve is free, the arm stops at the corner. `PlacedScene.check_path` proves the whole result free.
    """
    checks = 0

    def is_free(first: Array, second: Array) -> bool:
        nonlocal checks
        checks += 1
        return scene.is_free(JointPath.line(first, second), SPARE)

    corners = plan_polyline(q0, q1, bounds, np.maximum(radii, LEAST_SCALE), is_free, tries, seed)
    found_after = checks
    if corners is None:
        return WaySearch(None, found_after)
    trajectory = _fastest(scene, _shortened(corners, limits.velocity, is_free, seed), limits)
    return WaySearch(trajectory if scene.check_path(trajectory.path) is None else None, found_after)


def _shortened(corners: Array, velocity: Array, is_free: Callable[[Array, Array], bool], seed: int) -> Array:
    """A polyline with the same ends and free pieces, at most as long, shape (k, n)."""
    rng = np.random.default_rng(seed)
    corners = _without_needless(corners, is_free)
    for _ in range(SHORTCUTS):
        if len(corners) < 3:
            break
        ends = np.concatenate([[0.0], np.cumsum(_lengths(corners, velocity))])
        at = np.sort(rng.uniform(0.0, ends[-1], 2))
        first, last = (np.searchsorted(ends, at, side="right") - 1).clip(0, len(corners) - 2).tolist()
        if first == last:
            continue
        share = (at - ends[[first, last]]) / np.diff(ends)[[first, last]]
        cut = corners[[first, last]] + share[:, None] * (corners[[first + 1, last + 1]] - corners[[first, last]])
        shorter = np.concatenate([corners[: first + 1], cut, corners[last + 1 :]])
        if _lengths(shorter, velocity).sum() < ends[-1] - 1e-3 and is_free(*cut):
            corners = _without_needless(shorter, is_free)
    return corners


def _without_needless(corners: Array, is_free: Callable[[Array, Array], bool]) -> Array:
    """The polyline without corners that a straight piece can replace."""
    kept = [corners[0]]
    for before, corner in pairwise(range(1, len(corners))):
        if not is_free(kept[-1], corners[corner]):
            kept.append(corners[before])
    return np.stack([*kept, corners[-1]])


def _lengths(corners: Array, velocity: Array) -> Array:
    """Duration of each piece at the velocity limits [s], shape (k - 1,)."""
    lengths: Array = (np.abs(np.diff(corners, axis=0)) / velocity).max(axis=1)
    return lengths


def _fastest(scene: PlacedScene, corners: Array, limits: MotionLimits) -> Trajectory:
    """The fastest motion along a free polyline that stops at some corners and cuts the others."""
    lengths = _lengths(corners, limits.velocity)
    reaches = _free_reaches(scene, corners, lengths)
    stops = [0, *(i for i, reach in enumerate(reaches, 1) if reach == 0.0), len(corners) - 1]

    def motion(stops: Sequence[int]) -> Trajectory:
        legs = [_leg(corners[i : j + 1], lengths[i:j], reaches[i : j - 1], limits) for i, j in pairwise(stops)]
        return _joined(legs)

    best = motion(stops)
    for corner in range(1, len(corners) - 1):
        if corner not in stops:
            other = motion(sorted([*stops, corner]))
            if other.duration < best.duration:
                best, stops = other, sorted([*stops, corner])
    return best


def _free_reaches(scene: PlacedScene, corners: Array, lengths: Array) -> list[float]:
    """Reach of the curve around each inner corner, 0 where none is free; neighbours share the piece between them."""
    slopes = np.diff(corners, axis=0) / lengths[:, None]
    room = 0.5 * lengths
    room[[0, -1]] = lengths[[0, -1]]  # the ends are for one corner alone
    whole = np.array([0.0, 1.0])
    reaches = []
    for i in range(len(lengths) - 1):
        longest = float(min(room[i], room[i + 1]))
        curves = ((s * longest, corner_curve(corners[i + 1], slopes[i], slopes[i + 1], s * longest)) for s in REACHES)
        free = (reach for reach, curve in curves if scene.check_path(JointPath(whole, curve[None])) is None)
        reaches.append(next(free, 0.0))
    return reaches


def _leg(corners: Array, lengths: Array, reaches: Sequence[float], limits: MotionLimits) -> Trajectory:
    """The fastest motion, from rest to rest, along a polyline with curves at all its inner corners."""
    path = blended_path(corners, lengths, reaches)
    # A curve's slope lies between those of the pieces that it joins, so these bound all velocities.
    along = limits.along(np.diff(corners, axis=0) / lengths[:, None] * lengths.sum())
    slowest = MotionLimits(along.velocity.min(), along.acceleration.min(), along.jerk.min())
    motions = [
        time_path(path, limits, MotionLimits(share * slowest.velocity, slowest.acceleration, slowest.jerk))
        for share in (SPEEDS if len(corners) > 2 else SPEEDS[:1])
    ]
    return min(motions, key=lambda trajectory: trajectory.duration)


def _joined(legs: Sequence[Trajectory]) -> Trajectory:
    """The motions one after the other; each takes its share of the time as its share of the parameter."""
    ends = np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])])
    shares = ends / ends[-1]
    path_breaks, law_breaks = [np.zeros(1)], [np.zeros(1)]
    laws = []
    for leg, start, (low, high) in zip(legs, ends[:-1], pairwise(shares), strict=True):
        path_breaks.append(low + (high - low) * leg.path.breaks[1:])
        law_breaks.append(start + leg.law.breaks[1:])
        laws.append((high - low) * leg.law.coefficients + np.array([low, 0.0, 0.0, 0.0]))
    path_breaks[-1][-1] = 1.0
    path = JointPath(np.concatenate(path_breaks), np.concatenate([leg.path.coefficients for leg in legs]))
    return Trajectory(path, PiecewiseCubic(np.concatenate(law_breaks), np.concatenate(laws)))


def blended_path(corners: Array, lengths: Array, reaches: Sequence[float]) -> JointPath:
    """The path along a polyline that leaves each inner corner to one side.

    corners: shape (k, n), ends included. lengths: of the k - 1 pieces, in any unit of length, shape (k - 1,); the
    parameter grows evenly with it. reaches: how far before and after each inner corner its curve begins and ends, in
    that unit, above 0, shape (k - 2,). Those of neighbouring corners together are at most as long as the piece between.

    With a and b the directions before and after the corner c, the curve is the Bezier polynomial with the control
    points c - r a, c - r a / 2, c, c + r b / 2, c + r b: its ends join the straight pieces in slope and, without
    curvature there, in the second derivative. It stays in the triangle of the corner and its ends.
    """
    slopes = np.diff(corners, axis=0) / lengths[:, None]
    around = np.array([0.0, *reaches, 0.0])
    widths: list[float] = []
    pieces: list[Array] = []
    for i, slope in enumerate(slopes):
        straight = float(lengths[i] - around[i] - around[i + 1])
        if straight > 1e-9 * lengths[i]:
            middle = corners[i] + slope * (around[i] + 0.5 * straight)
            widths.append(straight)
            pieces.append(np.stack([middle, 0.5 * straight * slope, *np.zeros((3, len(slope)))]))
        if i < len(reaches):
            widths.append(2 * around[i + 1])
            pieces.append(corner_curve(corners[i + 1], slope, slopes[i + 1], around[i + 1]))
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks /= breaks[-1]
    return JointPath(breaks, np.stack(pieces))


def corner_curve(corner: Array, before: Array, after: Array, reach: float) -> Array:
    """Chebyshev coefficients of the curve around a corner, shape (5, n); before, after: slopes, shape (n,)."""
    coefficients = reach * (_ARRIVING[:, None] * before + _LEAVING[:, None] * after)
    coefficients[0] += corner
    return coefficients


def plan_polyline(
    q0: Array,
    q1: Array,
    bounds: JointSpan,
    scale: Array,
    is_free: Callable[[Array, Array], bool],
    tries: int,
    seed: int,
) -> Array | None:
    """Corners of a free polyline from q0 to q1, shape (n,), ends included, shape (k, n).

    bounds: lower and upper limits of the joints, shape (n,) each. scale: makes joints comparable, shape (n,): distances
    are those of q * scale. is_free: whether the straight line between two joint positions is free; it is called at most
    `tries` times. None if no polyline was found by then, which does not prove that there is none. The result depends
    only on the arguments.
    """
    from ompl import base, geometric, util

    util.noOutputHandler()
    util.RNG.setSeed(seed + 1)  # 0 means no seed to OMPL; objects made from here on use the seed
    checks = 0

    def counted_is_free(first: Array, second: Array) -> bool:
        nonlocal checks
        checks += 1
        return is_free(first / scale, second / scale)

    space = _space(q0 * scale, q1 * scale, bounds.lower * scale, bounds.upper * scale, MARGIN * scale)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    validator = _validator(
        information, lambda first, second: checks < tries and counted_is_free(first, second), len(q0)
    )
    information.setMotionValidator(validator)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, q0 * scale), _state(space, q1 * scale))
    planner = geometric.RRTConnect(information)
    planner.setRange(LONGEST_EDGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: checks >= tries))
    if not problem.hasExactSolution():
        return None
    corners = np.stack([_values(state, len(q0)) for state in problem.getSolutionPath().getStates()]) / scale
    corners[0], corners[-1] = q0, q1
    return corners


def _space(start: Array, goal: Array, lower: Array, upper: Array, margin: Array) -> Any:  # noqa: ANN401
    """The box of scaled joint positions within the limits, up to a margin around start and goal, which it contains."""
    from ompl import base

    low = np.minimum(np.maximum(lower, np.minimum(start, goal) - margin), np.minimum(start, goal))
    high = np.maximum(np.minimum(upper, np.maximum(start, goal) + margin), np.maximum(start, goal))
    space = base.RealVectorStateSpace(len(start))
    limits = base.RealVectorBounds(len(start))
    for j, (least, most) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        limits.setLow(j, least)
        limits.setHigh(j, most)
    space.setBounds(limits)
    return space


def _validator(information: Any, is_free: Callable[[Array, Array], bool], n: int) -> Any:  # noqa: ANN401
    """OMPL's validator of straight lines between two states of n values."""
    from ompl import base

    class Validator(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, first: base.State, second: base.State) -> bool:
            return is_free(_values(first, n), _values(second, n))

    return Validator(information)


def _state(space: Any, values: Array) -> Any:  # noqa: ANN401
    """A state of OMPL with these values, shape (n,)."""
    state = space.allocState()
    for j, value in enumerate(values.tolist()):
        state[j] = value
    return state


def _values(state: Any, n: int) -> Array:  # noqa: ANN401
    """The values of a state of OMPL, shape (n,)."""
    return np.array([state[j] for j in range(n)])
