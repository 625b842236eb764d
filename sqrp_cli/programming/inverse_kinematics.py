"""Every way in which an arm can bring its tool frame to a pose, or why it cannot."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, read_only
from sqrp_cli.programming.analytic_ik import approximate_solutions
from sqrp_cli.programming.kinematics import RobotModel
from sqrp_cli.programming.pose_search import descend, pose_errors, spread_starts
from sqrp_cli.programming.reach import Unreachable, closest_turns, limit_excess, why_unreachable

SOLVED = 1e-11
"""Largest pose error of a solution, in m and rad; most are a thousand times better."""

POLISHED = 1e-13
"""Pose error at which Newton's method stops before its last step."""

NEWTON_STEPS = 8
"""Steps of Newton's method at most; it squares the error of an isolated solution at each."""

NEARLY_SOLVED = 1e-6
"""Largest pose error from which Newton's method starts."""

SAME = 1e-4
"""Solutions whose joints differ by no more than this, whole turns aside, are one [rad or m]."""

NEAR_SINGULAR = 1e-3
"""Smallest singular value of the Jacobian below which neighbouring branches may merge or be curves."""

SINGULAR = 1e-6
"""Smallest singular value of the Jacobian below which a solution is tried for being a point of a curve of solutions."""

STARTS = 512
"""Starting points of the search for branches of an arm with up to six joints."""

STARTS_PER_SAMPLE = 96
"""The same for each redundancy sample of an arm with more joints."""

STEPS = 40
"""Steps in which a starting point must lead to a solution."""

SEED_STEPS = 20
"""The same for an approximate solution."""

REDUNDANCY_SAMPLES = 8
"""Positions of the joints that are held still, one after the other, in an arm with more than six joints."""

FIRST_HELD = 2
"""The first of them: the third joint, the one that swings the elbow of common seven-axis arms."""


@dataclass(frozen=True, eq=False)
class IkResult:
    """Joint positions that bring the tool frame to a pose.

    solutions: one per branch, within the joints' limits, in lexicographic order, shape (k, n) [rad or m]; other whole turns of a
    joint may also be within its limits. reason: why there is none; None if there are some.
    """

    solutions: Array
    reason: Unreachable | None


def all_solutions(model: RobotModel, X_WT: Array, seed: int = 0) -> IkResult:
    """All branches that bring the tool frame to X_WT, shape (4, 4), within the joints' limits.

    Up to six joints: every isolated solution. Where the arm is singular and a whole curve of positions gives the same pose, one
    point of it: the one at which the first joint that the curve moves most is at its home position.
    More than six joints: the branches that remain when the joints from the third on, as many as there are too many, are held at
    `REDUNDANCY_SAMPLES` positions: home, and positions spread over their limits that depend on `seed` alone.
    The result does not depend on whether EAIK is installed; it only saves time, for arms with six joints.
    """
    held, samples = _redundancy(model, seed)
    branches = _branches(model, X_WT, held, samples)
    inside = _within_limits(model, branches)
    if not len(inside) and held.any():
        inside = _within_limits(model, _any_solutions(model, X_WT))
    if len(inside):
        return IkResult(read_only(_sorted(inside)), None)
    return IkResult(read_only(inside), why_unreachable(model, X_WT, branches))


def _redundancy(model: RobotModel, seed: int) -> tuple[NDArray[np.bool_], Array]:
    """Which joints are held, shape (n,), and joint positions (k, n) to hold them at; one row if none is held."""
    n = len(model.arm)
    held = np.zeros(n, dtype=bool)
    held[FIRST_HELD : FIRST_HELD + n - 6] = n > 6
    if not held.any():
        return held, model.home[None]
    middle = 0.5 * (model.lower + model.upper)
    reach = np.minimum(0.5 * (model.upper - model.lower), np.where(model.turns, np.pi, 1.0))
    middle = np.where(np.isfinite(middle), middle, model.home)
    count = REDUNDANCY_SAMPLES - 1
    strata = np.random.default_rng(seed).permuted(np.tile(np.arange(count), (n, 1)), axis=1).T
    share = (strata + np.random.default_rng(seed + 1).random((count, n))) / count
    return held, np.concatenate([model.home[None], middle + reach * (2 * share - 1)])


def _branches(model: RobotModel, X_WT: Array, held: NDArray[np.bool_], samples: Array) -> Array:
    """All branches, whatever the limits, as principal values, shape (k, n).

    EAIK's answer is taken only where it finds something and nothing near it is close to singular: there alone it is sure
    to be what the search finds.
    """
    seeds = approximate_solutions(model, X_WT)
    if len(seeds):
        found = _distinct(model, _solutions_from(model, X_WT, seeds, ~held, SEED_STEPS))
        if len(found) and _smallest_singular_values(model, found, ~held).min() > NEAR_SINGULAR:
            return found
    per_sample = STARTS_PER_SAMPLE if held.any() else STARTS
    starts = np.tile(spread_starts(model, per_sample), (len(samples), 1))
    starts[:, held] = np.repeat(samples[:, held], per_sample, axis=0)
    found = np.empty((0, len(model.arm)))
    while len(starts):
        more = _distinct(model, _solutions_from(model, X_WT, starts, ~held, STEPS))
        known = len(found)
        found = _distinct(model, np.concatenate([found, _settled(model, X_WT, more, ~held)]))
        starts = _variations(found[known:], model.turns & ~held)
    return found


def _any_solutions(model: RobotModel, X_WT: Array) -> Array:
    """Some solutions within the limits, with all joints free to move, shape (k, n)."""
    everything = np.ones(len(model.arm), dtype=bool)
    starts = np.concatenate([model.home[None], spread_starts(model, STARTS)])
    return _distinct(model, _solutions_from(model, X_WT, starts, everything, STEPS, (model.lower, model.upper)))


def _solutions_from(
    model: RobotModel,
    X_WT: Array,
    starts: Array,
    moving: NDArray[np.bool_],
    steps: int,
    within: tuple[Array, Array] | None = None,
) -> Array:
    """The solutions to which the search leads from starting points, shape (m, n), some perhaps several times, (k, n)."""
    reached, errors = descend(model, X_WT, starts, moving, steps, within=within)
    return _polished(model, X_WT, reached[np.abs(errors).max(axis=1) < NEARLY_SOLVED], moving)


def _variations(q: Array, turning: NDArray[np.bool_]) -> Array:
    """Starting points likely to lead from branches to others: one or two turning joints reversed or turned by half."""
    joints = np.flatnonzero(turning).tolist()
    variations = []
    for chosen in [*combinations(joints, 1), *combinations(joints, 2)]:
        reversed_q, turned_q = q.copy(), q.copy()
        reversed_q[:, chosen] *= -1.0
        turned_q[:, chosen] += np.pi
        variations += [reversed_q, turned_q]
    return np.concatenate(variations) if variations else q[:0]


def _polished(model: RobotModel, X_WT: Array, q: Array, moving: NDArray[np.bool_]) -> Array:
    """Those of the positions q (m, n) from which Newton's method leads to a solution, as that solution."""
    for _ in range(NEWTON_STEPS):
        if not len(q):
            return q
        X, J = model.tool_poses_and_jacobians(q)
        errors = pose_errors(X, X_WT)
        if np.abs(errors).max() < POLISHED:
            return q
        J = J * moving
        normal = np.swapaxes(J, 1, 2) @ J + 1e-13 * np.eye(q.shape[1])
        q = q + np.linalg.solve(normal, np.swapaxes(J, 1, 2) @ errors[:, :, None])[..., 0]
    errors = pose_errors(model.tool_poses_and_jacobians(q)[0], X_WT)
    solutions: Array = q[np.abs(errors).max(axis=1) < SOLVED]
    return solutions


def _settled(model: RobotModel, X_WT: Array, q: Array, moving: NDArray[np.bool_]) -> Array:
    """The solutions q (m, n) with those on curves of solutions moved along them, as `all_solutions` says.

    Each step goes along the curve's tangent, the null space of the Jacobian, and Newton's method leads back to the curve while
    the guiding joint stands. An isolated singular solution has no curve: Newton's method does not get back, it stays.
    """
    if not len(q):
        return q
    settled: Array = q.copy()
    for row in np.flatnonzero(_smallest_singular_values(model, q, moving) < SINGULAR):
        point = q[row]
        tangent = _tangent(model, point, moving)
        guide = int(np.flatnonzero(np.abs(tangent) > 0.9 * np.abs(tangent).max())[0])
        goal = point[guide] + _principal(model.home - point, model.turns)[guide]
        while point is not None and abs(goal - point[guide]) > 0.0:
            tangent = _tangent(model, point, moving)
            advance = float(np.clip(goal - point[guide], -0.2, 0.2))
            if abs(tangent[guide]) < 0.1:
                break
            ahead = point + tangent * (advance / tangent[guide])
            ahead[guide] = goal if abs(goal - point[guide]) <= 0.2 else ahead[guide]
            others = moving & (np.arange(len(point)) != guide)
            back = _polished(model, X_WT, ahead[None], others)
            if not len(back):
                break
            point = back[0]
        else:
            settled[row] = point
    return settled


def _tangent(model: RobotModel, q: Array, moving: NDArray[np.bool_]) -> Array:
    """Unit vector of joint motion that moves the tool least, shape (n,)."""
    columns = np.flatnonzero(moving)
    tangent = np.zeros(len(q))
    tangent[columns] = np.linalg.svd(model.jacobian(q)[:, columns])[2][-1]
    return tangent


def _smallest_singular_values(model: RobotModel, q: Array, moving: NDArray[np.bool_]) -> Array:
    J = model.tool_poses_and_jacobians(q)[1][:, :, moving]
    values: Array = np.linalg.svd(J, compute_uv=False)[:, -1]
    return values


def _principal(q: Array, turns: NDArray[np.bool_]) -> Array:
    """Positions with turning joints in (-pi, pi], up to rounding: -pi counts as pi."""
    wrapped: Array = np.where(turns, np.pi - np.mod(np.pi + 1e-9 - q, 2 * np.pi) + 1e-9, q)
    return wrapped


def _distinct(model: RobotModel, q: Array) -> Array:
    """Principal values of positions (m, n), each once, in the order of their first appearance."""
    q = _principal(q, model.turns)
    apart = np.abs(_principal(q[:, None] - q[None], model.turns)).max(axis=-1, initial=0.0) > SAME
    kept: list[int] = []
    for row in range(len(q)):
        if apart[row, kept].all():
            kept.append(row)
    distinct: Array = q[kept]
    return distinct


def _within_limits(model: RobotModel, q: Array) -> Array:
    """Those of the branches that whole turns can bring within the limits, brought there; unchanged where they are."""
    turned = closest_turns(model, q)
    turned = turned[limit_excess(model, turned).max(axis=1, initial=0.0) <= SOLVED]
    return np.clip(turned, model.lower, model.upper)


def _sorted(q: Array) -> Array:
    """Rows in lexicographic order; values that differ by rounding only count as equal."""
    ordered: Array = q[np.lexsort(np.round(q, 6).T[::-1])]
    return ordered
