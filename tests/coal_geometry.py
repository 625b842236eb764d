"""Solids as coal's geometry, with which tests judge the kernel."""

from __future__ import annotations

from functools import cache
from typing import Any

import coal

from sqrp_cli.geometry import inverse, transform
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from sqrp_cli.sight.solids import Solid


@cache
def coal_geometry(solid: Solid) -> Any:
    """The geometry in the frame of the solid's shape: place it with X_WP @ part.X_PG."""
    match solid.part.shape:
        case Box(size):
            return coal.Box(*size)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Mesh():
            tree = coal.BVHModelOBBRSS()
            tree.beginModel(len(solid.triangles), len(solid.vertices))
            tree.addVertices(transform(inverse(solid.part.X_PG), solid.vertices))
            tree.addTriangles(solid.triangles)
            tree.endModel()
            return tree
