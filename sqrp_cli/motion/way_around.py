"""Joint moves along polylines with blended corners: around stated vias, or a sampled way around obstacles.

The only module that uses OMPL. The planner: J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to
single-query path planning, 2000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.timing import STANDSTILL, MotionLimits, joint_move, time_paths
from sqrp_cli.trajectory import JointPath, JointSpan, Trajectory

_CORNER = np.array([[-45 / 128, 1 / 2, -5 / 32, 0.0, 1 / 128], [45 / 128, 1 / 2, 5 / 32, 0.0, -1 / 128]])
"""Chebyshev coefficients of the curve around a corner: its shares of the directions before and after it."""
SPARE = 2e-3  # extra distance beyond the clearance, roughly kept by straight pieces and curves [m]; saves time
SHORTCUTS = 60  # number of random shortcuts tried on a polyline
REACHES = (1.0, 0.5, 0.25, 0.125)  # shares of the longest possible reach of a corner's curve, tried until one is free
LEAST_SCALE = 0.1  # least distance from a joint's axis that counts for the size of its motions [m]
MARGIN = np.pi  # largest motion of joints beyond both ends of a way, within their limits [rad or m]
LONGEST_EDGE = 0.6  # longest straight piece that the planner adds at once, in the units of the scaled joints [m]


def motion_through(q0: Array, vias: Array, q1: Array, limits: MotionLimits) -> Trajectory:
    """The motion from q0 to q1, shape (n,), from rest to rest, that bends without a stop around each of vias, (k, n).

    Each corner is cut by the widest curve that leaves room for its neighbours', see `blended_path`. The result depends
    only on the arguments, never on the surroundings. A corner where the one before it is counts once.
    """
    kept = [q0]
    for corner in [*vias, q1]:
        if np.abs(corner - kept[-1]).max() > STANDSTILL:
            kept.append(corner)
    if len(kept) < 3:
        return joint_move(q0, q1, limits)
    corners = np.stack([*kept[:-1], q1])
    lengths = _piece_durations(corners, limits.velocity)
    return _blended_motion(corners, lengths, _longest_reaches(lengths), limits)


def _piece_durations(corners: Array, velocity: Array) -> Array:
    """Duration of each piece at the velocity limits [s], shape (k - 1,)."""
    durations: Array = (np.abs(np.diff(corners, axis=0)) / velocity).max(axis=1)
    return durations


def _longest_reaches(lengths: Array) -> list[float]:
    """The longest reach of the curve around each inner corner; neighbours share the piece between them."""
    room = 0.5 * lengths
    room[[0, -1]] = lengths[[0, -1]]  # the ends are for one corner alone
    reaches: list[float] = np.minimum(room[:-1], room[1:]).tolist()
    return reaches


def _blended_motion(corners: Array, lengths: Array, reaches: Sequence[float], limits: MotionLimits) -> Trajectory:
    """The fastest motion, from rest to rest, along a polyline with curves at all its inner corners."""
    # A curve's slope lies between those of the pieces that it joins, so these bound all velocities.
    steepest = limits.along(np.diff(corners, axis=0) / lengths[:, None] * lengths.sum())
    slowest = MotionLimits(steepest.velocity.min(), steepest.acceleration.min(), steepest.jerk.min())
    return time_paths([blended_path(corners, lengths, reaches)], limits, slowest)[0]


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
            pieces.append(_corner_curve(corners[i + 1], slope, slopes[i + 1], around[i + 1]))
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    return JointPath(breaks / breaks[-1], np.stack(pieces))


def _corner_curve(corner: Array, before: Array, after: Array, reach: float) -> Array:
    """Chebyshev coefficients of the curve around a corner, shape (5, n); before, after: slopes, shape (n,)."""
    coefficients: Array = reach * (_CORNER[0][:, None] * before + _CORNER[1][:, None] * after)
    coefficients[0] += corner
    return coefficients


def find_way(
    scene: PlacedScene, q0: Array, q1: Array, bounds: JointSpan, limits: MotionLimits, tries: int, seed: int
) -> tuple[Trajectory | None, int]:
    """A motion from q0 to q1, shape (n,), from rest to rest, that keeps every clearance at all times.

    With it the number of straight pieces that the planner checked; no motion does not prove that there is none.
    bounds: position limits of the joints. tries: most straight pieces that the planner may check. The result depends
    only on the arguments.

    A sampled polyline is shortened at random, and its corners are blended by the widest free curves; where that is
    faster, or no curve is free, the arm stops at the corner. `PlacedScene.check_path` proves the whole result free.
    """
    checks = 0

    def is_free(first: Array, second: Array) -> bool:
        nonlocal checks
        checks += 1
        return scene.is_free(JointPath.line(first, second), SPARE)

    scale = np.maximum(scene.radii, LEAST_SCALE)
    corners = _plan_polyline(q0, q1, bounds, scale, lambda *ends: is_free(*ends) if checks < tries else None, seed)
    found_after = checks
    if corners is None:
        return None, found_after
    trajectory = _fastest(scene, _shortened(corners, limits.velocity, is_free, seed), limits)
    return (trajectory if scene.check_path(trajectory.path) is None else None), found_after


def _shortened(corners: Array, velocity: Array, is_free: Callable[[Array, Array], bool], seed: int) -> Array:
    """A polyline with the same ends and free pieces, at most as long, shape (k, n)."""

    def without_needless(corners: Array) -> Array:
        """Without corners that a straight piece can replace."""
        kept = [corners[0]]
        for before, corner in pairwise(corners[1:]):
            if not is_free(kept[-1], corner):
                kept.append(before)
        return np.stack([*kept, corners[-1]])

    rng = np.random.default_rng(seed)
    corners = without_needless(corners)
    for _ in range(SHORTCUTS):
        if len(corners) < 3:
            break
        ends = np.concatenate([[0.0], np.cumsum(_piece_durations(corners, velocity))])
        at = np.sort(rng.uniform(0.0, ends[-1], 2))
        first, last = (np.searchsorted(ends, at, side="right") - 1).clip(0, len(corners) - 2).tolist()
        if first == last:
            continue
        share = (at - ends[[first, last]]) / np.diff(ends)[[first, last]]
        cut = corners[[first, last]] + share[:, None] * (corners[[first + 1, last + 1]] - corners[[first, last]])
        shorter = np.concatenate([corners[: first + 1], cut, corners[last + 1 :]])
        if _piece_durations(shorter, velocity).sum() < ends[-1] - 1e-3 and is_free(*cut):
            corners = without_needless(shorter)
    return corners


def _fastest(scene: PlacedScene, corners: Array, limits: MotionLimits) -> Trajectory:
    """The fastest motion along a free polyline that stops at some corners and cuts the others."""
    lengths = _piece_durations(corners, limits.velocity)
    slopes, reaches = np.diff(corners, axis=0) / lengths[:, None], list[float]()
    for i, longest in enumerate(_longest_reaches(lengths)):  # 0 where no curve is free
        curves = ((s * longest, _corner_curve(corners[i + 1], slopes[i], slopes[i + 1], s * longest)) for s in REACHES)
        whole = ((reach, JointPath(np.array([0.0, 1.0]), curve[None])) for reach, curve in curves)
        reaches.append(next((reach for reach, path in whole if scene.check_path(path) is None), 0.0))

    stops, best = [0, *(i for i, reach in enumerate(reaches, 1) if reach == 0.0), len(corners) - 1], None
    for corner in range(len(corners) - 1):  # with these stops, then with each further one that makes it faster
        tried = sorted({*stops, corner})
        if best is not None and tried == stops:
            continue
        legs = (
            _blended_motion(corners[i : j + 1], lengths[i:j], reaches[i : j - 1], limits) for i, j in pairwise(tried)
        )
        motion: Trajectory = reduce(Trajectory.followed_by, legs)
        if best is None or motion.duration < best.duration:
            best, stops = motion, tried
    assert best is not None  # noqa: S101 - a polyline has two corners
    return best


def _plan_polyline(
    q0: Array, q1: Array, bounds: JointSpan, scale: Array, is_free: Callable[[Array, Array], bool | None], seed: int
) -> Array | None:
    """Corners of a free polyline from q0 to q1, shape (n,), ends included, shape (k, n).

    bounds: lower and upper limits of the joints, shape (n,) each. scale: makes joints comparable, shape (n,): distances
    are those of q * scale. is_free: of a straight piece; None once it is to be asked no more. None if no polyline was
    found by then, which does not prove that there is none. The result depends only on the arguments.
    """
    from ompl import base, geometric, util

    util.noOutputHandler()
    util.RNG.setSeed(seed + 1)  # 0 means no seed to OMPL; objects made from here on use the seed
    start, goal, n, over = q0 * scale, q1 * scale, len(q0), False
    # The box of scaled joint positions within the limits, up to a margin around start and goal, which it contains.
    low, high = np.minimum(start, goal), np.maximum(start, goal)
    low = np.minimum(np.maximum(bounds.lower * scale, low - MARGIN * scale), low)
    high = np.maximum(np.minimum(bounds.upper * scale, high + MARGIN * scale), high)
    space, box = base.RealVectorStateSpace(n), base.RealVectorBounds(n)
    for j, (least, most) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        box.setLow(j, least)
        box.setHigh(j, most)
    space.setBounds(box)

    class Validator(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, first: base.State, second: base.State) -> bool:
            nonlocal over
            found = is_free(*np.array([[state[j] for j in range(n)] for state in (first, second)]) / scale)
            over |= found is None
            return bool(found)

    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    information.setMotionValidator(Validator(information))
    information.setup()
    ends = [space.allocState(), space.allocState()]
    for state, q in zip(ends, (start, goal), strict=True):
        for j, value in enumerate(q.tolist()):
            state[j] = value
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(LONGEST_EDGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: over))
    if not problem.hasExactSolution():
        return None
    corners = np.array([[state[j] for j in range(n)] for state in problem.getSolutionPath().getStates()]) / scale
    corners[0], corners[-1] = q0, q1
    return corners
