"""Solid things: shapes, opaque parts and the objects of a cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sqrp_cli.geometry import Array, check_finite, check_poses

Geometry = Literal["collision", "visual"]
"""Which of the two geometries of a link."""


@dataclass(frozen=True)
class Box:
    """A box of full extents `size` [m] along its own axes."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Sphere:
    """A sphere; radius [m]."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about its z axis; radius and length [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A capsule about its z axis; radius and length of the straight part [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh file (STL, OBJ or DAE) with its scale along x, y and z, from the file's numbers to metres."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


Shape = Box | Sphere | Cylinder | Capsule | Mesh


@dataclass(frozen=True, eq=False)
class Part:
    """A solid, opaque piece that moves rigidly with its parent.

    name: what output calls it. parent: a link of the robot, an object, or `world`.
    X_PG: pose of the shape in the parent, shape (4, 4).
    """

    name: str
    parent: str
    shape: Shape
    X_PG: Array

    def __post_init__(self) -> None:
        """Raises ValueError if `X_PG` is no pose."""
        check_poses(f"part `{self.name}`", self.X_PG)


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A thing in the cell.

    type: its PDDL type. color: its colour name, None if it has none worth naming. attributes: further words that a task
    may use for it. size: full extents [m] of the box around it, in its own axes.
    X_WO: pose of the centre of that box in the world, shape (4, 4); None while it is unknown where the object is.
    fixed: whether it never moves. on: the object that it stands on. marker: id of the ArUco marker on it.
    parts: its solid pieces, in its own frame; a plain box of `size` unless the workspace says otherwise.
    X_TO: pose in the tool frame, shape (4, 4), if the tool holds it at the beginning; X_WO is None then.
    """

    name: str
    type: str
    color: str | None
    attributes: tuple[str, ...]
    size: tuple[float, float, float]
    X_WO: Array | None
    fixed: bool
    on: str | None
    marker: int | None
    parts: tuple[Part, ...]
    X_TO: Array | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a pose that is none and for a size that is not finite."""
        check_poses(f"object `{self.name}`", self.X_WO, self.X_TO)
        check_finite(f"object `{self.name}`", self.size)

    @property
    def types(self) -> tuple[str, str]:
        """Its PDDL types: its own, and `fixture` or `movable`."""
        return object_types(self.type, self.fixed)


def object_types(own_type: str, fixed: bool) -> tuple[str, str]:
    """The PDDL types of an object: its own (PDDL knows lower case only), and `fixture` or `movable`."""
    return own_type.lower(), "fixture" if fixed else "movable"
