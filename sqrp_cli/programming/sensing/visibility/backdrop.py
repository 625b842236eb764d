"""What is behind a box: how much of it has the colour that its detector looks for.

Where the nearest surface behind the box has that colour, the image is the same whether the object is there or not.
Rays from the camera through the box go on to the first object behind it. The robot does not count, as its colours are
not stated; where nothing is behind, the image shows a floor or a wall without a hue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, inverse, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import SightLines
from sqrp_cli.programming.sensing.visibility.culprit import Facets, first_hits
from sqrp_cli.programming.solids import Solid
from sqrp_cli.programming.targets import SoughtBox
from sqrp_cli.shapes import Box

RAYS = 16
"""Rays across the rectangle around the image of a box, in both directions."""

LEAST_TELLING = 0.5
"""Share of a box that must be told from what is behind it, unless its detector needs to see less: colour detectors
judge an object by half of its silhouette."""

_BACK = 1e-3
"""How far before the far side of a box its backdrop begins [m], so that what it stands on counts."""

_TOGETHER = 400
"""Sight lines whose rays are followed at once, to bound the memory."""


@dataclass(frozen=True, eq=False)
class Backdrop:
    """How the boxes of v sight lines stand out from what is behind them."""

    share: Array
    """Share of the silhouette before a surface of the box's colour, in 0..1, shape (v,)."""
    by: Indices
    """Index of the solid with most of that, -1 where there is none, shape (v,)."""

    def needed(self, least: Array, lost: Array | float = 0.0) -> Array:
        """The share of each box that must be visible, where its detector needs `least` (v,): never less than that.

        Where all that looks alike is visible too, enough is left to be told from it. lost: the share of what is
        visible that cannot be told for other reasons, in 0..1, shape (v,).
        """
        told = np.maximum(1.0 - lost, 1e-9)
        telling = (np.minimum(least, LEAST_TELLING) + self.share) / told
        return np.maximum(least, np.where((self.share > 0) | (told < 1), telling, 0.0))


def backdrop_of(lines: SightLines, boxes: Sequence[SoughtBox], poses: SolidPoses, alike: Mask) -> Backdrop:
    """What is behind the boxes of sight lines, all of whose corners lie in front of the camera.

    alike: see `WatchedBoxes.alike`, shape (s, b). Lines that share a hull are looked at once, unless what may be behind
    moves.
    """
    share, by = np.zeros(len(lines.state)), np.full(len(lines.state), -1, dtype=np.int64)
    asked = _asked(lines, boxes, poses, alike)
    if asked is not None:
        asked.tell((share, by), lambda views, near: views.alike(poses, near, alike))
    return Backdrop(share, by)


def _needed(least: Array, alike: Array, lost: Array | float) -> Array:
    told = np.maximum(1.0 - lost, 1e-9)
    telling = (np.minimum(least, LEAST_TELLING) + alike) / told
    return np.maximum(least, np.where((alike > 0) | (told < 1), telling, 0.0))


class _Asked(NamedTuple):
    """Sight lines to boxes that solids of their colours may be behind."""

    line: Indices
    """By index, shape (a,)."""
    view: Indices
    """The view that each has, shape (a,)."""
    views: _Looks
    """v different ones."""
    near: Mask
    """Which solids may be behind the box of each view, shape (s, v)."""
    may_be: Mask
    """Whether any of them has the box's colour, shape (v,)."""

    def tell(self, found: tuple[Array, Array | Indices], look: Callable[[_Looks, Mask], tuple[Array, Any]]) -> None:
        """Write what looks at the views tell, some at a time, into two arrays of all lines; others stay as they are."""
        of_view = [np.zeros(len(self.may_be), values.dtype) for values in found]
        wanted = np.flatnonzero(self.may_be)
        for some in np.array_split(wanted, 1 + len(wanted) // _TOGETHER):
            if len(some):
                of_view[0][some], of_view[1][some] = look(self.views.some(some), self.near[:, some])
        looked_at = self.may_be[self.view]
        for values, told in zip(found, of_view, strict=True):
            values[self.line[looked_at]] = told[self.view[looked_at]]


def _asked(lines: SightLines, boxes: Sequence[SoughtBox], poses: SolidPoses, alike: Mask) -> _Asked | None:
    """The sight lines to boxes whose colours some solids have; None if there are none."""
    box = lines.box[lines.hull]
    can_collide: Mask = np.any(alike, axis=0)
    asked = np.flatnonzero(can_collide[box] & lines.finite[lines.hull])
    if not len(asked):
        return None
    scenery = np.array([solid.color is not None for solid in poses.solids], dtype=bool)
    keys = lines.hull[asked] if not (poses.moves & scenery).any() else asked
    _, first, same = np.unique(keys, return_index=True, return_inverse=True)
    views = _Looks.of(lines, asked[first])
    owners = [poses.solids.called(entry.seeks or "") for entry in boxes]
    near = views.near(poses, scenery)
    for column, own in enumerate(owners):
        near[np.ix_(own, views.box == column)] = False
    may_be: Mask = np.any(near & alike[:, views.box], axis=0)
    return _Asked(asked, same, views, near, may_be)


@dataclass(frozen=True, eq=False)
class _Looks:
    """Boxes as cameras see them: v views."""

    state: Indices
    """Shape (v,)."""
    box: Indices
    """Shape (v,)."""
    X_WC: Array
    """Of the optical frame, shape (v, 4, 4)."""
    X_WB: Array
    """Of the box, shape (v, 4, 4)."""
    half: Array
    """Half the extents of the box, shape (v, 3) [m]."""
    middle: Array
    """Its centre in its own frame, shape (v, 3) [m]."""
    corners: Array
    """Its corners in the world, shape (v, 8, 3) [m]."""

    @classmethod
    def of(cls, lines: SightLines, which: Indices) -> _Looks:
        hull = lines.hull[which]
        of_hulls = (lines.X_WC, lines.X_WB, lines.half_size, lines.offset, lines.corners)
        return cls(lines.state[which], lines.box[hull], *(values[hull] for values in of_hulls))

    def some(self, which: Indices) -> _Looks:
        """Some of the views, by index."""
        return _Looks(*(values[which] for values in vars(self).values()))

    def near(self, poses: SolidPoses, scenery: Mask) -> Mask:
        """Which of the solids that may be behind a box are in the cone around it, and not before it; shape (s, v)."""
        eyes = self.X_WC[:, :3, 3]
        rays = self.corners - eyes[:, None]
        axis = rays.mean(axis=1)
        axis /= _length(axis)[:, None]
        cosine = ((rays @ axis[:, :, None])[..., 0] / _length(rays)).min(axis=1)
        nearest = _length(rays).min(axis=1)
        opening = np.arccos(np.clip(cosine, -1.0, 1.0)) + np.where(nearest > 0.0, 0.0, np.pi)
        found = np.zeros((len(poses.solids), len(eyes)), dtype=bool)
        for index in np.flatnonzero(scenery).tolist():
            X_WP = poses.at(np.full(len(eyes), index), self.state)
            center = transform(X_WP, np.array(poses.solids[index].center)[None, None])[:, 0] - eyes
            away, radius = _length(center), poses.solids[index].radius
            spread = np.arcsin(np.clip(radius / np.maximum(away, 1e-9), 0.0, 1.0))
            angle = np.arccos(np.clip((center * axis).sum(axis=1) / np.maximum(away, 1e-9), -1.0, 1.0))
            found[index] = ((angle <= opening + spread) | (away <= radius)) & (away + radius > nearest)
        return found

    def alike(self, poses: SolidPoses, near: Mask, alike: Mask) -> tuple[Array, Indices]:
        """The share of each box before something alike, and the solid with most of that; near: as `near` gives it."""
        which, inside = self._first(poses, near)
        counts = np.stack([((which == index) & inside).sum(axis=1) for index in range(len(poses.solids))])
        counts = counts * alike[:, self.box]
        total = counts.sum(axis=0) / np.maximum(inside.sum(axis=1), 1)
        return total, np.where(total > 0, counts.argmax(axis=0), -1)

    def _first(self, poses: SolidPoses, near: Mask) -> tuple[Indices, Mask]:
        """The first solid behind each box on each ray, -1 for none, and whether the ray meets the box, (v, r) each."""
        start, ray, inside = self._rays()
        nearest, which = np.full(inside.shape, np.inf), np.full(inside.shape, -1, dtype=np.int64)
        for index in np.flatnonzero(near.any(axis=1)).tolist():
            rows = np.flatnonzero(near[index])
            X_PW = inverse(poses.at(np.full(len(rows), index), self.state[rows]))
            along = _hits(poses.solids[index], transform(X_PW, start[rows]), ray[rows] @ X_PW[:, :3, :3].swapaxes(1, 2))
            closer = along < nearest[rows]
            nearest[rows] = np.where(closer, along, nearest[rows])
            which[rows] = np.where(closer, index, which[rows])
        return which, inside

    def _rays(self) -> tuple[Array, Array, Mask]:
        """Where rays begin, close to the far side of the box, and their directions, (v, r, 3) each, in the world.

        Also whether each meets the box, (v, r).
        """
        corners = transform(inverse(self.X_WC), self.corners)
        image = corners[..., :2] / corners[..., 2:]
        low, high = image.min(axis=1)[:, None], image.max(axis=1)[:, None]
        steps = (np.arange(RAYS) + 0.5) / RAYS
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
        plane = low + grid * (high - low)
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1) @ self.X_WC[:, :3, :3].swapaxes(1, 2)
        rays /= _length(rays)[..., None]
        R_BW = self.X_WB[:, :3, :3].swapaxes(1, 2)
        eyes = self.X_WC[:, None, :3, 3]
        eyes_B = transform(inverse(self.X_WB), eyes) - self.middle[:, None]
        enter, leave = _slab(eyes_B, rays @ R_BW.swapaxes(1, 2), self.half[:, None])
        inside: Mask = (enter < leave) & (leave > 0)
        begin = np.where(inside, leave, 0.0) - _BACK
        return eyes + rays * begin[..., None], rays, inside


def _hits(solid: Solid, start: Array, ray: Array) -> Array:
    """How far along each ray (n, r, 3) from its start (n, r, 3) a solid is, in its parent's frame; shape (n, r)."""
    if isinstance(solid.part.shape, Box):
        X_GP = inverse(solid.part.X_PG)
        enter, leave = _slab(transform(X_GP, start), ray @ X_GP[:3, :3].T, 0.5 * np.array(solid.part.shape.size))
        return np.where((enter <= leave) & (leave > 0), np.maximum(enter, 0.0), np.inf)
    found = first_hits(start.reshape(-1, 3), ray.reshape(-1, 3), Facets.of(solid))
    return found.reshape(start.shape[:2])


def _slab(start: Array, ray: Array, half: Array) -> tuple[Array, Array]:
    """Where rays (..., 3) enter and leave boxes of half extents (..., 3) about the origin, shape (...) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (-half - start) / ray, (half - start) / ray
    return np.fmax.reduce(np.fmin(first, second), axis=-1), np.fmin.reduce(np.fmax(first, second), axis=-1)


def _length(vectors: Array) -> Array:
    """Lengths of vectors (..., 3), shape (...)."""
    length: Array = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return length
