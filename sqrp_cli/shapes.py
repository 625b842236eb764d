"""Shapes, and the solid parts that they make up.

Every shape but a mesh computes its extents, its triangles, whether it contains a point, and a shrunk copy. The file of
a mesh is read where it is needed: `sight.solids` and `run.robot_body`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, box_corners, check_poses, cross
from sqrp_cli.records import dataclass

Geometry = Literal["collision", "visual"]  # Which of the two geometries of a link
LEAST_SIZE = 1e-6  # Least size of a shape after shrinking [m]

BOX_TRIANGLES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
"""Triangles of a box over its corners in the order of `geometry.BOX_SIGNS`, outward, shape (12, 3)."""

BOX_TRIANGLES.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface of triangles."""

    vertices: Array  # Corners [m], shape (V, 3)
    faces: NDArray[np.int64]  # Indices of three corners each, shape (F, 3)

    def turns_around(self, point: Array) -> float:
        """The winding number of the surface around a point (3,): an integer if it is closed.

        The sum of the solid angles of its triangles (van Oosterom and Strackee 1983) over that of a sphere.
        """
        a, b, c = np.moveaxis(self.vertices[self.faces] - point, 1, 0)
        along, across, over = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
        below = along * across * over + dots[0] * over + dots[1] * along + dots[2] * across
        return float(2 * np.arctan2(volume, below).sum() / (4 * np.pi))


@dataclass(frozen=True)
class Box:
    """A box along its own axes."""

    size: tuple[float, float, float]  # Full extents [m]


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    radius: float  # [m]


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about its z axis."""

    radius: float  # [m]
    length: float  # [m]


@dataclass(frozen=True)
class Capsule:
    """A capsule about its z axis."""

    radius: float  # [m]
    length: float  # Of the straight part [m]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh file (STL, OBJ or DAE)."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)  # Along x, y and z, from the file's numbers to metres


Convex = Box | Sphere | Cylinder | Capsule  # The shapes that need no file
Shape = Convex | Mesh


def half_extents(shape: Convex, R: Array) -> Array:
    """Half extents of a shape along the axes of a frame in which its rotation is R (3, 3) [m], shape (3,)."""
    match shape:
        case Box(size):
            half: Array = np.abs(R) @ (0.5 * np.asarray(size))
        case Sphere(radius):
            half = np.full(3, radius)
        case Cylinder(radius, length):
            along = np.abs(R[:, 2])
            half = radius * np.sqrt(np.clip(1 - along**2, 0, 1)) + 0.5 * length * along
        case Capsule(radius, length):
            half = radius + 0.5 * length * np.abs(R[:, 2])
    return half


class PlacedBox(NamedTuple):
    """A box somewhere in the world."""

    X_WB: Array  # Pose of its centre, shape (4, 4)
    size: Array  # Full extents [m], shape (3,)

    def gap(self, other: PlacedBox, *, from_above: bool = False) -> float:
        """The widest gap between two boxes along an axis that separates them [m].

        Below 0 where they have points in common: then the shortest move after which they only touch, negated. Exact:
        the separating-axis theorem over the 3 + 3 face normals and the 9 cross products of edges (Gottschalk et al.,
        OBBTree, SIGGRAPH 1996); the shortest way out of a convex body lies along one of these axes. from_above: of
        their shadows on the floor instead, whose edges are those of the boxes; their distance is that at least.
        """
        edges, others = self.X_WB[:3, :3].T, other.X_WB[:3, :3].T
        axes = np.concatenate([edges, others])
        crosses = cross(axes, np.array([0.0, 0.0, 1.0])) if from_above else cross(edges[:, None], others[None])
        crosses = crosses.reshape(-1, 3)
        lengths = np.linalg.norm(crosses, axis=1, keepdims=True)
        directions = (crosses / np.maximum(lengths, 1e-9))[lengths[:, 0] > 1e-9]
        along = directions if from_above else np.concatenate([axes, directions])
        reach = np.abs(along @ edges.T) @ (0.5 * self.size) + np.abs(along @ others.T) @ (0.5 * other.size)
        return float((np.abs(along @ (self.X_WB[:3, 3] - other.X_WB[:3, 3])) - reach).max())


def contains(shape: Convex, point: Array) -> bool:
    """Whether a point in the shape's own frame (3,) is inside it."""
    x, y, z = point.tolist()
    match shape:
        case Box(size):
            return bool((np.abs(point) < 0.5 * np.asarray(size)).all())
        case Sphere(radius):
            return hypot(x, y, z) < radius
        case Cylinder(radius, length):
            return hypot(x, y) < radius and abs(z) < length / 2
        case Capsule(radius, length):
            return hypot(x, y, max(0.0, abs(z) - length / 2)) < radius


def shrunk(shape: Convex, by: float) -> Convex:
    """A copy with `by` [m] taken off on every side."""
    match shape:
        case Box((x, y, z)):
            return Box((max(x - 2 * by, LEAST_SIZE), max(y - 2 * by, LEAST_SIZE), max(z - 2 * by, LEAST_SIZE)))
        case Sphere(radius):
            return Sphere(max(radius - by, LEAST_SIZE))
        case Cylinder(radius, length):
            return Cylinder(max(radius - by, LEAST_SIZE), max(length - 2 * by, LEAST_SIZE))
        case Capsule(radius, length):
            return Capsule(max(radius - by, LEAST_SIZE), length)


def surface(shape: Convex, sides: int, *, enclosing: bool) -> Triangles:
    """The surface of a shape; round ones are of rings of `sides` corners.

    Corners lie on the shape or, if `enclosing`, outside of it: the sides of rings touch it then, and of spheres and the
    ends of capsules only the middles of faces dip into it (by 0.2 % for 48 sides).
    """
    if isinstance(shape, Box):
        return Triangles(box_corners(shape.size), BOX_TRIANGLES)
    radius = float(shape.radius / np.cos(np.pi / sides)) if enclosing else shape.radius
    # Rings about z, by their radii and heights; both ends of the straight part of a capsule have one.
    match shape:
        case Sphere():
            angles = np.linspace(0, np.pi, sides // 2 + 1)
            radii, heights = radius * np.sin(angles), radius * np.cos(angles)
        case Capsule(_, length):
            quarter = np.linspace(0, np.pi / 2, sides // 4 + 1)
            angles = np.concatenate([quarter, np.pi - quarter[::-1]])
            lifts = np.repeat([length / 2, -length / 2], len(quarter))
            radii, heights = radius * np.sin(angles), radius * np.cos(angles) + lifts
        case Cylinder(_, length):
            radii, heights = np.full(2, radius), np.array([-length / 2, length / 2])
    around, first = 2 * np.pi * np.arange(sides) / sides, np.arange(sides)
    x, y = radii[:, None] * np.cos(around), radii[:, None] * np.sin(around)
    rings = np.stack([x, y, np.broadcast_to(heights[:, None], x.shape)], axis=-1).reshape(-1, 3)
    following, faces = (first + 1) % sides, list[NDArray[np.int64]]()
    if isinstance(shape, Cylinder):
        high, bottom, top = first + sides, np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
        faces += [np.column_stack([first, following, high]), np.column_stack([following, following + sides, high])]
        faces += [np.column_stack([bottom, following, first]), np.column_stack([top, high, following + sides])]
        ends = np.column_stack([np.zeros((2, 2)), heights])
        return Triangles(np.concatenate([rings, ends]), np.concatenate(faces))
    for upper in range(0, len(rings) - sides, sides):
        lower = upper + sides
        faces.append(np.column_stack([upper + first, lower + first, lower + following]))
        faces.append(np.column_stack([upper + first, lower + following, upper + following]))
    return Triangles(rings, np.concatenate(faces))


FIGURES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}
"""What each kind of shape needs, and of how many numbers it is, in the order of `shape_of`."""
_ROUND: dict[str, type[Sphere | Cylinder | Capsule]] = {"sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}


def shape_of(kind: str, figures: Sequence[float]) -> Box | Sphere | Cylinder | Capsule:
    """The shape of a kind, such as `cylinder`, from its full extents, or its radius and length, if any [m]."""
    if kind == "box":
        x, y, z = figures
        return Box((x, y, z))
    return _ROUND[kind](*figures)


@dataclass(frozen=True, eq=False)
class Part:
    """A solid, opaque piece that moves rigidly with its parent."""

    name: str  # Its name in output
    parent: str  # A link of the robot, an object, or `world`
    shape: Shape
    X_PG: Array  # Pose of the shape in the parent, shape (4, 4)

    def __post_init__(self) -> None:
        """Raises ValueError if `X_PG` is not a pose."""
        check_poses(f"part `{self.name}`", self.X_PG)
