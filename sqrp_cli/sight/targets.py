"""Grounded targets: the boxes, with their frames, that decide each literal of a candidate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from sqrp_cli.camera.detector import Detector
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import check_finite, check_poses
from sqrp_cli.logic.literal import Atom
from sqrp_cli.records import dataclass
from sqrp_cli.skill.target_box import TargetBox, object_of


@dataclass(frozen=True, eq=False, kw_only=True)
class SoughtBox(TargetBox):
    """One box of a grounded target, with the limits of its detector."""

    limits: Detector
    seeks: str | None = None
    """The object whose colour its detector looks for; None if it looks for something else."""
    color: str | None = None
    """That colour."""

    def __post_init__(self) -> None:
        """Raises ValueError for an invalid pose, and for a size or normal that is not finite."""
        check_poses(f"box `{self.name}`", self.X_FB)
        check_finite(f"box `{self.name}`", self.size, self.normal)

    def with_color(self, atom: str, objects: Mapping[str, SceneObject]) -> SoughtBox:
        """The box, for an atom, with the object whose colour its detector looks for, if it looks for colours."""
        seeks = object_of(atom, self, objects) if self.limits.kind == "color" else None
        return self if seeks is None else replace(self, seeks=seeks, color=objects[seeks].color)


@dataclass(frozen=True, eq=False)
class Target:
    """What decides an atom: at least `cameras` cameras must each see every box."""

    atom: Atom
    cameras: int
    boxes: tuple[SoughtBox, ...]

    @property
    def usual(self) -> Target:
        """The same by what detectors usually see: itself where that is what they surely do."""
        boxes = tuple(replace(box, limits=box.limits.usual) for box in self.boxes)
        same = all(one.limits is box.limits for one, box in zip(boxes, self.boxes, strict=True))
        return self if same else replace(self, boxes=boxes)
