"""The objects of a cell."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.geometry import Array, check_finite, check_poses
from sqrp_cli.shapes import Part


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A thing in the cell.

    type: its PDDL type. color: its colour name, None if it has none worth naming. attributes: further words that a task
    may use for it. size: full extents [m] of the box around it, in its own axes.
    X_WO: pose of the centre of that box in the world, shape (4, 4); None while it is unknown where the object is.
    fixed: whether it never moves. on: the object that it stands on. marker: id of the ArUco marker on it.
    parts: its solid pieces, in its own frame; a plain box of `size` unless the workspace says otherwise.
    X_TO: pose in the tool frame, shape (4, 4), if the tool holds it at the beginning; X_WO is None then.
    """

    name: str
    type: str
    color: str | None
    attributes: tuple[str, ...]
    size: tuple[float, float, float]
    X_WO: Array | None
    fixed: bool
    on: str | None
    marker: int | None
    parts: tuple[Part, ...]
    X_TO: Array | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a pose that is none and for a size that is not finite."""
        check_poses(f"object `{self.name}`", self.X_WO, self.X_TO)
        check_finite(f"object `{self.name}`", self.size)

    @property
    def types(self) -> tuple[str, str]:
        """Its PDDL types: its own, and `fixture` or `movable`."""
        return object_types(self.type, self.fixed)


def object_types(own_type: str, fixed: bool) -> tuple[str, str]:
    """The PDDL types of an object: its own (PDDL knows lower case only), and `fixture` or `movable`."""
    return own_type.lower(), "fixture" if fixed else "movable"
