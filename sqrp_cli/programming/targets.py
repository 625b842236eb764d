"""Grounded targets: which boxes, in which frames, decide each literal of a candidate."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.geometry import Array, check_finite, check_poses
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.logic.literal import Atom

START = "@start"
"""Suffix of a frame that stays where an object was when the skill began."""


@dataclass(frozen=True, eq=False)
class TargetBox:
    """One box of a grounded target.

    frame: `world`, a link, an object, or `OBJECT@start`. size: full extents [m]. X_FB: pose of the box in the frame,
    (4, 4).
    normal: unit vector in the box's axes, or None. encloses: names of links, objects or parts that do not hide the box.
    """

    name: str
    detector: Detector
    frame: str
    size: tuple[float, float, float]
    X_FB: Array
    normal: tuple[float, float, float] | None
    encloses: frozenset[str]

    def __post_init__(self) -> None:
        """Raises ValueError for a pose that is none, and for a size or normal that is not finite."""
        check_poses(f"box `{self.name}`", self.X_FB)
        check_finite(f"box `{self.name}`", self.size, self.normal)


@dataclass(frozen=True, eq=False)
class Target:
    """What decides an atom: at least `cameras` cameras must each see every box."""

    atom: Atom
    cameras: int
    boxes: tuple[TargetBox, ...]
