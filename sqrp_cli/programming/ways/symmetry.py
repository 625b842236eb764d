"""In how many turns a part or a tool looks the same, and by which sides."""

from __future__ import annotations

from math import gcd

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Sphere

ROUND = 0
"""The number of turns of what looks the same in every turn; `math.gcd` takes it as divisible by all."""

TURNS_OF_ROUND = 4
"""So many of the endlessly many turns of something round are tried: every 90 degrees."""

SAME_SIZE = 1e-6
"""Lengths that differ by no more than this are equal [m], and so are directions [rad]."""

SIDES = ("+z", "+x", "-x", "+y", "-y", "-z")
"""The sides of a box, first the one by which most objects are gripped."""


def tool_turns(model: RobotModel) -> int:
    """In how many equal turns about its z axis the tool looks the same; a gripper counts as 1."""
    X_WL = model.link_poses(model.home[None])
    X_TW = np.linalg.inv(X_WL[model.tool_frame][0])
    parts = [part for part in model.parts if part.parent in model.hand_links]
    placed = (_turns(part, X_TW @ X_WL[part.parent][0] @ part.X_PG, 2) for part in parts)
    return ROUND if parts and not model.fingers.joints and gcd(*placed) == ROUND else 1


def part_turns(obj: SceneObject, side: str) -> int:
    """In how many equal turns about the axis through one of its sides, such as `+z`, an object looks the same.

    About z as the workspace states it, else as its shapes do; one whose shapes do not show it counts as 1.
    """
    axis = "xyz".index(side[1])
    if axis == 2 and obj.symmetry is not None:
        return ROUND if obj.symmetry == "round" else obj.symmetry
    return gcd(*(_turns(part, part.X_PG, axis) for part in obj.parts))


def equal_turns(count: int) -> list[float]:
    """The turns that look the same [rad], in (-pi, pi], 0 first; some of them for what is round."""
    number = count or TURNS_OF_ROUND
    turns = [2 * np.pi * k / number for k in range(number)]
    return [float(turn if turn <= np.pi + SAME_SIZE else turn - 2 * np.pi) for turn in turns]


def equal_sides(obj: SceneObject) -> list[str]:
    """The sides at which an object looks to a tool as it does at +z: that one first, or alone."""
    if obj.symmetry is not None or len(obj.parts) != 1 or part_turns(obj, SIDES[0]) == 1:
        return [SIDES[0]]
    faces = {side: sorted(np.delete(obj.size, "xyz".index(side[1]))) for side in SIDES}
    box = isinstance(obj.parts[0].shape, Box | Sphere)
    alike = [side for side in SIDES if np.allclose(faces[side], faces[SIDES[0]], rtol=0.0, atol=SAME_SIZE)]
    return alike if box else [side for side in alike if side[1] == "z"]


def _turns(part: Part, X: Array, axis: int) -> int:
    """In how many turns about an axis of a frame a part looks the same; X: pose of its shape there, shape (4, 4)."""
    direction = np.eye(3)[axis]
    off = X[:3, 3] - X[axis, 3] * direction
    if np.abs(off).max() > SAME_SIZE:
        return 1
    along = np.abs(direction @ X[:3, :3])  # the shape's own axes along the axis
    own = int(along.argmax())
    if isinstance(part.shape, Sphere):
        return ROUND
    if along[own] < 1 - SAME_SIZE:
        return 1
    if isinstance(part.shape, Cylinder | Capsule):
        return ROUND if own == 2 else 2
    if isinstance(part.shape, Box):
        first, second = np.delete(part.shape.size, own)
        return 4 if abs(first - second) <= SAME_SIZE else 2
    return 1
