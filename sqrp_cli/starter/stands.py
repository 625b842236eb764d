"""Where an arm may stand: on a table, or on the floor before one, as a pedestal or a torso of its own URDF does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sqrp_cli.geometry import Array, pose, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.arm.pose_search import descend, halton
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.solids import load_solids

LIFTS = (0.0, 0.15, 0.3, 0.45)
"""Heights of the root above the table to try, as shares of the reach: small arms need a pedestal to point down."""

SHOULDERS = (0.3, 0.15, 0.45, 0.6)
"""Heights of the shoulder above a table before the arm to try, as shares of the reach."""

DIRECTIONS = tuple(turn * np.pi / 180 for turn in (0, -90, 90, 180))
"""Directions from the base in which the work may lie [rad], the preferred one first."""

GAP = 0.05
"""Between what stands and a table before it [m]."""

MOST_BEFORE = 3
"""Tables before the arm that are tried, those first that most of the tool's places are above."""

MOST_STANDS = len(LIFTS) + MOST_BEFORE
"""Heights and places of the table that are tried at most."""

PLACES = 1024
"""Positions of the joints from which places are searched where the tool points down."""

STEPS = 25
"""Steps of that search."""

MET = 1e-4
"""Largest pose error of such a place, in m and rad, besides the arm's tolerance of angle."""

WORK_HEIGHT = 0.3
"""How far above a table the tool works, as a share of the reach."""


@dataclass(frozen=True)
class Stand:
    """How arm and table stand to each other; the table's top is at height 0."""

    lift: float
    """Height of the root link [m]."""
    side: float
    """Of the square table [m]."""
    at: tuple[float, float] = (0.0, 0.0)
    """The table's middle [m]."""
    directions: tuple[float, ...] = DIRECTIONS
    """In which the work may lie, from the shoulder [rad]."""


def on_table(floor: float, reach: float, side: float) -> Iterator[Stand]:
    """On the table, or on a pedestal on it. floor: how far the robot reaches below its root [m]."""
    for share in LIFTS:
        yield Stand(round(floor + share * reach, 3), side)


@dataclass(frozen=True, eq=False)
class DownPlaces:
    """Where an arm can bring its tool so that it points down, found once."""

    model: RobotModel
    """With the root at height 0."""

    @cached_property
    def _poses(self) -> Array:
        return places_pointing_down(self.model)

    def at(self, lift: float) -> Array:
        """Poses of the tool frame, shape (k, 4, 4), with the root at a height [m]."""
        return pose(position=(0.0, 0.0, lift)) @ self._poses


def before_table(cell: Cell, reach: float, down: DownPlaces) -> Iterator[Stand]:
    """Beside a table that is wholly before the robot, the most promising first; cell: with the root at height 0.

    They take time to find, which nobody spends who needs none.
    """
    places = down.at(0.0)[:, :3, 3]
    shoulder = shoulder_of(cell.model)
    found = []
    for direction in DIRECTIONS:
        ahead = np.array([np.cos(direction), np.sin(direction)])
        aside = np.array([-ahead[1], ahead[0]])
        edge = front(cell, ahead) + GAP
        beyond = (places[:, :2] @ ahead > edge + 0.05 * reach) & (
            np.abs((places[:, :2] - shoulder[:2]) @ aside) < 0.6 * reach
        )
        for share in SHOULDERS:
            top = shoulder[2] - share * reach
            above = beyond & (places[:, 2] > top + 0.02) & (places[:, 2] < top + WORK_HEIGHT * reach)
            side = max(round(shoulder[:2] @ ahead + 1.2 * reach - edge, 1), 0.3)
            middle = (edge + side / 2) * ahead + (shoulder[:2] @ aside) * aside
            at = (round(float(middle[0]), 3), round(float(middle[1]), 3))
            found.append((int(above.sum()), Stand(round(float(-top), 3), side, at, (direction,))))
    found.sort(key=lambda one: -one[0])  # stable: the preferred direction first
    yield from (stand for count, stand in found[:MOST_BEFORE] if count)


def places_pointing_down(model: RobotModel) -> Array:
    """Poses of the tool frame that points down, spread over where the arm can bring it within its limits, (k, 4, 4)."""
    middle = np.where(model.turns, np.pi, 1.0)
    lower = np.where(np.isfinite(model.lower), np.maximum(model.lower, -2 * np.pi), -middle)
    upper = np.where(np.isfinite(model.upper), np.minimum(model.upper, 2 * np.pi), middle)
    q = lower + (upper - lower) * halton(PLACES, len(model.arm))
    targets = pointing_down(model.tool_poses(q))
    reached, errors = descend(model, targets, q, STEPS)
    met = np.abs(errors).max(axis=1) < MET + model.angle_tolerance
    return model.tool_poses(reached[met])


def pointing_down(X: Array) -> Array:
    """Poses (m, 4, 4) turned by the least angle that makes their z axes point down, about their own origins."""
    turned = X.copy()
    z = np.array([0.0, 0.0, -1.0])
    x = X[:, :3, 0] - (X[:, :3, 0] @ z)[:, None] * z
    y = np.cross(z, X[:, :3, 1])  # x of a tool whose x axis was upright
    x = np.where(np.linalg.norm(x, axis=1, keepdims=True) > 0.1, x, -y)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    turned[:, :3, 0], turned[:, :3, 1], turned[:, :3, 2] = x, np.cross(z, x), z
    return turned


def shoulder_of(model: RobotModel) -> Array:
    """Where the last six joints of an arm begin at home, such as after a torso or a rail [m], shape (3,)."""
    shoulder: Array = model.joint_origins(model.home)[max(0, len(model.arm) - 6)]
    return shoulder


def front(cell: Cell, ahead: Array) -> float:
    """How far the links that do not move reach in a direction along the ground, (2,), from the world's origin [m]."""
    return max((float((points[:, :2] @ ahead).max()) for points in still_points(cell)), default=0.0)


def lowest_point(cell: Cell) -> float:
    """Height of the lowest point of the links that do not move, in the world [m]; 0 if they have no solid part."""
    return min((float(points[:, 2].min()) for points in still_points(cell)), default=0.0)


def still_points(cell: Cell) -> Sequence[Array]:
    """Corners of the solids that the arm does not move, in the world [m], shape (V, 3) each."""
    bound = cell.collision.bound
    parts = [part for part in cell.model.parts if bound.depth[part.parent] == 0 and part.parent not in bound.rods]
    return [transform(cell.model.home_links[solid.part.parent], solid.vertices) for solid in load_solids(parts)]
