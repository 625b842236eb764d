"""Searching joint positions that bring the tool to a pose, and why an arm cannot reach one, and by how much.

The search goes from many starting points at once (Levenberg-Marquardt). The method and its damping: K. Levenberg (1944)
and D. Marquardt (1963), as in K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems,
2004, section 3.2, with a fixed schedule of the damping. A sphere that bounds the arm's outermost axis proves without a
search that places are too far.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Literal

import numpy as np

from sqrp_cli.geometry import Array, Mask, axis_rotation, inverse, pose
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.robot import AXES_OF_A_POSE

_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29)
_LEAST_DAMPING, _FIRST_DAMPING, _MOST_DAMPING = 1e-12, 0.1, 1e6
FOLLOWED = 1e-20  # square of the weighted pose error at which a start is good enough
STALLED = 1e6  # a step that reduces the square of the error by no more than one part in this is the last one
LEAST_TURN = 1e-6  # least turn of the tool per motion of the joints that counts as one that the arm can make [rad/rad]
NEWTON_STEPS = 8  # most steps of Newton's method; each squares the error of an isolated solution
TURNED = "within reach only when turned"  # how `Unreachable` begins where that helps
MET = 1e-4  # largest pose error that `may_reach` allows, in m and rad, besides the arm's tolerance of angle
TURN_STARTS, TURN_STEPS = 64, 30  # starting points and steps of the search for how an arm turns the tool at a place
STARTS = 64  # starting points of the search for the closest pose that can be reached
STAGES = ((1.0, 12, 32), (10.0, 20, 8), (100.0, 60, 8), (1000.0, 100, 8))
"""Successive weights of an error of 1 rad against one of 1 m; for each the steps, and how many of the best continue.

The last weight holds an orientation to 1e-6 rad. Most starts converge to the same few places, recognizable long before
they are reached.
"""

STEPS = 60  # steps of the search for places behind one out of reach
PLACES_BEYOND, STARTS_BEYOND = 16, 16
"""Places behind one out of reach that are tried, and starting points of the search for each."""
ROUNDS = 100  # rounds of moving the points on the axes to shorten their chain
LEAST_DISTANCE = 1e-9  # added to distances from axes, so that their shares are defined when all are zero [m]
HELD_ORIENTATION = 1e-3  # largest error of an orientation that counts as held [rad]
Approach = tuple[Array, Array]
"""Joint positions at the end of a search from each of m starts, (m, n), and the pose errors that remain."""


def pose_errors(X_WT: Array, X_target: Array) -> Array:
    """Position error [m] over rotation vector [rad] from poses to targets, in world axes, shape (m, 6).

    X_WT: shape (m, 4, 4). X_target: one pose, (4, 4), or one for each, (m, 4, 4).
    """
    errors = np.empty((len(X_WT), 6))
    errors[:, :3] = X_target[..., :3, 3] - X_WT[:, :3, 3]
    # Axis times angle [rad] of rotation matrices (m, 3, 3), shape (m, 3); for half a turn, one of both axes.
    R = X_target[..., :3, :3] @ np.swapaxes(X_WT[:, :3, :3], 1, 2)
    skew = np.empty((len(R), 3))
    for axis, (first, second) in enumerate(((2, 1), (0, 2), (1, 0))):
        np.subtract(R[:, first, second], R[:, second, first], out=skew[:, axis])
    sine, cosine = np.sqrt((skew**2).sum(axis=1)), R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0
    angle = np.arctan2(sine, cosine)
    vectors: Array = skew * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 0.5)[:, None]
    half_turned = (sine < 1e-6) & (cosine < 0.0)
    for row in np.flatnonzero(half_turned).tolist() if half_turned.any() else ():
        columns = R[row] + np.eye(3)
        along = columns[:, int(np.diag(columns).argmax())]
        vectors[row] = along * (angle[row] / np.linalg.norm(along))
    errors[:, 3:] = vectors
    return errors


def misses(model: RobotModel, q: Array, X_target: Array, moving: Mask | None = None) -> tuple[Array, Array, Array]:
    """What keeps the tool at m joint positions q, shape (m, n), from targets, one each, (m, 4, 4).

    Three arrays: what is to become 0, as of `pose_errors`, without the turns that the arm cannot make, (m, 6); how
    these errors decrease with the joints, (m, 6, n); by how much the tool is turned away beyond what is tolerated
    [rad], (m,). moving: which joints may move, (n,); by default all.

    An arm with fewer than six joints brings the origin of its tool to a place exactly, and turns it as far as motions
    of the joints can that do not move the origin (the null space of its Jacobian). What they cannot turn is tolerated
    up to the model's `angle_tolerance`: right angles that a URDF rounds to 1.57 keep no arm from its work.
    """
    X, J = model.tool_poses_and_jacobians(q)
    errors, J = pose_errors(X, X_target), J if moving is None else J * moving
    if not model.angle_tolerance:
        return errors, J, np.zeros(len(q))
    beyond = np.maximum(np.linalg.norm(errors[:, 3:], axis=1) - model.angle_tolerance, 0.0)
    still = np.swapaxes(np.linalg.svd(J[:, :3])[2][:, 3:], 1, 2)
    turns, sizes, _ = np.linalg.svd(J[:, 3:] @ still, full_matrices=False)
    turns = turns * (sizes > LEAST_TURN)[:, None, :]
    possible = np.tile(np.eye(6), (len(q), 1, 1))
    possible[:, 3:, 3:] = turns @ np.swapaxes(turns, 1, 2)
    return (possible @ errors[:, :, None])[..., 0], possible @ J, beyond


def descend(
    model: RobotModel,
    X_target: Array,
    starts: Array,
    steps: int,
    *,
    turn_weight: float = 1.0,
    moving: Mask | None = None,
    limited: bool = True,
    kept: int | None = None,
) -> Approach:
    """Minimize the pose error from each of m starts, shape (m, n).

    X_target: one pose X_WT of the tool frame, shape (4, 4), or one for each start, (m, 4, 4). turn_weight: what an
    error of 1 rad counts against one of 1 m. moving: which joints may move, (n,); by default all. limited: whether
    joints stay within their limits. kept: of how many starts, the closest in order, the result is; by default of all.

    Returns the final joint positions, (m, n), and their weighted pose errors, (m, 6). A start ends once the square of
    its error is at most `FOLLOWED`, or when a step reduces that by no more than one part in `STALLED`.
    """
    weights = np.repeat([1.0, turn_weight], 3)
    least_damping = _LEAST_DAMPING * max(1.0, turn_weight) ** 2  # above the rounding of the normal equations
    lower, upper = (model.lower, model.upper) if limited else (-np.inf, np.inf)

    def measured(q: Array, targets: Array) -> tuple[Array, Array]:
        X, J = model.tool_poses_and_jacobians(q)
        return pose_errors(X, targets) * weights, J * weights[:, None]

    q, targets = np.clip(starts, lower, upper), np.broadcast_to(X_target, (len(starts), 4, 4))
    e, J = measured(q, targets)
    q_all, e_all, rows = q.copy(), e.copy(), np.arange(len(q))
    damping, going = np.full(len(q), _FIRST_DAMPING), np.ones(len(q), dtype=bool)
    cost = (e**2).sum(axis=1)
    for _ in range(steps):
        going &= cost > FOLLOWED
        if not going.any():
            break
        if not going.all():
            rows = rows[going]
            targets, q, e, J, cost, damping = (values[going] for values in (targets, q, e, J, cost, damping))
        pull = (np.swapaxes(J, 1, 2) @ e[:, :, None])[..., 0]
        free = ~((q <= lower) & (pull < 0)) & ~((q >= upper) & (pull > 0))
        if moving is not None:
            free &= moving
        J_free = J * free[:, None, :]
        normal = np.swapaxes(J_free, 1, 2) @ J_free + damping[:, None, None] * np.eye(q.shape[1])
        q_next = np.clip(q + np.linalg.solve(normal, (pull * free)[..., None])[..., 0], lower, upper)
        e_next, J_next = measured(q_next, targets)
        cost_next = (e_next**2).sum(axis=1)
        better = cost_next < cost
        q, e = np.where(better[:, None], q_next, q), np.where(better[:, None], e_next, e)
        J = np.where(better[:, None, None], J_next, J)
        going = ~better & (damping < _MOST_DAMPING) | (cost_next < cost * (1.0 - 1.0 / STALLED))
        cost = np.where(better, cost_next, cost)
        damping = np.clip(damping * np.where(better, 0.2, 4.0), least_damping, _MOST_DAMPING)
        q_all[rows], e_all[rows] = q, e
    closest = slice(None) if kept is None else np.argsort((e_all**2).sum(axis=1), kind="stable")[:kept]
    return q_all[closest], e_all[closest]


def newton(model: RobotModel, X_target: Array, q: Array, tolerance: float, moving: Mask | None = None) -> Approach:
    """Newton's method for `misses` from each of m joint positions, shape (m, n), with the least motion of the joints.

    X_target: one pose X_WT of the tool frame, shape (4, 4), or one for each row, (m, 4, 4). tolerance: largest pose
    error, in m and rad, from which a row takes no further step. moving: which joints may move, (n,); by default all.
    The errors that remain are the largest of each row, (m,).
    """
    targets = np.broadcast_to(X_target, (len(q), 4, 4))
    q, largest = q.copy(), np.zeros(len(q))
    rows = np.arange(len(q))
    for step in range(NEWTON_STEPS + 1):
        errors, J, turned_away = misses(model, q[rows], targets[rows], moving)
        off = np.abs(errors).max(axis=1, initial=0.0) > tolerance
        largest[rows] = np.maximum(np.abs(errors).max(axis=1, initial=0.0), turned_away)
        rows = rows[off]
        if step == NEWTON_STEPS or not len(rows):
            break
        q[rows] += least_steps(J[off], errors[off])
    return q, largest


def least_steps(J: Array, errors: Array) -> Array:
    """The shortest steps (m, n) with J @ step = error, if any; for Jacobians (m, 6, n), errors (m, 6).

    The damping keeps steps finite at singularities: J^T (J J^T + d)^-1 = (J^T J + d)^-1 J^T, the smaller is inverted.
    """
    J_T, damping = np.swapaxes(J, 1, 2), _LEAST_DAMPING * np.eye(min(J.shape[1:]))
    if J.shape[2] < J.shape[1]:
        steps = np.asarray(np.linalg.solve(J_T @ J + damping, J_T @ errors[:, :, None]), dtype=float)
    else:
        steps = J_T @ np.linalg.solve(J @ J_T + damping, errors[:, :, None])
    return steps[..., 0]


def spread_starts(model: RobotModel, count: int) -> Array:
    """Joint positions that fill the space evenly, the same on every call, shape (count, n).

    Turning joints go once round, sliding ones between their limits (1 m either way where there are none).
    """
    half_turn = np.where(model.turns, np.pi, 1.0)
    lower = np.where(model.turns | np.isinf(model.lower), -half_turn, model.lower)
    upper = np.where(model.turns | np.isinf(model.upper), half_turn, model.upper)
    return lower + (upper - lower) * halton(count, len(model.arm))


@cache
def halton(count: int, dimensions: int) -> Array:
    """The first `count` points of the sequence of J. H. Halton (1960) in the unit cube, shape (count, dimensions)."""
    points = np.zeros((count, dimensions))
    for column, prime in enumerate(_PRIMES[:dimensions]):
        index, weight = np.arange(1, count + 1), 1.0 / prime
        while index.any():
            points[:, column] += weight * (index % prime)
            index, weight = index // prime, weight / prime
    points.setflags(write=False)
    return points


@dataclass(frozen=True)
class Unreachable:
    """Why no joint position within the limits brings the tool frame to a pose."""

    why: Literal["too far", "too close", "wrong way round", "past limit", "turned"]
    """Turned as required, the tool frame comes no closer to its place, outside the arm's reach, or in a hole of it
    behind which it can reach: most arms cannot fold tightly around their base; the tool frame cannot be turned as
    required anywhere; only the limit of `joint` is in the way; or an arm of few axes has the tool turned there."""
    missing: float  # what is missing: a distance [m] or an angle [rad]
    joint: str = ""
    turns: bool = True  # whether the joint turns; else it slides

    def __str__(self) -> str:
        if self.why in ("too far", "too close"):
            amount = f"{self.missing:.2f} m" if self.missing >= 0.01 else f"{1e3 * self.missing:.2g} mm"
            return f"{'out of reach' if self.why == 'too far' else self.why} by {amount}"
        angle = np.degrees(self.missing)
        if self.why == "wrong way round":
            at_best = f"{angle:.{0 if angle >= 2 else 2}f} deg at best"
            return f"cannot be approached from that side: the tool is off by {at_best}"
        if self.why == "turned":
            return f"{TURNED} by {angle:.3g} deg about the vertical"
        amount = f"{round(self.missing, 3):g} m" if self.missing >= 0.01 else f"{1e3 * self.missing:.2g} mm"
        return f"joint `{self.joint}` {f'{angle:.3g} deg' if self.turns else amount} past its limit"


def past_limit(model: RobotModel, excess: Array) -> Unreachable:
    """That the joint which exceeds its limit most is in the way; excess: of each of the arm, shape (n,)."""
    joint = int(excess.argmax())
    return Unreachable("past limit", float(excess[joint]), model.arm[joint], bool(model.turns[joint]))


def why_unreachable(model: RobotModel, X_WT: Array, branches: Array | None = None) -> Unreachable:
    """Why no position within the limits brings the tool frame to X_WT, shape (4, 4).

    branches: the solutions with limits ignored, shape (k, n), possibly none. If there are some, the result is the worst
    joint of the branch that exceeds the limits least (the sum over its joints).
    """
    if branches is not None and len(branches):
        excess = limit_excess(model, closest_turns(model, branches))
        least = excess[excess.sum(axis=1).argmin()]
        return past_limit(model, least)
    if len(model.arm) < AXES_OF_A_POSE:
        turned = as_arm_turns(model, X_WT)
        if may_reach(model, turned[None]):
            R = turned[:3, :3] @ X_WT[:3, :3].T
            return Unreachable("turned", float(np.arctan2(R[1, 0], R[0, 0])))
    # The closest pose within the joint limits.
    q = np.concatenate([model.home[None], spread_starts(model, STARTS)])
    for weight, steps, kept in STAGES:
        q, errors = descend(model, X_WT, q, steps, turn_weight=weight, kept=kept)
    distances = np.linalg.norm(errors[:, :3], axis=1)
    angles = np.linalg.norm(errors[:, 3:], axis=1) / weight
    held = angles < max(HELD_ORIENTATION, model.angle_tolerance)
    if not held.any():
        return Unreachable("wrong way round", float(angles.min()))
    closest = int(np.where(held, distances, np.inf).argmin())
    if beyond_reach(model, X_WT) > 0.0:
        return Unreachable("too far", float(distances[closest]))
    # It is in a hole if the arm can reach places beyond it, in the direction in which it lies from the closest one.
    q, missing = q[closest], errors[closest, :3]
    legs = np.diff(np.concatenate([model.joint_origins(q), model.tool_pose(q)[None, :3, 3]]), axis=0)
    ways = np.linspace(0.0, 2 * float(np.linalg.norm(legs, axis=1).sum()), PLACES_BEYOND)
    beyond = np.tile(X_WT, (PLACES_BEYOND, 1, 1))
    beyond[:, :3, 3] += ways[:, None] * missing / max(float(np.linalg.norm(missing)), 1e-12)
    starts = np.concatenate([q[None], spread_starts(model, STARTS_BEYOND - 1)])
    targets, starts = np.repeat(beyond, STARTS_BEYOND, axis=0), np.tile(starts, (PLACES_BEYOND, 1))
    _, errors = descend(model, targets, starts, STEPS)
    reached = np.abs(errors).max(axis=1) < max(1e-6, 2.0 * model.angle_tolerance)
    return Unreachable("too close" if reached.any() else "too far", float(distances[closest]))


def as_arm_turns(model: RobotModel, X_WT: Array) -> Array:
    """A pose that points down, (4, 4), turned about the vertical so that the arm comes closest to it."""
    q = np.concatenate([model.home[None], spread_starts(model, TURN_STARTS)])
    for weight in (0.02, 1.0, 0.02):
        q, _ = descend(model, X_WT, q, TURN_STEPS, turn_weight=weight, kept=8)
        turned = model.tool_poses(q[:1])[0, :3, :3] @ X_WT[:3, :3].T
        turn = float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
        X_WT = pose(axis_rotation(2, turn) @ X_WT[:3, :3], X_WT[:3, 3])
    return X_WT


def may_reach(model: RobotModel, X_WT: Array) -> bool:
    """Whether an arm of few axes may bring the tool to poses, (k, 4, 4): quicker than to say why it cannot."""
    if len(model.arm) >= AXES_OF_A_POSE:
        return True
    starts = spread_starts(model, TURN_STARTS // 2)
    _, errors = descend(model, X_WT.repeat(len(starts), axis=0), np.tile(starts, (len(X_WT), 1)), TURN_STEPS)
    met = np.abs(errors).max(axis=1).reshape(len(X_WT), -1) < MET + model.angle_tolerance
    return bool(met.any(axis=1).all())


def closest_turns(model: RobotModel, q: Array) -> Array:
    """Positions (m, n) with whole turns added to joints outside their limits, to exceed these least."""
    bounded = model.turns & np.isfinite(model.lower) & np.isfinite(model.upper)
    middle = 0.5 * (np.where(bounded, model.lower, 0.0) + np.where(bounded, model.upper, 0.0))
    turned = q + 2 * np.pi * np.round((middle - q) / (2 * np.pi))
    outside = (q < model.lower) | (q > model.upper)
    return np.where(bounded & outside, turned, q)


def limit_excess(model: RobotModel, q: Array) -> Array:
    """Excess of positions (m, n) over the limits, shape (m, n) [rad or m]; 0 within them."""
    return np.maximum(np.maximum(model.lower - q, q - model.upper), 0.0)


def beyond_reach(model: RobotModel, X_WT: Array) -> float:
    """Distance [m] of a tool pose X_WT, shape (4, 4), outside the sphere of all reachable poses of its orientation.

    Positive: unreachable, and at least this far. Otherwise it proves nothing; -infinite without a bound.
    """
    if (sphere := _wrist_sphere(model)) is None:
        return -np.inf
    center, radius, point = sphere
    return float(np.linalg.norm(X_WT[:3, :3] @ point + X_WT[:3, 3] - center)) - radius


@lru_cache(maxsize=8)
def _wrist_sphere(model: RobotModel) -> tuple[Array, float, Array] | None:
    """Centre [m], radius [m] and point in the tool frame [m] that cannot leave it, a point of the last axis.

    A point on an axis is fixed in both links that the axis joins. So a point on the last axis is no further from one on
    the first than the sum of distances between points on neighbouring axes. These move to shorten their chain: one
    after the other to the place on its axis with the shortest way between its neighbours, which divides the difference
    of their heights along the axis in the ratio of their distances from it. None if a joint slides or follows another.
    """
    if not model.turns.all() or not model.joints_move_alone:
        return None
    axes, points = model.joint_lines(model.home[None])[:, 0].copy()
    n = len(points)
    for _ in range(ROUNDS):
        for k in range(n):
            neighbours = points[[i for i in (k - 1, k + 1) if 0 <= i < n]] - points[k]
            heights = neighbours @ axes[k]
            # With both neighbours on the axis, as where axes meet in one point, any place between them is shortest.
            distances = np.linalg.norm(neighbours - heights[:, None] * axes[k], axis=1) + LEAST_DISTANCE
            points[k] += (heights * (distances[::-1] / distances.sum())).sum() * axes[k]
    X_TW = inverse(model.tool_pose(model.home))
    radius = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return points[0], radius, X_TW[:3, :3] @ points[-1] + X_TW[:3, 3]
