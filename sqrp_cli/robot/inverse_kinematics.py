"""Inverse kinematics: all joint positions that bring the tool frame to a pose, or why there are none.

The only module that uses EAIK, a library of closed forms: D. Ostermeier, J. Kuelz, M. Althoff, Automatic
Geometric Decomposition for Analytical Inverse Kinematics, 2025. Its solutions seed a search on the exact model, which
does not need them to be complete.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array, Mask, inverse, read_only
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import (
    FOLLOWED,
    Unreachable,
    beyond_reach,
    closest_turns,
    descend,
    halton,
    limit_excess,
    newton,
    pose_errors,
    spread_starts,
    why_unreachable,
)
from sqrp_cli.robot.robot import AXES_OF_A_POSE

SOLVED, POLISHED, NEARLY_SOLVED = 1e-11, 1e-13, 1e-6
"""Largest pose error of a solution, in m and rad (most are a thousand times better); that at which Newton's method
stops before its last step; and the largest from which it starts."""

SAME = 1e-4  # solutions that differ by no more than this in each joint, whole turns ignored, count as one [rad or m]
NEAR_SINGULAR, SINGULAR = 1e-3, 1e-6
"""Smallest singular values of the Jacobian below which neighbouring branches may merge or be curves, and below which a
solution may lie on a curve of solutions."""

STARTS, STARTS_AT_ONCE, STEPS = 512, 64, 40
"""Starting points of the search for branches of an arm with up to six joints (the results give more), and steps in
which each must lead to a solution. They are taken some at a time, until none of these leads to a further branch."""

STARTS_PER_SAMPLE, FIRST_STARTS = 64, (16, 64, STARTS)
"""Starting points for each redundancy sample of an arm with more joints, and no closed form; and those of the search
with all joints of such an arm, until there is a solution."""

GENERIC = (0.7, 0.4, 0.6, 0.5)  # positions of held joints at which an arm is asked for its closed form: no special ones
SPREAD_STARTS = 16  # positions of three joints that are tried around a branch that is close to singular
LONGEST_SLIDE, SLIDES = 0.2, 60  # longest step along a curve of solutions [rad or m], and most steps
MOST_BRANCHES = 64  # solutions after which the search stops: no arm of six joints has more than 16 isolated ones
SEED_STEPS, SEED_STARTS, SEED_SPREAD = 20, 8, 0.5
"""Steps in which an approximate solution must lead to a solution; starting points around an inexact one, and their
largest distance from it [rad]."""

REDUNDANCY_SAMPLES, MORE_REDUNDANCY_SAMPLES = 8, 32
"""Numbers of positions tried for the held joints of an arm with more than six joints.

The second number is for motions that are infeasible with the first.
"""

FIRST_HELD = (2, 6, 0, 4, 5, 1)
"""Which of the joints that turn is held: the first with which EAIK solves the arm, else the first of these.

The third swings the elbow of common seven-axis arms; where the wrist has an offset, holding the last one leaves a
closed form. The fourth is none of them: an elbow is bent by how far away the pose is.
"""

NOMINAL_ANGLE = 2e-2  # axes of a calibrated arm within this angle of an axis of its root count as parallel to it [rad]
NEAR_SEED = 2e-2
"""Largest pose error of a closed form's solution that is polished, in m and rad; calibrated arms need some."""
NOMINAL_OFFSET = 2e-3  # offsets between the axes of a calibrated arm below this count as zero [m]


def all_solutions(
    model: RobotModel, X_WT: Array, seed: int = 0, redundancy_samples: int = REDUNDANCY_SAMPLES
) -> Array | Unreachable:
    """Joint positions that bring the tool frame to X_WT, shape (4, 4), or why there are none.

    One per branch, within the joints' limits, in lexicographic order, shape (k, n), k >= 1 [rad or m]. Some may be
    within the limits again with whole turns added.
    Up to six joints: every isolated solution. Where the arm is singular and a curve of positions gives the same pose,
    its points nearest to home. At most `MOST_BRANCHES`.
    More than six joints: the branches with the redundant ones (`held_joints`) held at `redundancy_samples` positions:
    home, and positions spread over their limits that depend only on `seed`; where these give none, some solutions with
    all joints free.
    Fewer than six, or where limits are in the way: the tool's origin is there exactly, and the tool turned as far as
    the arm can turn it, which must be within the model's `angle_tolerance` of the pose; see `misses`.
    """
    if beyond_reach(model, X_WT) > 0.0:
        return why_unreachable(model, X_WT)
    redundant = len(model.arm) > AXES_OF_A_POSE
    branches = _held_branches(model, X_WT, seed, redundancy_samples) if redundant else _branches(model, X_WT)
    inside = _within_limits(model, branches)
    for starts in FIRST_STARTS if redundant or model.angle_tolerance else ():
        if len(inside):
            break
        found = branches
        if redundant:
            every = np.concatenate([model.home[None], spread_starts(model, starts)])
            found = np.concatenate([found, _solutions_from(model, X_WT, every, STEPS, limited=True)])
            inside = _within_limits(model, _distinct(model, found))
        if not len(inside) and model.angle_tolerance:
            inside = _at_limits(model, X_WT, found)
        if not redundant:
            break
    if not len(inside):
        return why_unreachable(model, X_WT, branches)
    # In lexicographic order, in which values that differ only by rounding count as equal.
    return read_only(inside[np.lexsort(np.round(inside, 6).T[::-1])])


def _held_branches(model: RobotModel, X_WT: Array, seed: int, count: int) -> Array:
    """All branches, limits ignored, with the redundant joints held at `count` positions each, shape (k, n).

    The first is home, the others are spread over the limits, in strata drawn with `seed`.
    """
    joints, held = list(held_joints(model)), np.zeros(len(model.arm), dtype=bool)
    held[joints] = True
    bounded = np.isfinite(model.lower) & np.isfinite(model.upper)
    lower, upper = (np.where(bounded, limit, model.home) for limit in (model.lower, model.upper))
    farthest = np.where(model.turns, np.pi, 1.0)
    reach = np.where(bounded, np.minimum(0.5 * (upper - lower), farthest), farthest)
    n, strata = len(held), count - 1
    first = np.random.default_rng(seed).permuted(np.tile(np.arange(strata), (n, 1)), axis=1).T
    share = (first + np.random.default_rng(seed + 1).random((strata, n))) / strata
    samples = np.concatenate([model.home[None], 0.5 * (lower + upper) + reach * (2 * share - 1)])
    seeds = np.concatenate([approximate_solutions(model, X_WT, sample[joints]) for sample in samples])
    if _solver(model, held_joints(model), GENERIC[: len(joints)]) is not None:
        near = np.abs(pose_errors(model.tool_poses(seeds), X_WT)).max(axis=1, initial=0.0) < NEAR_SEED
        solutions, errors = newton(model, X_WT, seeds[near], POLISHED, ~held)
        return _distinct(model, solutions[errors < SOLVED])[:MOST_BRANCHES]
    starts = np.tile(spread_starts(model, STARTS_PER_SAMPLE), (len(samples), 1))
    starts[:, held] = np.repeat(samples[:, held], STARTS_PER_SAMPLE, axis=0)
    found = _distinct(model, _solutions_from(model, X_WT, starts, STEPS, ~held))
    return _distinct(model, _settled(model, X_WT, found, ~held))[:MOST_BRANCHES]


@lru_cache(maxsize=8)
def held_joints(model: RobotModel) -> tuple[int, ...]:
    """Indices of the joints that are held in the search for branches, as many as there are beyond six.

    Those that slide, and one that turns, so that there is a closed form (see `FIRST_HELD`); else from the third on.
    """
    count, slides, turns = len(model.arm) - AXES_OF_A_POSE, *(np.flatnonzero(~model.turns), np.flatnonzero(model.turns))
    if count <= 0:
        return ()
    for first in FIRST_HELD if count == len(slides) + 1 else ():
        held = tuple(sorted([*slides.tolist(), int(turns[first])]))
        if _solver(model, held, GENERIC[:count]) is not None:
            return held
    return tuple(slides.tolist()) if count == len(slides) else tuple(range(FIRST_HELD[0], FIRST_HELD[0] + count))


def _at_limits(model: RobotModel, X_WT: Array, q: Array) -> Array:
    """The solutions near positions (m, n) with the joints that exceed limits at these, shape (k, n).

    The tool is where it is to be, and turned away within the model's `angle_tolerance`: a URDF that rounds a right
    angle down keeps no arm from pointing straight down.
    """
    q = closest_turns(model, q)
    solved, held = np.zeros(len(q), dtype=bool), np.zeros(q.shape, dtype=bool)
    for _ in range(q.shape[1]):
        held |= limit_excess(model, q) > 0.0
        q = np.clip(q, model.lower, model.upper)
        for mask in np.unique(held, axis=0):
            rows = (held == mask).all(axis=1)
            q[rows], errors = newton(model, X_WT, q[rows], POLISHED, ~mask)
            solved[rows] = errors < SOLVED
        if not (limit_excess(model, q)[solved] > 0.0).any():
            break
    return _within_limits(model, _distinct(model, q[solved]))


def _branches(model: RobotModel, X_WT: Array) -> Array:
    """All branches of an arm without redundant joints, limits ignored, as principal values, shape (k, n).

    EAIK's solutions are used only if there are some and none is close to singular: only then do they surely equal those
    of the search.
    """
    every = np.ones(len(model.arm), dtype=bool)
    seeds = approximate_solutions(model, X_WT)
    if len(seeds):
        errors = pose_errors(model.tool_poses(seeds), X_WT)
        if (errors**2).sum(axis=1).max() <= FOLLOWED:
            solutions, left = newton(model, X_WT, seeds, POLISHED)
            found = _distinct(model, solutions[left < SOLVED])
        else:
            # Seeds of a large error are EAIK's least-squares results. Their branch may have no solution here, but may
            # also be singular, and they may lie where the error has no gradient: points around them are tried, too.
            rough = np.abs(errors).max(axis=1) > NEARLY_SOLVED
            around = SEED_SPREAD * (2 * halton(SEED_STARTS, len(model.arm)) - 1)
            starts = np.concatenate([seeds, *(seed + around for seed in seeds[rough])])
            found = _distinct(model, _solutions_from(model, X_WT, starts, SEED_STEPS))
        if len(found) and _smallest_singular_values(model, found, every).min() > NEAR_SINGULAR:
            return found
    spread, found = spread_starts(model, STARTS), np.empty((0, len(model.arm)))
    for first in range(0, STARTS, STARTS_AT_ONCE):
        before, starts = len(found), spread[first : first + STARTS_AT_ONCE]
        while len(starts):
            more, known = _distinct(model, _solutions_from(model, X_WT, starts, STEPS)), len(found)
            found = _distinct(model, np.concatenate([found, _settled(model, X_WT, more, every)]))[:MOST_BRANCHES]
            starts = _variations(model, found[known:])
        if len(found) and len(found) == before:
            break
    return found


def _solutions_from(
    model: RobotModel, X_WT: Array, starts: Array, steps: int, moving: Mask | None = None, *, limited: bool = False
) -> Array:
    """The solutions that the search finds from starting points (m, n), possibly repeated, (k, n); see `descend`."""
    reached, errors = descend(model, X_WT, starts, steps, moving=moving, limited=limited)
    near = max(NEARLY_SOLVED, 2.0 * model.angle_tolerance)
    solutions, left = newton(model, X_WT, reached[np.abs(errors).max(axis=1) < near], POLISHED, moving)
    return solutions[left < SOLVED]


def _variations(model: RobotModel, q: Array) -> Array:
    """Starting points likely to lead from branches q (m, n) to others.

    One or two turning joints are reversed or turned by half. Near a singularity, where branches attract only close
    starts, three consecutive turning joints also take `SPREAD_STARTS` positions: many branches share the others.
    """
    joints = np.flatnonzero(model.turns).tolist()
    variations = [q[:0]]
    for chosen in [*combinations(joints, 1), *combinations(joints, 2)]:
        reversed_q, turned_q = q.copy(), q.copy()
        reversed_q[:, chosen] *= -1.0
        turned_q[:, chosen] += np.pi
        variations += [reversed_q, turned_q]
    near = q[_smallest_singular_values(model, q, np.ones(len(model.arm), dtype=bool)) < NEAR_SINGULAR]
    for first in range(len(joints) - 2):
        spread = np.repeat(near, SPREAD_STARTS, axis=0)
        spread[:, joints[first : first + 3]] += np.tile(2 * np.pi * halton(SPREAD_STARTS, 3), (len(near), 1))
        variations.append(spread)
    return np.concatenate(variations)


def _settled(model: RobotModel, X_WT: Array, q: Array, moving: Mask) -> Array:
    """The solutions q (m, n); those on curves of solutions move along the curve to its point nearest to home.

    Each step goes along the curve's tangent, the null space of the Jacobian, and Newton's method returns to the curve;
    steps are halved when they reverse. An isolated singular solution has no curve and stays.
    """
    settled: Array = q.copy()
    rows = np.flatnonzero(_smallest_singular_values(model, q, moving) < SINGULAR)
    longest = np.full(len(rows), LONGEST_SLIDE)
    previous = np.zeros((len(rows), q.shape[1]))
    for _ in range(SLIDES):
        if not len(rows):
            break
        points = settled[rows]
        tangents = np.zeros_like(points)
        tangents[:, moving] = np.linalg.svd(model.tool_poses_and_jacobians(points)[1][:, :, moving])[2][:, -1]
        slides = (tangents * _principal(model.home - points, model.turns)).sum(axis=1, keepdims=True) * tangents
        length = np.linalg.norm(slides, axis=1)
        longest = np.where((slides * previous).sum(axis=1) < 0.0, 0.5 * np.minimum(longest, length), longest)
        steps = slides * np.minimum(1.0, longest / np.maximum(length, 1e-12))[:, None]
        reached, left = newton(model, X_WT, points + steps, POLISHED, moving)
        went = ((reached - points) * steps).sum(axis=1) > 0.5 * (steps**2).sum(axis=1)
        going = (left < SOLVED) & went & (np.linalg.norm(steps, axis=1) > 1e-9)
        settled[rows[going]] = reached[going]
        rows, longest, previous = rows[going], longest[going], steps[going]
    return settled


def _smallest_singular_values(model: RobotModel, q: Array, moving: Mask) -> Array:
    J = model.tool_poses_and_jacobians(q)[1][:, :, moving]
    return np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1], dtype=float)


def _principal(q: Array, turns: Mask) -> Array:
    """Positions with turning joints in (-pi, pi], up to rounding: -pi counts as pi."""
    return np.where(turns, np.pi - np.mod(np.pi + 1e-9 - q, 2 * np.pi) + 1e-9, q)


def _distinct(model: RobotModel, q: Array) -> Array:
    """Principal values of positions (m, n), each once, in the order of their first appearance."""
    q = _principal(q, model.turns)
    # Only those are compared whose sums are near: no pairs of thousands.
    sums = np.where(model.turns, np.sin(q), q).sum(axis=1)
    order = np.argsort(sums, kind="stable")
    near = np.searchsorted(sums[order], sums[order] + q.shape[1] * SAME, side="right") - np.arange(len(q)) - 1
    ahead = np.arange(near.sum()) - np.repeat(np.cumsum(near) - near, near) + 1
    place = np.repeat(np.arange(len(q)), near)
    pairs = np.sort(np.column_stack([order[place], order[place + ahead]]), axis=1)
    apart = np.abs(_principal(q[pairs[:, 0]] - q[pairs[:, 1]], model.turns)).max(axis=1, initial=0.0)
    again: set[int] = set()
    for first, other in sorted(pairs[apart <= SAME].tolist()):
        again |= set() if first in again else {other}
    return np.delete(q, list(again), axis=0)


def _within_limits(model: RobotModel, q: Array) -> Array:
    """The branches that whole turns can bring within the limits, after these turns; unchanged if already within."""
    turned = closest_turns(model, q)
    turned = turned[limit_excess(model, turned).max(axis=1, initial=0.0) <= SOLVED]
    inside: Array = np.clip(turned, model.lower, model.upper)
    return inside


def approximate_solutions(model: RobotModel, X_WT: Array, positions: Array | None = None) -> Array:
    """Joint positions near the solutions for a tool pose X_WT (4, 4), shape (k, n); some are near none.

    positions: of the `held_joints`, shape (h,). Empty if EAIK cannot decompose the arm: it needs six independent joints
    that turn, besides those.
    """
    held, values = held_joints(model), () if positions is None else tuple(positions.tolist())
    solver = _solver(model, held, values)
    if solver is None:
        return np.empty((0, len(model.arm)))
    closed_form, X_BW, X_TE = solver
    found = np.array(closed_form(X_BW @ X_WT @ X_TE).Q).reshape(-1, int(model.turns.sum()))
    q = np.empty((len(found), len(model.arm)))
    q[:, model.turns] = found
    q[:, held] = values
    return q


@lru_cache(maxsize=64)
def _solver(
    model: RobotModel, held: tuple[int, ...], values: tuple[float, ...]
) -> tuple[Callable[[Array], Any], Array, Array] | None:
    """The closed form of the arm with some joints held, or else of the nominal arm that it was calibrated from.

    With the pose of the world in the arm's root frame, and what turns the tool frame into EAIK's, (4, 4) each.
    """
    from eaik.IK_HP import HPRobot

    free = np.delete(np.arange(len(model.arm)), held)
    if len(free) != AXES_OF_A_POSE or not model.turns[free].all() or not model.joints_move_alone:
        return None
    zero = np.zeros(len(model.arm))
    zero[list(held)] = np.where(model.turns[list(held)], 0.0, values)
    X_BW = inverse(model.link_poses(zero[None])[model.links[0]][0])
    X_BT = X_BW @ model.tool_pose(zero)
    linear, directions = (
        (X_BW[:3, :3] @ rows[:, model.turns]).T
        for rows in np.split(model.tool_poses_and_jacobians(zero[None])[1][0], 2)
    )
    points = X_BT[:3, 3] + np.cross(directions, linear)
    offsets = np.diff(np.concatenate([np.zeros((1, 3)), points, X_BT[None, :3, 3]]), axis=0)
    X_TE = np.eye(4)
    X_TE[:3, :3] = X_BT[:3, :3].T
    along = np.abs(directions).max(axis=1, keepdims=True) > np.cos(NOMINAL_ANGLE)
    nominal_directions = np.where(along, np.round(directions), directions)
    nominal_offsets = np.where(np.abs(offsets) < NOMINAL_OFFSET, 0.0, offsets)
    turning = np.cumsum(model.turns) - 1
    fixed = [(int(turning[joint]), value) for joint, value in zip(held, values, strict=True) if model.turns[joint]]
    for axes in ((directions, offsets), (nominal_directions, nominal_offsets)):
        with suppress(RuntimeError):  # it takes some axes that are nearly parallel for ones that meet
            decomposition = HPRobot(*axes, fixed)
            if decomposition.hasKnownDecomposition():
                return decomposition.IK, X_BW, X_TE
    return None
