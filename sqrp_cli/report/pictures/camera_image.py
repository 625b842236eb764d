"""What a camera's image looks like at an instant: rays through every pixel, with the camera's own lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.report.pages.paint import Color
from sqrp_cli.report.pictures.rays import Hits, RayScene, directions
from sqrp_cli.shapes import Triangles

Image = NDArray[np.uint8]
"""Rows of pixels, shape (height, width, 3)."""

SUN: Array = np.array([0.35, -0.5, 1.0]) / np.linalg.norm([0.35, -0.5, 1.0])
"""Direction to the light, in the world."""

_AMBIENT, _DIRECT, _SHADE = 0.62, 0.44, 0.45
"""Ambient brightness, what the light adds, and the share of the light that reaches a shadow."""

_SKY_LOW, _SKY_HIGH = np.array([215.0, 224.0, 232.0]), np.array([247.0, 250.0, 252.0])
_OUTSIDE = 24.0
"""Grey of pixels that the lens does not reach."""

_SAME_SURFACE = 0.95
"""Cosine of the angle between neighbouring normals below which there is an edge."""

_QUARTERS = np.array([[x, y] for x in (-0.25, 0.25) for y in (-0.25, 0.25)])
"""Where a pixel on an edge is sampled instead of at its centre."""


@dataclass(frozen=True, eq=False)
class PixelView:
    """What a camera sees at n pixels.

    eye: its centre in the world, (3,). rays: unit vectors in the world, (n, 3). shown: whether the lens shows anything
    there, (n,). hits: what the rays hit first.
    """

    eye: Array
    rays: Array
    shown: NDArray[np.bool_]
    hits: Hits


class Photographer:
    """Takes pictures of a cell in one state."""

    def __init__(self, cell: Cell, states: SceneStates) -> None:
        """States: of one instant."""
        self._states = states
        solids = cell.observer.solids
        self._scene = RayScene(
            [
                Triangles(transform(states.X_WF[solid.part.parent][0], solid.vertices), solid.triangles)
                for solid in solids
            ]
        )

    def image(self, camera: Camera, colors: Sequence[Color]) -> Image:
        """What the camera sees; colors: of every solid. Pixels on edges are sampled four times."""
        width, height = camera.width, camera.height
        paint = np.array(colors, dtype=float)
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
        view = self.view(camera, pixels)
        shades = self._shades(view, paint)
        edges = np.flatnonzero(_edges(view.hits, (height, width)))
        finer = self.view(camera, (pixels[edges, None] + _QUARTERS).reshape(-1, 2))
        shades[edges] = self._shades(finer, paint).reshape(-1, 4, 3).mean(axis=1)
        return np.clip(shades, 0, 255).round().astype(np.uint8).reshape(height, width, 3)

    def view(self, camera: Camera, pixels: Array) -> PixelView:
        """What the camera sees at pixels of shape (n, 2)."""
        X_WC = self._states.camera_poses(camera)[0]
        rays_C, shown = directions(Projection.of(camera), pixels)
        rays = rays_C @ X_WC[:3, :3].T
        return PixelView(X_WC[:3, 3], rays, shown, self._scene.first_hits(X_WC[:3, 3], rays))

    def _shades(self, view: PixelView, paint: Array) -> Array:
        """Colours of the hits, shape (n, 3), with a light and its shadows."""
        rays, hits = view.rays, view.hits
        shades: Array = _SKY_LOW + np.clip(0.5 + rays[:, 2:], 0, 1) * (_SKY_HIGH - _SKY_LOW)
        rows = np.flatnonzero(hits.mesh >= 0)
        points, normals = view.eye + hits.distance[rows, None] * rays[rows], hits.normal[rows]
        lit = np.maximum(normals @ SUN, 0.0)
        turned = np.flatnonzero(lit > 0)
        lit[turned[self._scene.blocked(points[turned], normals[turned], SUN)]] *= _SHADE
        towards = np.abs(np.einsum("ni,ni->n", normals, rays[rows]))
        light = _AMBIENT * (0.8 + 0.2 * towards) + _DIRECT * lit
        shades[rows] = paint[hits.mesh[rows]] * light[:, None]
        shades[~view.shown] = _OUTSIDE
        return shades


def _edges(hits: Hits, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels next to one that shows another part, or a surface with another normal."""
    mesh, normal = hits.mesh.reshape(shape), hits.normal.reshape(*shape, 3)
    edges = np.zeros(shape, dtype=bool)
    for before, after in (np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:]):
        turned = np.einsum("...i,...i", normal[before], normal[after]) < _SAME_SURFACE
        change = (mesh[before] != mesh[after]) | (turned & (mesh[before] >= 0))
        edges[before] |= change
        edges[after] |= change
    return edges.reshape(-1)
