"""What a camera's image looks like at an instant: rays through every pixel, with the camera's own lens.

The only module that knows Embree, which needs neither a display nor a graphics card.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.errors import needed
from sqrp_cli.geometry import Array, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Triangles
from sqrp_cli.show.pages.assembly import Color
from sqrp_cli.sight.scene_states import SceneStates

_LIFT = 1e-4  # how far above a surface a ray to the light starts [m], so that the surface does not shade itself
Image = NDArray[np.uint8]  # rows of pixels, shape (height, width, 3)
SUN: Array = np.array([0.35, -0.5, 1.0]) / np.linalg.norm([0.35, -0.5, 1.0])  # direction to the light, in the world
_AMBIENT, _DIRECT, _SHADE = 0.62, 0.44, 0.45
"""Ambient brightness, what the light adds, and the share of the light that reaches a shadow."""
_SKY_LOW, _SKY_HIGH = np.array([215.0, 224.0, 232.0]), np.array([247.0, 250.0, 252.0])
_OUTSIDE = 24.0  # grey of pixels that the lens does not reach
_SAME_SURFACE = 0.95  # cosine of the angle between neighbouring normals below which there is an edge
_QUARTERS = np.array([[x, y] for x in (-0.25, 0.25) for y in (-0.25, 0.25)])
"""Where a pixel on an edge is sampled instead of at its centre."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What n rays from one point hit first."""

    rays: Array  # unit vectors along them, shape (n, 3)
    shown: NDArray[np.bool_]  # whether the lens, if there is one, shows anything along them, shape (n,)
    mesh: NDArray[np.int64]  # index of the mesh, -1 for none, shape (n,)
    distance: Array  # to it, shape (n,) [m]
    normal: Array  # unit vector that looks towards the point, shape (n, 3)


class RayScene:
    """Triangle meshes that rays are cast at, and the pictures that cameras take of them."""

    def __init__(self, meshes: Iterable[Triangles]) -> None:
        """Raises InputError where Embree is missing."""
        check_rays()
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        for mesh in meshes:
            TriangleMesh(self._scene, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))

    @classmethod
    def of(cls, cell: Cell, states: SceneStates) -> RayScene:
        """The solids of a cell at one instant."""
        placed = ((states.X_WF[solid.part.parent][0], solid) for solid in cell.observer.solids)
        return cls(Triangles(transform(X, solid.vertices), solid.triangles) for X, solid in placed)

    def first_hits(self, origin: Array, directions: Array) -> Hits:
        """What rays from `origin`, (3,), along unit vectors, (n, 3), hit first."""
        origins = np.broadcast_to(origin, directions.shape).astype(np.float32)
        found = self._scene.run(origins, directions.astype(np.float32), output=True)
        normal = found["Ng"].astype(float)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        away = np.einsum("ni,ni->n", normal, directions) > 0
        normal[away] *= -1
        shown = np.ones(len(directions), dtype=bool)
        return Hits(directions, shown, found["geomID"].astype(np.int64), found["tfar"].astype(float), normal)

    def blocked(self, points: Array, normals: Array, direction: Array) -> NDArray[np.bool_]:
        """Whether anything lies beyond points, (n, 3), along one unit vector, (3,): (n,)."""
        origins = (points + _LIFT * normals).astype(np.float32)
        directions = np.broadcast_to(direction, points.shape).astype(np.float32)
        blocked: NDArray[np.bool_] = self._scene.run(origins, directions, query="OCCLUDED") >= 0
        return blocked

    def view(self, camera: Camera, X_WC: Array, pixels: Array) -> Hits:
        """What rays through pixels of shape (n, 2) of a camera hit in the world."""
        plane, shown = Projection(camera).plane(pixels)
        rays_C = np.column_stack([plane, np.ones(len(plane))])
        rays_C /= np.linalg.norm(rays_C, axis=1, keepdims=True)
        return replace(self.first_hits(X_WC[:3, 3], rays_C @ X_WC[:3, :3].T), shown=shown)

    def image(self, camera: Camera, X_WC: Array, colors: Sequence[Color]) -> Image:
        """What the camera sees; colors: of every mesh. Pixels on edges are sampled four times."""
        width, height = camera.width, camera.height
        paint = np.array(colors, dtype=float)
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
        hits = self.view(camera, X_WC, pixels)
        shades = self._shades(X_WC[:3, 3], hits, paint)
        # Pixels next to one that shows another part, or a surface with another normal.
        mesh, normal = hits.mesh.reshape(height, width), hits.normal.reshape(height, width, 3)
        on_edge = np.zeros((height, width), dtype=bool)
        for before, after in (np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:]):
            turned = np.einsum("...i,...i", normal[before], normal[after]) < _SAME_SURFACE
            change = (mesh[before] != mesh[after]) | (turned & (mesh[before] >= 0))
            on_edge[before] |= change
            on_edge[after] |= change
        edges = np.flatnonzero(on_edge)
        finer = self.view(camera, X_WC, (pixels[edges, None] + _QUARTERS).reshape(-1, 2))
        shades[edges] = self._shades(X_WC[:3, 3], finer, paint).reshape(-1, 4, 3).mean(axis=1)
        return np.clip(shades, 0, 255).round().astype(np.uint8).reshape(height, width, 3)

    def _shades(self, eye: Array, hits: Hits, paint: Array) -> Array:
        """Colours of hits, (n, 3), with a light and its shadows. eye: of the camera. paint: of each mesh, (s, 3)."""
        rays = hits.rays
        shades: Array = _SKY_LOW + np.clip(0.5 + rays[:, 2:], 0, 1) * (_SKY_HIGH - _SKY_LOW)
        rows = np.flatnonzero(hits.mesh >= 0)
        points, normals = eye + hits.distance[rows, None] * rays[rows], hits.normal[rows]
        lit = np.maximum(normals @ SUN, 0.0)
        turned = np.flatnonzero(lit > 0)
        lit[turned[self.blocked(points[turned], normals[turned], SUN)]] *= _SHADE
        towards = np.abs(np.einsum("ni,ni->n", normals, rays[rows]))
        light = _AMBIENT * (0.8 + 0.2 * towards) + _DIRECT * lit
        shades[rows] = paint[hits.mesh[rows]] * light[:, None]
        shades[~hits.shown] = _OUTSIDE
        return shades


def check_rays() -> None:
    """Raises InputError, with the command that installs it, where Embree is missing."""
    with needed("pictures need the Python package `embreex`, which is not installed", "pip install embreex"):
        import embreex.mesh_construction
        import embreex.rtcore_scene  # noqa: F401
