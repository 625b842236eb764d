"""Where boxes, objects and the robot are in an image, by the robot's encoders and the camera's calibration.

What a part of an object leaves empty of its box, such as the hole of a ring, shows what is behind whether the part is
there or not: it is evidence of neither.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, Mask, box_corners, inverse, transform
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.runtime.perception.vision import Corners, Crop, area_of, convex_outline, corners_of, filled, middle
from sqrp_cli.runtime.surface import Surface

TOUCH = 1e-3
"""A piece that touches a far face of a box may reach this deep into it and still is behind it [m]."""

LEAST_DEPTH = 0.02
"""Points nearer to the lens than this [m] are not projected."""


@dataclass(frozen=True, eq=False)
class ProjectedBox:
    """A box in an image."""

    polygon: Array
    """Its outline, (n, 2) [pixels], also beyond the image's edges."""
    area: float
    """Of that [pixels]."""
    center: Array
    """Image of its centre, (2,) [pixels]."""
    depth: float
    """Of its centre [m]."""
    far_faces: Array
    """Planes of the faces that the camera does not see: outward normals in the optical frame and how far they are
    from the lens, (k, 4) [1, m]."""

    def is_hidden_by(self, part: _ProjectedPart) -> Mask:
        """Which pieces of a part are taken to be before it, (p,): with a nearer middle, and not behind a far face.

        What lies behind the plane of a face that the camera does not see hides nothing of the box: a ray that has
        passed the plane does not come back.
        """
        heights = part.points @ self.far_faces[:, :3].T - self.far_faces[:, 3]
        before: Mask = (part.depths < self.depth) & ~np.any(np.all(heights >= -TOUCH, axis=1), axis=1)
        return before

    @property
    def corners(self) -> Corners:
        """The polygon as `filled` wants it."""
        return corners_of(self.polygon)


@dataclass(frozen=True, eq=False)
class ProjectedParts:
    """Solid parts in an image, as convex pieces: those of the robot, or of an object."""

    parts: tuple[_ProjectedPart, ...]

    def mask(
        self,
        crop: Crop,
        box: ProjectedBox | None = None,
        *,
        behind: bool = False,
        links: Collection[str] | None = None,
        without: Collection[str] = (),
    ) -> Mask:
        """The pixels of a crop that the pieces cover, or only those before a box; behind: those that are not before it.

        links: of these only. without: not of these.
        """
        origin, last = crop.origin, (crop.columns.stop, crop.rows.stop)
        chosen: list[Corners] = []
        for part in self.parts:
            if part.parent in without or (links is not None and part.parent not in links):
                continue
            if (part.low.min(axis=0) > last).any() or (part.high.max(axis=0) < origin).any():
                continue
            taken = True if box is None else box.is_hidden_by(part) != behind
            touching = taken & (part.high >= origin).all(axis=1) & (part.low <= last).all(axis=1)
            chosen.append(part.corners[touching])
        return filled(crop, chosen)

    def cover(self, crop: Crop) -> Mask:
        """Pixels of a crop that hold all of the robot, and a little more: the hull of each part."""
        return filled(crop, [part.hull for part in self.parts])


@dataclass(frozen=True, eq=False)
class _ProjectedPart:
    """A part of a link or an object as p convex pieces."""

    parent: str
    corners: Corners
    """Of the pieces, (p, n, 2)."""
    depths: Array
    """Of their middles [m], (p,)."""
    points: Array
    """Their corners in the optical frame, (p, k, 3) [m]."""
    low: Array
    """Upper left corners of the rectangles around them [pixels], (p, 2)."""
    high: Array
    """Lower right corners of those, (p, 2)."""
    hull: Corners
    """Around all of them."""

    @classmethod
    def of(cls, parent: str, polygons: Array, points: Array) -> _ProjectedPart:
        hull = corners_of(convex_outline(polygons.reshape(-1, 2)))
        depths = points[:, :, 2].mean(axis=1)
        return cls(parent, corners_of(polygons), depths, points, polygons.min(axis=1), polygons.max(axis=1), hull)


class PosedCamera:
    """One camera at one moment."""

    def __init__(self, projection: Projection, X_WC: Array) -> None:
        """X_WC: pose of the optical frame, (4, 4)."""
        self.projection, self.X_WC, self._X_CW = projection, X_WC, inverse(X_WC)
        self.camera = projection.camera
        self.whole = Crop.whole(self.camera.height, self.camera.width)

    def outline(self, X_WB: Array, size: Sequence[float]) -> ProjectedBox | None:
        """A box of full extents `size` [m]; None where some of it is behind or beyond what the lens shows."""
        corners = transform(self._X_CW, transform(X_WB, box_corners(size)))
        if corners[:, 2].min() < LEAST_DEPTH:
            return None
        pixels, inside = self.projection.pixels(corners)
        if not inside.all():
            return None
        center = corners.mean(axis=0)
        polygon = convex_outline(pixels)
        normals = np.concatenate([np.eye(3), -np.eye(3)]) @ (self._X_CW[:3, :3] @ X_WB[:3, :3]).T
        faces = np.column_stack([normals, normals @ center + 0.5 * np.tile(size, 2)])
        return ProjectedBox(
            polygon=polygon,
            area=area_of(polygon),
            center=self.projection.pixels(center[None])[0][0],
            depth=float(center[2]),
            far_faces=faces[faces[:, 3] >= 0.0],
        )

    def silhouette(
        self, surfaces: Iterable[Surface], X_WP: Mapping[str, Array], *, beyond: bool = False
    ) -> ProjectedParts:
        """Parts whose links or objects have given poses; of what reaches behind the camera, what is before it.

        beyond: with the parts that lie beyond the image's edges.
        """
        parts = []
        for surface in surfaces:
            points = transform(self._X_CW @ X_WP[surface.parent], surface.vertices)
            triangles = surface.triangles
            if triangles is None:
                points = _before_lens(points)
            elif points[:, 2].min() < LEAST_DEPTH:
                points = _cut(points[triangles]).reshape(-1, 3)
                triangles = np.arange(len(points)).reshape(-1, 3)
            pixels, visible = self.projection.pixels(points)
            if not visible.any() or not (beyond or self._reaches_image(pixels[visible])):
                continue
            if triangles is None:
                polygons, corners = convex_outline(pixels)[None], points[None]
            else:
                whole = triangles[visible[triangles].any(axis=1)]
                polygons, corners = pixels[whole], points[whole]
            if len(polygons):
                parts.append(_ProjectedPart.of(surface.parent, polygons, corners))
        return ProjectedParts(tuple(parts))

    def _reaches_image(self, pixels: Array) -> bool:
        """Whether the rectangle around pixels (n, 2) meets the image."""
        size = (self.camera.width, self.camera.height)
        return bool((pixels.max(axis=0) >= -1.0).all() and (pixels.min(axis=0) <= size).all())

    def hides(self, X_WB: Array, size: Sequence[float], points_W: Array) -> bool:
        """Whether a box of full extents `size` stands between the camera and any of some points (n, 3) [m]."""
        X_BW = inverse(X_WB)
        start = transform(X_BW, self.X_WC[:3, 3][None])[0]
        steps = transform(X_BW, points_W) - start
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds = (np.array([-0.5, 0.5])[:, None, None] * np.asarray(size) - start) / steps
        enter, leave = bounds.min(axis=0).max(axis=1), bounds.max(axis=0).min(axis=1)
        return bool(((enter < leave) & (leave > 0) & (enter < 1.0 - 1e-3)).any())


def _before_lens(points: Array) -> Array:
    """Points whose hull is what of that of points (n, 3) in the optical frame is far enough before the lens [m]."""
    depth = points[:, 2] - LEAST_DEPTH
    near, far = points[depth < 0.0], points[depth >= 0.0]
    if not len(near) or not len(far):
        return far
    share = depth[depth >= 0.0, None] / (far[:, None, 2] - near[:, 2])
    met = far[:, None] + share[..., None] * (near - far[:, None])
    met[..., 2] = LEAST_DEPTH
    return np.concatenate([far, met.reshape(-1, 3)])


def _cut(triangles: Array) -> Array:
    """What of triangles (p, 3, 3) in the optical frame is far enough before the lens [m], as triangles (m, 3, 3)."""
    depth = triangles[..., 2]
    reaching = triangles[(depth.min(axis=1) < LEAST_DEPTH) & (depth.max(axis=1) > LEAST_DEPTH)]
    far, middle, near = np.take_along_axis(reaching, reaching[..., 2:].argsort(axis=1), axis=1)[:, ::-1].swapaxes(0, 1)
    middle, end = _before(far, middle), _before(far, near)
    pieces = np.stack([far, middle, end, middle, _before(middle, near), end], axis=1).reshape(-1, 3, 3)
    return np.concatenate([triangles[depth.min(axis=1) >= LEAST_DEPTH], pieces])


def _before(start: Array, end: Array) -> Array:
    """How far lines (n, 3) from before the lens to no deeper ends stay there: their last points that do, (n, 3) [m]."""
    share = (start[:, 2:] - LEAST_DEPTH) / np.maximum(start[:, 2:] - end[:, 2:], 1e-12)
    return start + np.minimum(share, 1.0) * (end - start)


FINEST = 512.0
"""Pixels along the longer side of the picture in which an object is measured, at most."""


@dataclass(frozen=True, eq=False)
class ProjectedObject:
    """An object at a pose in an image."""

    box: ProjectedBox
    """The outline of its box."""
    parts: ProjectedParts
    """The silhouette of its parts."""
    area: float
    """That the parts cover of the outline [pixels], also beyond the image's edges."""
    offset: Array
    """From the middle of the outline to that of the parts, (2,) [pixels]; 0 for an object that is a box."""

    @classmethod
    def of(cls, box: ProjectedBox, parts: ProjectedParts) -> ProjectedObject:
        """An object whose box and parts are there."""
        first, extent = corners_of(box.polygon.min(axis=0)), np.ptp(box.polygon, axis=0)
        scale = min(1.0, FINEST / float(extent.max()))
        width, height = (np.ceil(extent * scale).astype(int) + 1).tolist()

        def drawn(polygons: Iterable[Corners]) -> Mask:
            scaled = (np.rint((corners - first) * scale).astype(np.int32) for corners in polygons)
            return filled(Crop.whole(height, width), scaled)

        outline = drawn([box.corners])
        covered = outline & drawn(piece.corners for piece in parts.parts)
        if not covered.any():
            return cls(box, parts, 0.0, np.zeros(2))
        area = box.area * float(covered.sum() / outline.sum())
        return cls(box, parts, area, (middle(covered) - middle(outline)) / scale)

    def mask(self, crop: Crop) -> Mask:
        """The pixels of a crop that the parts cover."""
        return self.outline(crop) & self.parts.mask(crop)

    def outline(self, crop: Crop) -> Mask:
        """The pixels of a crop that the box covers."""
        return filled(crop, [self.box.corners])
