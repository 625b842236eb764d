"""Why an arm cannot bring its tool frame to a pose, and by how much.

A sphere that bounds the arm's outermost axis proves without a search that places are too far.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sqrp_cli.geometry import Array, inverse
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.pose_search import descend, spread_starts

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


@dataclass(frozen=True)
class OutOfReach:
    """The tool frame, turned as required, comes no closer to its place than `distance` [m]."""

    distance: float
    too_close: bool
    """Whether the arm can reach places behind it: it lies in a hole of the arm's reach; else it lies outside.

    Most arms have such a hole around the base: they cannot fold tightly enough.
    """

    def __str__(self) -> str:
        distance = f"{self.distance:.2f} m" if self.distance >= 0.01 else f"{1e3 * self.distance:.2g} mm"
        return f"{distance} too {'close' if self.too_close else 'far'}"


@dataclass(frozen=True)
class WrongWayRound:
    """The tool frame cannot be turned as required anywhere; at best it is off by `angle` [rad]."""

    angle: float

    def __str__(self) -> str:
        angle = np.degrees(self.angle)
        return f"cannot be approached from that side: the tool is off by {angle:.{0 if angle >= 2 else 2}f} deg at best"


@dataclass(frozen=True)
class PastLimit:
    """The pose exceeds only the limit of `joint`, by `excess` [rad, or m if it slides]."""

    joint: str
    excess: float
    turns: bool

    def __str__(self) -> str:
        amount = f"{round(self.excess, 3):g} m" if self.excess >= 0.01 else f"{1e3 * self.excess:.2g} mm"
        amount = f"{np.degrees(self.excess):.3g} deg" if self.turns else amount
        return f"joint `{self.joint}` {amount} past its limit"

    @classmethod
    def worst(cls, model: RobotModel, excess: Array) -> PastLimit:
        """Of the joint that exceeds its limit most; excess: of each, shape (n,)."""
        joint = int(excess.argmax())
        return cls(model.arm[joint], float(excess[joint]), bool(model.turns[joint]))


Unreachable = OutOfReach | WrongWayRound | PastLimit


def why_unreachable(model: RobotModel, X_WT: Array, branches: Array | None = None) -> Unreachable:
    """Why no position within the limits brings the tool frame to X_WT, shape (4, 4).

    branches: the solutions with limits ignored, shape (k, n), possibly none. If there are some, the result is the worst
    joint of the branch that exceeds the limits least (the sum over its joints).
    """
    if branches is not None and len(branches):
        excess = limit_excess(model, closest_turns(model, branches))
        least = excess[excess.sum(axis=1).argmin()]
        return PastLimit.worst(model, least)
    # The closest pose within the joint limits.
    q = np.concatenate([model.home[None], spread_starts(model, STARTS)])
    for weight, steps, kept in STAGES:
        q, errors = descend(model, X_WT, q, steps, turn_weight=weight).best(kept)
    distances = np.linalg.norm(errors[:, :3], axis=1)
    angles = np.linalg.norm(errors[:, 3:], axis=1) / weight
    held = angles < max(HELD_ORIENTATION, model.angle_tolerance)
    if not held.any():
        return WrongWayRound(float(angles.min()))
    closest = int(np.where(held, distances, np.inf).argmin())
    if beyond_reach(model, X_WT) > 0.0:
        return OutOfReach(float(distances[closest]), too_close=False)
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
    return OutOfReach(float(distances[closest]), bool(reached.any()))


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
    axes, points = (lines[0].copy() for lines in model.joint_lines(model.home[None]))
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
