"""One image, with everything that is known of its moment: where the robot stood, and where boxes would be in it."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.frames import frame_poses
from sqrp_cli.knowledge.markers import Marker
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill.target_box import TargetBox, object_of
from sqrp_cli.runtime.image import ImageArray
from sqrp_cli.runtime.perception.detections import BelievedState, CellModel, DetectionTargets
from sqrp_cli.runtime.perception.projected import PosedCamera, ProjectedObject, ProjectedParts
from sqrp_cli.runtime.perception.vision import Corners, Crop, FoundMarker, color_mask, dilated, filled, find_markers
from sqrp_cli.shapes import Box


class ExpectedView:
    """One image of one camera, with what is expected in it."""

    def __init__(
        self,
        cell: CellModel,
        projection: Projection,
        sought: DetectionTargets,
        image: ImageArray,
        believed: BelievedState,
    ) -> None:
        camera = projection.camera
        self.camera, self.cell, self.sought = camera, cell, sought
        self.image, self.believed = image, believed
        self._X_WL = cell.robot.link_poses(believed.joints)
        self._markers: dict[str, list[FoundMarker]] = {}
        self._X_WF = frame_poses(self._X_WL, believed.X_WO, sought.starts)
        self.posed_camera = PosedCamera(projection, self._X_WF[camera.frame] @ camera.X_FC)
        self.robot: ProjectedParts = self.posed_camera.silhouette(cell.robot.surfaces, self._X_WL)
        """The silhouette that the robot has in it, by its encoders."""

    def markers(self, dictionary: str) -> list[FoundMarker]:
        """The markers of a dictionary in the image."""
        if dictionary not in self._markers:
            self._markers[dictionary] = find_markers(self.image, dictionary)
        return self._markers[dictionary]

    def boxes(self) -> Iterator[tuple[str, TargetBox]]:
        """All boxes to look at, each with its atom."""
        for atom, target in self.sought.targets.items():
            for box in target.boxes:
                yield atom, box

    def object_of(self, atom: str, box: TargetBox) -> SceneObject | None:
        """The object that a box is for."""
        name = object_of(atom, box, self.cell.objects)
        return None if name is None else self.cell.objects[name]

    def marker(self, atom: str, box: TargetBox) -> Marker | None:
        """The marker that a box is for: on a link that it encloses or moves with, or on its object."""
        on_links = [self.cell.markers[name] for name in (*box.encloses, box.frame) if name in self.cell.markers]
        obj = self.object_of(atom, box)
        return on_links[0] if on_links else obj.printed_marker if obj else None

    def is_at_tool(self, box: TargetBox) -> bool:
        """Whether a box moves with the robot."""
        return box.frame in self._X_WL

    def pose(self, box: TargetBox) -> Array:
        """World pose of a box, (4, 4)."""
        return self._X_WF[box.frame] @ box.X_FB

    def projected(self, name: str, X_WO: Array) -> ProjectedObject | None:
        """An object at a pose (4, 4); None where some of its box is behind the camera or beyond what the lens shows."""
        box = self.posed_camera.outline(X_WO, self.cell.objects[name].size)
        if box is None or box.area <= 0.0:
            return None
        return ProjectedObject.of(
            box, self.posed_camera.silhouette(self.cell.surfaces[name], {name: X_WO}, beyond=True)
        )

    def blocking(self, name: str, points_W: Array) -> ProjectedParts | None:
        """The parts of an object, where it is believed to be, that stand before any of some points (n, 3) [m].

        None if such a part may cover anything, as some of the object is behind the camera.
        """
        obj, X_WO = self.cell.objects[name], self.believed.X_WO[name]
        found = []
        for part, surface in zip(obj.parts, self.cell.surfaces[name], strict=True):
            box = (X_WO @ part.X_PG, part.shape.size) if isinstance(part.shape, Box) else (X_WO, obj.size)
            if self.posed_camera.hides(*box, points_W):
                found.append(surface)
        if found and self.posed_camera.outline(X_WO, obj.size) is None:
            return None
        return self.posed_camera.silhouette(found, {name: X_WO})

    def crop(self, polygon: Array, margin: int) -> Crop | None:
        """The part of the image around a polygon (n, 2), with a margin [pixels]; None if they do not meet."""
        height, width = self.camera.height, self.camera.width
        (left, top), (right, bottom) = polygon.min(axis=0) - margin, polygon.max(axis=0) + margin
        rows = slice(max(0, int(top)), min(height, int(bottom) + 1))
        columns = slice(max(0, int(left)), min(width, int(right) + 1))
        return Crop(rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None

    def robot_mask(self) -> Mask:
        """The pixels that the robot covers."""
        return self.robot.mask(self.posed_camera.whole)

    def sought_mask(self) -> Mask:
        """The pixels that the objects which are looked for may cover, wherever they may be.

        At a tool that was commanded to hold nothing, only those that have the colour of the object. The others show
        what is behind it, which cannot be guessed from its surroundings where there is an edge, such as a table's.
        """
        polygons: dict[str | None, list[Corners]] = {None: []}
        for corners, color in self._sought_polygons():
            polygons.setdefault(color, []).append(corners)
        mask = filled(self.posed_camera.whole, polygons.pop(None))
        for color, corners_of_tool in polygons.items():
            mask |= filled(self.posed_camera.whole, corners_of_tool) & color_mask(self.image, color or "")
        return mask

    def movables_mask(self) -> Mask:
        """The pixels that movable objects cover where they are believed to be."""
        objects = ((self.cell.objects[name], X) for name, X in self.believed.X_WO.items())
        outlines = (self.posed_camera.outline(X, obj.size) for obj, X in objects if not obj.fixed)
        return filled(self.posed_camera.whole, [outline.corners for outline in outlines if outline is not None])

    def covered(self, margin: int) -> Mask:
        """What the robot and the watched objects may cover, with a margin [pixels]."""
        return dilated(self.robot.cover(self.posed_camera.whole) | self.sought_mask(), margin)

    def _sought_polygons(self) -> list[tuple[Corners, str | None]]:
        """Outlines of what is looked for, and its colour where it would be at a tool that holds nothing."""
        found = []
        for atom, box in self.boxes():
            obj = self.object_of(atom, box)
            outline = self.posed_camera.outline(self.pose(box), obj.size if obj else box.size)
            if outline is not None:
                empty = obj is not None and self.is_at_tool(box) and not self.believed.holding
                found.append((outline.corners, obj.color if obj is not None and empty else None))
        return found
