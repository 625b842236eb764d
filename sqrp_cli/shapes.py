"""Shapes, and the solid parts that they make up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sqrp_cli.geometry import Array, check_poses

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
