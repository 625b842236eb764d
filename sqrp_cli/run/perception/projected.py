"""Where boxes, objects and the robot are expected in an image, by the robot's encoders and the camera's calibration.

What a part of an object leaves empty of its box, such as the hole of a ring, shows what is behind whether the part is
there or not: it is evidence of neither.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, partial

import numpy as np

from sqrp_cli.camera.markers import Marker
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.files.frames import frame_poses
from sqrp_cli.geometry import Array, Mask, box_corners, inverse, transform
from sqrp_cli.records import dataclass
from sqrp_cli.run.image import Corners, ImageArray, corners_of
from sqrp_cli.run.perception.detections import BelievedState, CellModel, DetectionTargets
from sqrp_cli.run.perception.vision import (
    Crop,
    FoundMarker,
    area_of,
    color_mask,
    convex_outline,
    filled,
    find_markers,
)
from sqrp_cli.run.robot_body import Surface
from sqrp_cli.shapes import Box
from sqrp_cli.skill.target_box import TargetBox, object_of

TOUCH = 1e-3  # A piece that touches a far face of a box may reach this deep into it and still is behind it [m]
LEAST_DEPTH = 0.02  # Points nearer to the lens than this [m] are not projected


@dataclass(frozen=True, eq=False)
class ProjectedBox:
    """A box in an image."""

    polygon: Array  # Its outline, (n, 2) [pixels], also beyond the image's edges
    area: float  # Of that [pixels]
    center: Array  # Image of its centre, (2,) [pixels]
    depth: float  # Of its centre [m]
    corners: Corners  # The polygon as `filled` wants it
    far_faces: Array
    """Planes of the faces that the camera does not see: outward normals in the optical frame and how far they are
    from the lens, (k, 4) [1, m]."""


@dataclass(frozen=True, eq=False)
class ProjectedPart:
    """A part of a link or an object as p convex pieces."""

    parent: str
    corners: Corners  # Of the pieces, (p, n, 2)
    depths: Array  # Of their middles [m], (p,)
    points: Array  # Their corners in the optical frame, (p, k, 3) [m]
    low: Array  # Upper left corners of the rectangles around them [pixels], (p, 2)
    high: Array  # Lower right corners of those, (p, 2)
    hull: Corners  # Around all of them


def pieces_mask(
    crop: Crop,
    parts: Iterable[ProjectedPart],
    box: ProjectedBox | None = None,
    *,
    behind: bool = False,
    links: Collection[str] | None = None,
    without: Collection[str] = (),
) -> Mask:
    """The pixels of a crop that pieces of parts cover; of those before a box only, or of those that are not before it.

    links: of these only. without: not of these. A piece is taken to be before a box with a nearer middle, and not
    behind a far face: what lies behind the plane of a face that the camera does not see hides nothing of the box, as a
    ray that has passed the plane does not come back.
    """
    origin, last = zip(*((side.start, side.stop) for side in crop[::-1]), strict=True)
    chosen: list[Corners] = []
    for part in parts:
        if part.parent in without or (links is not None and part.parent not in links):
            continue
        taken = np.asarray((part.high >= origin).all(axis=1) & (part.low <= last).all(axis=1))
        if box is not None:
            heights = part.points @ box.far_faces[:, :3].T - box.far_faces[:, 3]
            before = (part.depths < box.depth) & ~np.any(np.all(heights >= -TOUCH, axis=1), axis=1)
            taken &= before != behind
        chosen.append(part.corners[taken])
    return filled(crop, chosen)


class PosedCamera:
    """One camera at one moment."""

    def __init__(self, projection: Projection, X_WC: Array) -> None:
        """X_WC: pose of the optical frame, (4, 4)."""
        self.projection, self.X_WC, self._X_CW = projection, X_WC, inverse(X_WC)
        self.camera = projection.camera
        self.whole: Crop = (slice(0, self.camera.height), slice(0, self.camera.width))
        """All of the image."""

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
            corners=corners_of(polygon),
            far_faces=faces[faces[:, 3] >= 0.0],
        )

    def silhouette(
        self, surfaces: Iterable[Surface], X_WP: Mapping[str, Array], *, beyond: bool = False
    ) -> list[ProjectedPart]:
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
            if not visible.any():
                continue
            low, high = pixels[visible].min(axis=0), pixels[visible].max(axis=0)
            if not beyond and not ((high >= -1.0).all() and (low <= (self.camera.width, self.camera.height)).all()):
                continue
            if triangles is None:
                polygons, corners = convex_outline(pixels)[None], points[None]
            else:
                whole = triangles[visible[triangles].any(axis=1)]
                polygons, corners = pixels[whole], points[whole]
            if len(polygons):
                part = ProjectedPart(
                    parent=surface.parent,
                    corners=corners_of(polygons),
                    depths=corners[:, :, 2].mean(axis=1),
                    points=corners,
                    low=polygons.min(axis=1),
                    high=polygons.max(axis=1),
                    hull=corners_of(convex_outline(polygons.reshape(-1, 2))),
                )
                parts.append(part)
        return parts


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


FINEST = 512.0  # Pixels along the longer side of the picture in which an object is measured, at most


@dataclass(frozen=True, eq=False)
class ProjectedObject:
    """An object at a pose in an image."""

    box: ProjectedBox  # The outline of its box
    parts: Sequence[ProjectedPart]  # Its parts
    area: float  # That the parts cover of the outline [pixels], also beyond the image's edges
    offset: Array  # From the middle of the outline to that of the parts, (2,) [pixels]; 0 for an object that is a box

    @classmethod
    def of(cls, box: ProjectedBox, parts: Sequence[ProjectedPart]) -> ProjectedObject:
        """An object whose box and parts are there."""
        first, extent = corners_of(box.polygon.min(axis=0)), np.ptp(box.polygon, axis=0)
        scale = min(1.0, FINEST / float(extent.max()))
        width, height = (np.ceil(extent * scale).astype(int) + 1).tolist()
        picture = (slice(0, height), slice(0, width))
        outline, covered = (
            filled(picture, [np.rint((corners - first) * scale).astype(np.int32) for corners in polygons])
            for polygons in ([box.corners], [part.corners for part in parts])
        )
        covered &= outline
        if not covered.any():
            return cls(box, parts, 0.0, np.zeros(2))
        area = box.area * float(covered.sum() / outline.sum())
        return cls(
            box, parts, area, (np.argwhere(covered).mean(axis=0) - np.argwhere(outline).mean(axis=0))[::-1] / scale
        )

    def mask(self, crop: Crop, margin: int = 0) -> Mask:
        """The pixels that the parts cover of a crop with a margin on every side, which may reach beyond the image."""
        rows, columns = (slice(side.start - margin, side.stop + margin) for side in crop)
        crop = (rows, columns)
        return filled(crop, [self.box.corners]) & pieces_mask(crop, self.parts)


class ExpectedView(PosedCamera):
    """One image of one camera, with what is expected in it: where the robot stood, and where boxes would be."""

    def __init__(
        self,
        cell: CellModel,
        projection: Projection,
        sought: DetectionTargets,
        image: ImageArray,
        believed: BelievedState,
    ) -> None:
        self.X_WL = cell.robot.link_poses(believed.joints)
        """Where the links of the robot stood, by its encoders, (4, 4)."""
        self._X_WF = frame_poses(self.X_WL, believed.X_WO, sought.starts)
        super().__init__(projection, self._X_WF[projection.camera.frame] @ projection.camera.X_FC)
        self.cell, self.sought, self.image, self.believed = cell, sought, image, believed
        self.boxes = [(atom, box) for atom, target in sought.targets.items() for box in target.boxes]
        """All boxes to look at, each with its atom."""
        self.markers: Callable[[str], list[FoundMarker]] = cache(partial(find_markers, image))
        """The markers of a dictionary in the image."""
        self.colored: Callable[[str], Mask] = cache(partial(color_mask, image))
        """Where the image has a colour."""
        self.robot = self.silhouette(cell.robot.surfaces, self.X_WL)
        """The silhouette that the robot has in it, by its encoders."""

    def object_of(self, atom: str, box: TargetBox) -> SceneObject | None:
        """The object that a box is for."""
        name = object_of(atom, box, self.cell.objects)
        return None if name is None else self.cell.objects[name]

    def marker(self, atom: str, box: TargetBox) -> Marker | None:
        """The marker that a box is for: on a link that it encloses or moves with, or on its object."""
        on_links = [self.cell.markers[name] for name in (*box.encloses, box.frame) if name in self.cell.markers]
        obj = self.object_of(atom, box)
        return on_links[0] if on_links else obj.printed_marker if obj else None

    def pose(self, box: TargetBox) -> Array:
        """World pose of a box, (4, 4)."""
        return self._X_WF[box.frame] @ box.X_FB

    def projected(self, name: str, X_WO: Array) -> ProjectedObject | None:
        """An object at a pose (4, 4); None where some of its box is behind the camera or beyond what the lens shows."""
        box = self.outline(X_WO, self.cell.objects[name].size)
        if box is None or box.area <= 0.0:
            return None
        return ProjectedObject.of(box, self.silhouette(self.cell.surfaces[name], {name: X_WO}, beyond=True))

    def blocking(self, name: str, points_W: Array) -> list[ProjectedPart] | None:
        """The parts of an object, where it is believed to be, that stand before any of some points (n, 3) [m].

        None if such a part may cover anything, as some of the object is behind the camera.
        """
        obj, X_WO = self.cell.objects[name], self.believed.X_WO[name]
        found = []
        for part, surface in zip(obj.parts, self.cell.surfaces[name], strict=True):
            X_WB, size = (X_WO @ part.X_PG, part.shape.size) if isinstance(part.shape, Box) else (X_WO, obj.size)
            X_BW = inverse(X_WB)
            start = transform(X_BW, self.X_WC[:3, 3][None])[0]
            steps = transform(X_BW, points_W) - start
            with np.errstate(divide="ignore", invalid="ignore"):
                bounds = (np.array([-0.5, 0.5])[:, None, None] * np.asarray(size) - start) / steps
            enter, leave = bounds.min(axis=0).max(axis=1), bounds.max(axis=0).min(axis=1)
            if ((enter < leave) & (leave > 0) & (enter < 1.0 - 1e-3)).any():
                found.append(surface)
        if found and self.outline(X_WO, obj.size) is None:
            return None
        return self.silhouette(found, {name: X_WO})

    def crop(self, polygon: Array, margin: int) -> Crop | None:
        """The part of the image around a polygon (n, 2), with a margin [pixels]; None if they do not meet."""
        (left, top), (right, bottom) = polygon.min(axis=0) - margin, polygon.max(axis=0) + margin
        rows = slice(max(0, int(top)), min(self.camera.height, int(bottom) + 1))
        columns = slice(max(0, int(left)), min(self.camera.width, int(right) + 1))
        return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None

    def sought_mask(self) -> Mask:
        """The pixels that the objects which are looked for may cover, wherever they may be.

        At a tool that was commanded to hold nothing, only those that have the colour of the object. The others show
        what is behind it, which cannot be guessed from its surroundings where there is an edge, such as a table's.
        """
        anyway, of_tool = list[Corners](), dict[str, list[Corners]]()
        for atom, box in self.boxes:
            obj = self.object_of(atom, box)
            outline = self.outline(self.pose(box), obj.size if obj else box.size)
            if outline is not None:
                empty = obj is not None and box.frame in self.X_WL and not self.believed.holding
                color = obj.color if obj is not None and empty else None
                (anyway if color is None else of_tool.setdefault(color, [])).append(outline.corners)
        mask = filled(self.whole, anyway)
        for color, corners in of_tool.items():
            mask |= filled(self.whole, corners) & self.colored(color)
        return mask
