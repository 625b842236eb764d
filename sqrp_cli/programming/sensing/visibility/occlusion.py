"""Occlusion: the solids that reach into the view hull of a box.

The hull decides for the whole box at once; rays to its corners would miss thin occluders. `near_pairs` culls by bounds
only: first balls around the solids against cones around the hulls, for all states at once; then boxes around the
remaining solids against ten planes around the hull, and the hull against the boxes. Each comparison tests whether a
solid is beyond a bound, so NaN counts as near. `HullTester` tests the remaining pairs exactly on the meshes, with coal
where no point of the solid is a witness.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np

from sqrp_cli.geometry import BOX_SIGNS, Array, Indices, Mask, Ranges, ranges
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import TOUCH, Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import witnessed
from sqrp_cli.programming.solids import Solid
from sqrp_cli.shapes import BOX_TRIANGLES

_PAIRS_AT_ONCE = 131_072
"""Pairs of view hull and solid to compare at once: the data should fit the cache."""

ROUGH = 1e-6
"""Distance up to which a ball counts as touching a cone, more than all rounding [m]."""

_LEAST_DEPTH = 1e-6
"""Depth of a box's nearest corner [m] below which the box has no bounded image, and its hull no cone."""


def near_pairs(lines: SightLines, poses: SolidPoses, opaque: Mask, margin: float = 0.0) -> Pairs:
    """The pairs whose view hull and bounding volume may touch, ordered by sight line, then by solid.

    opaque: which solids can hide which box, shape (s, b). margin: distance up to which they count as touching [m].
    """
    solids = np.flatnonzero(opaque.any(axis=1))
    if not len(lines.state) or not len(solids):
        return Pairs(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    hulls = _HullBounds.of(lines, margin)
    moves = poses.moves[solids]
    every_hull = np.arange(len(lines.box))
    # Solids at rest are compared with each hull once, for all its lines.
    standing = _Bounds.of(poses, solids[~moves], count=1)
    of_hull = hulls.near(every_hull, standing, np.zeros_like(every_hull), opaque)
    at, line = _all_lines_of(of_hull.line, lines)
    moving = _Bounds.of(poses, solids[moves], count=int(lines.state.max()) + 1)
    moved = hulls.near(lines.hull, moving, lines.state, opaque)
    line, solid = np.concatenate([line, moved.line]), np.concatenate([of_hull.solid[at], moved.solid])
    order = np.lexsort((solid, line))
    return Pairs(line[order], solid[order])


class HullTester:
    """Tests view hulls against solids with coal; holds one convex shape whose points are overwritten for each hull."""

    def __init__(self, points: int = 9) -> None:
        """points: of which each hull is made; coal takes no more than 32 without their neighbours."""
        faces = coal.StdVec_Triangle()
        for triangle in BOX_TRIANGLES.tolist():
            faces.append(coal.Triangle(*triangle))
        corners = coal.StdVec_Vec3s()
        corners.extend([*BOX_SIGNS, *(np.array([0.0, 0.0, 3.0]) for _ in range(points - len(BOX_SIGNS)))])
        # The support function uses only the points; coal requires some faces.
        self._hull = coal.Convex(corners, faces)
        self._points = self._hull.points()
        self._at_origin = coal.Transform3s.Identity()
        self._placement = coal.Transform3s.Identity()
        self._request = coal.CollisionRequest()
        self._result = coal.CollisionResult()

    def met(self, lines: SightLines, poses: SolidPoses, pairs: Pairs, *, first_only: bool) -> Pairs:
        """Those of the pairs whose solid reaches into its view hull; not all of a line's if `first_only`.

        A hull that is not finite counts as met. Most pairs are decided by points of the solid that lie in the hull.
        """
        if not len(pairs):
            return pairs
        found = witnessed(lines, poses, pairs)
        settled = set(pairs.line[found].tolist()) if first_only else set()
        hulls = self.hulls(lines)
        hull_of, states, finite = (column.tolist() for column in (lines.hull, lines.state, lines.finite))
        still: dict[tuple[int, int], bool] = {}
        placements = {index: _placements(poses, index) for index in np.unique(pairs.solid).tolist()}
        loaded, left = -1, np.flatnonzero(~found)
        for row, line, index in zip(left.tolist(), pairs.line[left].tolist(), pairs.solid[left].tolist(), strict=True):
            if line in settled:
                continue
            rotations, translations = placements[index]
            hull, fixed = hull_of[line], len(translations) == 1
            hit = still.get((hull, index)) if fixed else None
            if hit is None:
                if hull != loaded:
                    self._points[:] = hulls[hull]
                    loaded = hull
                at = 0 if fixed else states[line]
                self._placement.setRotation(rotations[at])
                self._placement.setTranslation(translations[at])
                hit = not finite[hull] or self._meets(poses.solids[index])
                if fixed:
                    still[hull, index] = hit
            found[row] = hit
            if hit and first_only:
                settled.add(line)
        return pairs.some(found)

    def hulls(self, lines: SightLines) -> Array:
        """Points of each view hull, shape (h, points, 3) [m]."""
        return np.concatenate([lines.corners, lines.eyes[:, None]], axis=1)

    def _meets(self, solid: Solid) -> bool:
        self._result.clear()
        contacts: int = coal.collide(
            self._hull, self._at_origin, solid.geometry, self._placement, self._request, self._result
        )
        return contacts > 0


def _placements(poses: SolidPoses, solid: int) -> tuple[Array, Array]:
    """The rotations (b, 3, 3) and positions (b, 3) of a solid's shape in the world; b is 1 where it stands still."""
    X_WG = poses.pose(solid) @ poses.solids[solid].part.X_PG
    return np.ascontiguousarray(X_WG[:, :3, :3]), np.ascontiguousarray(X_WG[:, :3, 3])


def _all_lines_of(hull: Indices, lines: SightLines) -> Ranges:
    """Every sight line of each hull (n,); a hull's lines follow each other."""
    first = np.searchsorted(lines.hull, np.arange(len(lines.box) + 1))
    return ranges(first[hull], first[hull + 1])


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Balls and boxes around s of the solids in m states, with the same centres."""

    solids: Indices
    """Indices of these solids, shape (s,)."""
    centers: Array
    """In the world, coordinate first, shape (3, s, m) [m]."""
    radii: Array
    """Of the balls, shape (s, 1) [m]."""
    half_axes: Array
    """Of the boxes, in the world, axis first and coordinate second, shape (3, 3, s, m) [m]."""

    @classmethod
    def of(cls, poses: SolidPoses, solids: Indices, count: int) -> _Bounds:
        """The bounds of some of the solids in the first `count` states."""
        axes_and_center = np.empty((4, 3, len(solids), count))
        if count == 1 and len(solids):
            X_WP = np.concatenate([poses.pose(index)[:1] for index in solids.tolist()])
            columns_W = X_WP @ poses.solids.boxes[solids]
            axes_and_center[..., 0] = columns_W[:, :3].transpose(2, 1, 0)
        else:
            for row, index in enumerate(solids.tolist()):
                # One product of two matrices instead of one for every state.
                columns_W = (poses.pose(index)[:count].reshape(-1, 4) @ poses.solids.boxes[index]).reshape(-1, 4, 4)
                axes_and_center[:, :, row] = columns_W[:, :3].transpose(2, 1, 0)
        radii = poses.solids.radii[solids, None]
        return cls(solids=solids, centers=axes_and_center[3], radii=radii, half_axes=axes_and_center[:3])

    def from_eyes(self, eyes: Array, axes: Array, state: Indices) -> tuple[Array, Array]:
        """How far along and aside of n axes from eyes, each in a state, the centres lie [m], shape (s, n) each.

        eyes, axes: shape (3, n). With an error of up to `ROUGH` aside.
        """
        if self.centers.shape[2] > 1:
            away = [self.centers[k][:, state] - eyes[k] for k in range(3)]
            along, squared = _dot(away, axes), _dot(away, away)
        else:
            # Two products of matrices: |p - e|^2 = |p|^2 - 2 p . e + |e|^2.
            points = self.centers[:, :, 0].T
            along = points @ axes - _dot(eyes, axes)
            squared = points @ (-2.0 * eyes)
            squared += (points * points).sum(axis=1, keepdims=True)
            squared += _dot(eyes, eyes)
        squared -= along * along
        np.maximum(squared, 0.0, out=squared)
        return along, np.sqrt(squared, out=squared)


@dataclass(frozen=True, eq=False)
class _HullBounds:
    """Bounds of h view hulls in the world, coordinate first."""

    box: Indices
    """Index of the box of each hull, shape (h,)."""
    cones: Array
    """x, y, z of the eye, x, y, z of the axis (unit), cosine and sine of half the opening, and length [m], (9, h)."""
    planes: Array
    """Unit normal n and offset o of ten planes, with n . p > o for every point p outside the plane, (10, 4, h)."""
    points: Array
    """Corners of the boxes, and the eyes, shape (3, 9, h) [m]."""
    margin: float
    """See `near_pairs` [m]."""

    @classmethod
    def of(cls, lines: SightLines, margin: float) -> _HullBounds:
        eyes, corners = lines.eyes.T, np.ascontiguousarray(lines.corners.transpose(2, 1, 0))
        rays = corners - eyes[:, None]
        axis = rays.mean(axis=1)
        axis /= _norm(axis)
        depth = _dot(rays, axis[:, None])
        bounded = depth.min(axis=0) > _LEAST_DEPTH  # false for NaN: then anything may be near
        cosine = np.where(bounded, (depth / _norm(rays)).min(axis=0), 0.0)
        sine = np.where(bounded, np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)), 0.0)
        length = np.where(bounded, depth.max(axis=0), np.inf)
        planes = _planes(eyes, rays, axis, np.where(bounded, depth, 1.0))
        planes[:, :, ~bounded] = 0.0
        points = np.concatenate([corners, eyes[:, None]], axis=1)
        cones = np.concatenate([eyes, axis, [cosine, sine, length]])
        return cls(box=lines.box, cones=cones, planes=planes, points=points, margin=margin)

    def near(self, hull: Indices, bounds: _Bounds, state: Indices, opaque: Mask) -> Pairs:
        """Which solids may reach into which of n hulls, each in a state, shape (n,), by place among those n.

        opaque: see `near_pairs`.
        """
        opaque, found = opaque[bounds.solids], [Pairs(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
        size = max(1, _PAIRS_AT_ONCE // max(1, len(bounds.solids)))
        for start in range(0, len(hull) if len(bounds.solids) else 0, size):
            of, at = hull[start : start + size], state[start : start + size]
            near = self.meet_balls(of, bounds, at) & opaque[:, self.box[of]]
            index, row = np.nonzero(near)
            kept = self.meet_boxes(of[row], bounds, index, at[row])
            found.append(Pairs(row[kept] + start, bounds.solids[index[kept]]))
        return Pairs(np.concatenate([p.line for p in found]), np.concatenate([p.solid for p in found]))

    def meet_balls(self, hull: Indices, bounds: _Bounds, state: Indices) -> Mask:
        """Whether the cone of each hull (n,) may touch each ball in a state (n,); shape (s, n)."""
        cones = self.cones[:, hull]
        cosine, sine, length = cones[6:]
        along, aside = bounds.from_eyes(cones[:3], cones[3:6], state)
        reach = bounds.radii + (ROUGH + self.margin)
        beyond: Mask = along < -reach
        beyond |= along > reach + length  # never of a hull without a cone, which is endless
        aside *= cosine
        along *= sine
        aside -= along
        beyond |= aside > reach
        return ~beyond

    def meet_boxes(self, hull: Indices, bounds: _Bounds, solid: Indices, state: Indices) -> Indices:
        """Which hulls (n,) may touch the box around a solid (n,) in a state (n,), by index."""
        center, half_axes = bounds.centers[:, solid, state], bounds.half_axes[:, :, solid, state]
        points, touch = self.points[:, :, hull] - center[:, None], TOUCH + self.margin
        beyond = np.zeros(len(hull), dtype=bool)
        for half_axis in half_axes:
            # The hull does not reach into the box if all of its points lie beyond the same face.
            along, length = _dot(points, half_axis), _norm(half_axis)
            reach = length * (length + touch)
            beyond |= (along.min(axis=0) > reach) | (along.max(axis=0) < -reach)
        kept = np.flatnonzero(~beyond)
        planes, center, half_axes = self.planes[:, :, hull[kept]], center[:, kept], half_axes[:, :, kept]
        normals = planes[:, :3].swapaxes(0, 1)
        extent = sum(np.abs(_dot(normals, half_axis)) for half_axis in half_axes)
        outside = (_dot(normals, center) - extent > planes[:, 3] + touch).any(axis=0)
        return kept[~outside]


def _planes(eyes: Array, rays: Array, axis: Array, depth: Array) -> Array:
    """Ten planes around each view hull: eight beside it, through the eye, one behind the box and one behind the eye.

    The eight bound the box's image by an octagon. eyes, axis: shape (3, h). rays: from the eyes to the corners, shape
    (3, 8, h); depth: of the corners, shape (8, h). Returns shape (10, 4, h).
    """
    zero = np.zeros_like(axis[0])
    upright = np.abs(axis[2]) < 0.9  # across the axis and whichever of z and x is far from parallel to it
    right = np.where(upright, np.stack([axis[1], -axis[0], zero]), np.stack([zero, axis[2], -axis[1]]))
    right /= _norm(right)
    up = np.stack([right[(i + 1) % 3] * axis[(i + 2) % 3] - right[(i + 2) % 3] * axis[(i + 1) % 3] for i in range(3)])
    a, b = _dot(rays, right[:, None]) / depth, _dot(rays, up[:, None]) / depth
    diagonal = np.sqrt(0.5)
    slopes = np.stack([a, b, diagonal * (a + b), diagonal * (a - b)])
    across = np.stack([right, up, diagonal * (right + up), diagonal * (right - up)])
    planes = np.empty((10, 4, axis.shape[1]))
    planes[0:4, :3] = across - slopes.max(axis=1)[:, None] * axis
    planes[4:8, :3] = slopes.min(axis=1)[:, None] * axis - across
    planes[8, :3], planes[9, :3] = axis, -axis
    planes[:, :3] /= np.sqrt((planes[:, :3] ** 2).sum(axis=1))[:, None]
    planes[:, 3] = _dot(planes[:, :3].swapaxes(0, 1), eyes)
    planes[8, 3] += depth.max(axis=0)
    return planes


def _dot(a: Array | list[Array] | tuple[Array, ...], b: Array | list[Array] | tuple[Array, ...]) -> Array:
    """Inner products of vectors whose coordinates come first."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _norm(vectors: Array) -> Array:
    """Lengths of vectors whose coordinates come first."""
    return np.sqrt(_dot(vectors, vectors))
