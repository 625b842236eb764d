"""Overlapping objects with other shapes than boxes; `placement` compares boxes exactly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.checks.placement import MIN_OVERLAP, doubted_objects
from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, inverse, pose, transform
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.motion.collision.collision_body import distance_within, placement_at
from sqrp_cli.programming.solids import Solid, load_solid
from sqrp_cli.shapes import LEAST_SIZE, Box, Mesh, Part

LEAST_SHARE = 0.01
"""Least factor by which a mesh is shrunk; it applies to meshes thinner than `MIN_OVERLAP` on both sides."""


@dataclass(frozen=True, eq=False)
class _Placed:
    """A solid part of an object."""

    object: str
    solid: Solid
    X_WO: Array
    """Pose of the object in the world, shape (4, 4)."""
    center: Array
    """Centre of the sphere around the part, in the world [m], shape (3,)."""

    @property
    def shrunk(self) -> _Placed:
        """The part with `MIN_OVERLAP` taken off on every side."""
        return replace(self, solid=load_solid(_shrunk(self.solid)))

    def meets(self, other: _Placed) -> bool:
        """Whether both have a point in common; a mesh that is not closed has only its surface."""
        return self._touches(other) or self._encloses(other) or other._encloses(self)

    def _touches(self, other: _Placed) -> bool:
        """As `meets`, but every mesh is only a surface."""
        one, two = (placement_at(placed.X_WO @ placed.solid.part.X_PG) for placed in (self, other))
        return distance_within(self.solid.geometry, one, other.solid.geometry, two, 0.0) is not None

    def _encloses(self, other: _Placed) -> bool:
        """Whether this is a closed mesh that goes around a corner of another part."""
        corner = transform(inverse(self.X_WO) @ other.X_WO, other.solid.vertices[:1])[0]
        return isinstance(self.solid.part.shape, Mesh) and self.solid.contains(corner)


def overlapping_shapes(workspace: Workspace) -> Iterator[Problem]:
    """Pairs of objects with parts more than 1 mm deep in each other.

    Pairs of boxes and objects with a doubted measure are left out.
    """
    doubted = doubted_objects(workspace)
    objects = [item for item in workspace.objects.values() if item.name not in doubted]
    if all(isinstance(part.shape, Box) for item in objects for part in item.parts):
        return  # the usual case, fast even for many objects
    placed = [
        _Placed(item.name, solid, item.X_WO, transform(item.X_WO, solid.center))
        for item in objects
        if item.X_WO is not None
        for solid in map(load_solid, item.parts)
    ]
    reported: set[tuple[str, str]] = set()
    for first, second in _close_pairs(placed):
        pair = (first.object, second.object)
        if pair not in reported and _are_in_each_other(first, second):
            reported.add(pair)
            one, other = (type(part.solid.part.shape).__name__.lower() for part in (first, second))
            message = (
                f"objects `{pair[0]}` and `{pair[1]}` are in one place: a {one} of the first and a {other} of the "
                f"second are more than {1e3 * MIN_OVERLAP:g} mm deep in each other"
            )
            place = workspace.places.get(f"objects.{pair[1]}.pose")
            mend = "move one of them, or correct the shapes of its `parts`"
            yield Problem("overlapping-objects", message, place, severity="warning", mend=mend)


def _close_pairs(placed: Sequence[_Placed]) -> Iterator[tuple[_Placed, _Placed]]:
    """Parts of different objects, not both boxes, whose spheres meet; in order."""
    centers = np.array([part.center for part in placed]).reshape(-1, 3)
    radii = np.array([part.solid.radius for part in placed])
    boxes = np.array([isinstance(part.solid.part.shape, Box) for part in placed], dtype=bool)
    for index, part in enumerate(placed):
        near = np.linalg.norm(centers - part.center, axis=1) < radii + part.solid.radius
        near[: index + 1] = False
        if boxes[index]:
            near &= ~boxes
        others = (placed[other] for other in np.flatnonzero(near).tolist())
        yield from ((part, other) for other in others if other.object != part.object)


def _are_in_each_other(first: _Placed, second: _Placed) -> bool:
    """Whether they still meet when either is shrunk; either, because a hollow mesh only gets narrower."""
    return first.meets(second) and first.shrunk.meets(second) and first.meets(second.shrunk)


def _shrunk(solid: Solid) -> Part:
    part = solid.part
    if not isinstance(part.shape, Mesh):
        return replace(part, shape=part.shape.shrunk(MIN_OVERLAP))
    vertices = transform(inverse(part.X_PG), solid.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    share = np.maximum(1 - 2 * MIN_OVERLAP / np.maximum(high - low, LEAST_SIZE), LEAST_SHARE)
    x, y, z = (share * part.shape.scale).tolist()
    X_GS = pose(position=(1 - share) * (low + high) / 2)
    return replace(part, shape=Mesh(part.shape.path, (x, y, z)), X_PG=part.X_PG @ X_GS)
