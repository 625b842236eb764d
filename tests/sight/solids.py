"""Makers of solids for the tests of sensing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, pose
from sqrp_cli.shapes import Mesh, Part
from sqrp_cli.sight.solids import Solid


def solid_of(vertices: Array, triangles: NDArray[np.int64]) -> Solid:
    """A mesh of triangles in the world frame, with a box along its axes around it. It has no file."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    center = (low + high) / 2
    return Solid(
        part=Part("shape", "world", Mesh(Path("shape.stl")), pose()),
        name="shape",
        vertices=vertices,
        triangles=triangles,
        center=center,
        radius=float(np.linalg.norm(vertices - center, axis=1).max()),
        corners=center + BOX_SIGNS * (high - low) / 2,
        half_axes=np.diag((high - low) / 2),
    )
