"""A joint move around obstacles of the direct one: sampled, shortened, with blended corners.

The only module that uses OMPL. The planner: J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to
single-query path planning, 2000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.blended_path import (
    blended_motion,
    corner_curve,
    longest_reaches,
    piece_durations,
)
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.timing import MotionLimits
from sqrp_cli.records import dataclass
from sqrp_cli.trajectory import JointPath, JointSpan, Trajectory

SPARE = 2e-3
"""Extra distance beyond the clearance, roughly kept by straight pieces and curves [m]; saves time."""

SHORTCUTS = 60
"""Number of random shortcuts tried on a polyline."""

REACHES = (1.0, 0.5, 0.25, 0.125)
"""Shares of the longest possible reach of a corner's curve, tried until one is free."""

LEAST_SCALE = 0.1
"""Least distance from a joint's axis that counts for the size of its motions [m]."""

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
    is_free = _FreePieces(scene)
    corners = _plan_polyline(q0, q1, bounds, np.maximum(radii, LEAST_SCALE), is_free, tries, seed)
    found_after = is_free.checks
    if corners is None:
        return WaySearch(None, found_after)
    trajectory = _fastest(scene, _shortened(corners, limits.velocity, is_free, seed), limits)
    return WaySearch(trajectory if scene.check_path(trajectory.path) is None else None, found_after)


@dataclass(eq=False)
class _FreePieces:
    """Tells of straight pieces whether they are free."""

    scene: PlacedScene
    checks: int = 0
    """How many it was asked about."""

    def __call__(self, first: Array, second: Array) -> bool:
        self.checks += 1
        return self.scene.is_free(JointPath.line(first, second), SPARE)


def _shortened(corners: Array, velocity: Array, is_free: Callable[[Array, Array], bool], seed: int) -> Array:
    """A polyline with the same ends and free pieces, at most as long, shape (k, n)."""
    rng = np.random.default_rng(seed)
    corners = _without_needless(corners, is_free)
    for _ in range(SHORTCUTS):
        if len(corners) < 3:
            break
        ends = np.concatenate([[0.0], np.cumsum(piece_durations(corners, velocity))])
        at = np.sort(rng.uniform(0.0, ends[-1], 2))
        first, last = (np.searchsorted(ends, at, side="right") - 1).clip(0, len(corners) - 2).tolist()
        if first == last:
            continue
        share = (at - ends[[first, last]]) / np.diff(ends)[[first, last]]
        cut = corners[[first, last]] + share[:, None] * (corners[[first + 1, last + 1]] - corners[[first, last]])
        shorter = np.concatenate([corners[: first + 1], cut, corners[last + 1 :]])
        if piece_durations(shorter, velocity).sum() < ends[-1] - 1e-3 and is_free(*cut):
            corners = _without_needless(shorter, is_free)
    return corners


def _without_needless(corners: Array, is_free: Callable[[Array, Array], bool]) -> Array:
    """The polyline without corners that a straight piece can replace."""
    kept = [corners[0]]
    for before, corner in pairwise(range(1, len(corners))):
        if not is_free(kept[-1], corners[corner]):
            kept.append(corners[before])
    return np.stack([*kept, corners[-1]])


def _fastest(scene: PlacedScene, corners: Array, limits: MotionLimits) -> Trajectory:
    """The fastest motion along a free polyline that stops at some corners and cuts the others."""
    lengths = piece_durations(corners, limits.velocity)
    reaches = _free_reaches(scene, corners, lengths)
    stops = [0, *(i for i, reach in enumerate(reaches, 1) if reach == 0.0), len(corners) - 1]

    def motion(stops: Sequence[int]) -> Trajectory:
        legs = (
            blended_motion(corners[i : j + 1], lengths[i:j], reaches[i : j - 1], limits) for i, j in pairwise(stops)
        )
        return reduce(Trajectory.followed_by, legs)

    best = motion(stops)
    for corner in range(1, len(corners) - 1):
        if corner not in stops:
            other = motion(sorted([*stops, corner]))
            if other.duration < best.duration:
                best, stops = other, sorted([*stops, corner])
    return best


def _free_reaches(scene: PlacedScene, corners: Array, lengths: Array) -> list[float]:
    """Reach of the curve around each inner corner, 0 where none is free."""
    slopes = np.diff(corners, axis=0) / lengths[:, None]
    whole = np.array([0.0, 1.0])
    reaches = []
    for i, longest in enumerate(longest_reaches(lengths)):
        curves = ((s * longest, corner_curve(corners[i + 1], slopes[i], slopes[i + 1], s * longest)) for s in REACHES)
        free = (reach for reach, curve in curves if scene.check_path(JointPath(whole, curve[None])) is None)
        reaches.append(next(free, 0.0))
    return reaches


def _plan_polyline(
    q0: Array, q1: Array, bounds: JointSpan, scale: Array, is_free: _FreePieces, tries: int, seed: int
) -> Array | None:
    """Corners of a free polyline from q0 to q1, shape (n,), ends included, shape (k, n).

    bounds: lower and upper limits of the joints, shape (n,) each. scale: makes joints comparable, shape (n,): distances
    are those of q * scale. is_free: not asked before, and here at most `tries` times. None if no polyline was found by
    then, which does not prove that there is none. The result depends only on the arguments.
    """
    from ompl import base, geometric, util

    util.noOutputHandler()
    util.RNG.setSeed(seed + 1)  # 0 means no seed to OMPL; objects made from here on use the seed

    def is_free_in_time(first: Array, second: Array) -> bool:
        return is_free.checks < tries and is_free(first / scale, second / scale)

    space = _space(q0 * scale, q1 * scale, bounds.lower * scale, bounds.upper * scale, MARGIN * scale)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    information.setMotionValidator(_validator(information, is_free_in_time, len(q0)))
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, q0 * scale), _state(space, q1 * scale))
    planner = geometric.RRTConnect(information)
    planner.setRange(LONGEST_EDGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: is_free.checks >= tries))
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
