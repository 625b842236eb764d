"""Solids for collision checks: bounds for culling, convex hulls, distances by coal, and contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np

from sqrp_cli.geometry import Array, pose, transform
from sqrp_cli.programming.solids import Solid
from sqrp_cli.shapes import Mesh

CLEARANCE = 1e-3
"""Distance that the arm keeps from everything [m]; the workspace's padding adds to it for fixed objects."""

NamePairs = frozenset[tuple[str, str]]
"""Pairs of names of links or objects, each in alphabetical order."""

MESHES_WITHIN = 0.02
"""Motion within a stretch [m] up to which meshes are checked exactly; above it only their hulls, which is faster."""

SPHERES = 5
"""Spheres that cover a solid for culling."""

CoalGeometry = Any
"""One of coal's collision geometries."""

CoalPlacement = Any
"""One of coal's transforms."""

_REQUEST = coal.CollisionRequest()

_RESULT = coal.CollisionResult()


@dataclass(frozen=True)
class Contact:
    """Two links or objects that come closer than the clearance (or could, by less than a resolution of motion)."""

    first: str
    second: str
    """Names of links or objects, the outer one of the arm first."""
    s: float = 0.0
    """Position on the path, in [0, 1]."""
    clearance: float = CLEARANCE
    """Distance that they have to keep [m]."""

    def __str__(self) -> str:
        if self.clearance > CLEARANCE:
            return f"{self.first} comes closer to {self.second} than {self.clearance:.3g} m"
        return f"{self.first} hits {self.second}"


def pair(first: str, second: str) -> tuple[str, str]:
    """Two names in alphabetical order."""
    return (first, second) if first < second else (second, first)


@dataclass(frozen=True, eq=False)
class Body:
    """A solid with its hull for coal, and with bounds for culling, all in the frame of its parent P."""

    name: str
    geometry: CoalGeometry
    hull: CoalGeometry
    X_PG: Array
    """Pose of the geometry."""
    center: Array
    radius: float
    """Sphere around it."""
    centers: Array
    radii: Array
    """Spheres that cover its surface, shape (SPHERES, 3) and (SPHERES,)."""
    X_PB: Array
    half: Array
    """Pose and half extents of a box around it."""
    corners: Array
    """Points between which all of it lies, shape (V, 3)."""

    @classmethod
    def of(cls, solid: Solid) -> Body:
        """Make the body of a solid; for a mesh, this computes its convex hull, if it has one."""
        hull, enclosing = solid.geometry, solid.corners
        if isinstance(solid.part.shape, Mesh) and _has_hull(solid):
            hull = hull.convex
            enclosing = transform(solid.part.X_PG, np.array(hull.points()))
        corner, *_ = corners = solid.corners
        edges = np.stack([corners[4] - corner, corners[2] - corner, corners[1] - corner])
        lengths = np.maximum(np.linalg.norm(edges, axis=1), 1e-9)
        X_PB = pose(solid.part.X_PG[:3, :3], corners.mean(axis=0))
        centers, radii = _covering_spheres(solid, X_PB, lengths / 2)
        return cls(
            name=solid.part.parent,
            geometry=solid.geometry,
            hull=hull,
            X_PG=solid.part.X_PG,
            center=solid.center,
            radius=solid.radius,
            centers=centers,
            radii=radii,
            X_PB=X_PB,
            half=lengths / 2,
            corners=enclosing,
        )


def _has_hull(solid: Solid) -> bool:
    """Whether coal can build the convex hull of a mesh: not of flat ones, nor with 256 edges at one corner."""
    if _is_flat(solid.vertices):
        return False
    try:
        solid.geometry.buildConvexHull(True, "Qt")
    except RuntimeError:  # such as of a cylinder with a corner in the middle of its end
        return False
    return True


def _is_flat(vertices: Array) -> bool:
    """Whether all vertices (V, 3) lie in one plane, up to a millionth of their extent."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return bool(len(extents) < 3 or extents[-1] <= 1e-6 * extents[0])


def _covering_spheres(solid: Solid, X_PB: Array, half: Array) -> tuple[Array, Array]:
    """Centres (SPHERES, 3) and radii (SPHERES,) of spheres that together contain the solid's surface.

    The solid is cut into slices across its longest side; a sphere goes around the triangles that are centred in its
    slice, or around the slice of the box, whichever makes the smaller spheres.
    """
    axis = int(half.argmax())
    slice_half = half.copy()
    slice_half[axis] /= SPHERES
    offsets = np.zeros((SPHERES, 3))
    offsets[:, axis] = half[axis] * (2 * np.arange(SPHERES) + 1 - SPHERES) / SPHERES
    box_centers, box_radius = transform(X_PB, offsets), float(np.linalg.norm(slice_half))
    corners = solid.vertices[solid.triangles]
    along = (corners.mean(axis=1) - X_PB[:3, 3]) @ X_PB[:3, axis]
    slices = np.clip(((along / half[axis] + 1) / 2 * SPHERES).astype(int), 0, SPHERES - 1)
    centers, radii = np.tile(box_centers[0], (SPHERES, 1)), np.zeros(SPHERES)
    for k in np.unique(slices):
        points = corners[slices == k].reshape(-1, 3)
        centers[k] = (points.min(axis=0) + points.max(axis=0)) / 2
        radii[k] = np.linalg.norm(points - centers[k], axis=1).max()
    filled = radii > 0
    centers[~filled], radii[~filled] = centers[filled][0], radii[filled][0]
    if radii.max() <= box_radius:
        return centers, radii
    return box_centers, np.full(SPHERES, box_radius)


def placement_at(X: Array) -> CoalPlacement:
    """A pose, shape (4, 4), as coal's transform."""
    return coal.Transform3s(X[:3, :3], X[:3, 3])


def distance_within(
    first: CoalGeometry, X_1: CoalPlacement, second: CoalGeometry, X_2: CoalPlacement, within: float
) -> float | None:
    """Signed distance [m] of two of coal's geometries if it is at most `within`, otherwise None.

    Between meshes, it is the distance of the first two triangles found within, which need not be the nearest.
    """
    _REQUEST.security_margin = within
    _RESULT.clear()
    if not coal.collide(first, X_1, second, X_2, _REQUEST, _RESULT):
        return None
    return float(_RESULT.getContact(0).penetration_depth)


def body_distance(
    first: Body, X_1: CoalPlacement, second: Body, X_2: CoalPlacement, clearance: float, need: float
) -> float | None:
    """None only if two bodies are further than `need` [m] apart; at most `clearance` only if they are that close.

    Hulls enclose meshes, so hulls that are far apart prove the meshes apart, and quickly.
    """
    distance = distance_within(first.hull, X_1, second.hull, X_2, need)
    if distance is None or (first.geometry is first.hull and second.geometry is second.hull):
        return distance
    if distance <= clearance and distance_within(first.geometry, X_1, second.geometry, X_2, clearance) is not None:
        return clearance
    if need - clearance <= MESHES_WITHIN and distance_within(first.geometry, X_1, second.geometry, X_2, need) is None:
        return None
    return need if need > clearance else None
