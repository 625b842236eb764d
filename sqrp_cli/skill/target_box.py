"""The boxes of targets: `BoxSpec` in a skill, about its parameters; `TargetBox` in programs and runs, about objects."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.files.entries import Direction, Entry, Extents, FileRecord, Finite, Length, Name, Pose, PoseMatrix, Text
from sqrp_cli.files.frames import AT_START, TOOL, WORLD
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.logic.literal import NOT, Atom
from sqrp_cli.records import dataclass

UnitVector = Annotated[Direction, AfterValidator(lambda vector: tuple((vector / np.linalg.norm(vector)).tolist()))]
JAWS = "jaws"  # What recordings watch at the tool frame: where the tool takes hold of things
_JAWS_SIZE = [0.04, 0.04, 0.04]  # of the box around that [m]


class BoxSpec(Entry):
    """A box of a target: where to look for what."""

    name: Name = Field(description="What output calls it.")
    frame: Text
    """`world`, a link, `tool`, a skill parameter or object (moves with it), or either of them with `@start` (where it
    was when the skill began)."""
    fits: Name | None = Field(default=None, description="The skill parameter or object that gives the box its size.")
    at: Name | None = None
    """With `fits`: the waypoint at which it is held: the box is where it then is in the tool (frame `tool`), or in the
    world, from where the box moves with its frame."""
    margin: Length = Field(default=0.0, description="With `fits`: enlargement on every side.")
    size: Extents | None = Field(default=None, description="Full extents, instead of `fits`.")
    pose: Pose = Field(default=Pose(), description="Pose of the box in the frame.")
    detector: Name = Field(description="The detector of the workspace that looks for it.")
    normal: UnitVector | None = None
    """Direction away from the surface that it lies on (markers)."""
    encloses: tuple[Text, ...] | None = None
    """Links, objects, skill parameters or `tool` that it encloses; default: the object of its frame."""

    @model_validator(mode="after")
    def _consistent(self) -> BoxSpec:
        self.check_only_one("fits", "size")
        if self.fits is None and (self.at is not None or self.margin):
            raise PydanticCustomError("conflicting-keys", "`at` and `margin` go with `fits`, not with `size`")
        if self.at is None and self.fits is not None and self.frame == TOOL:
            raise PydanticCustomError("conflicting-keys", "`at` is needed with `fits` in frame `tool`")
        if self.size is not None and min(self.size) < 0.002 and self.normal is None:
            raise PydanticCustomError("missing-key", "a box with a side under 2 mm needs a `normal`")
        return self

    @property
    def X_FB(self) -> Array:
        """The pose of the box in the frame (on top of `fits`), shape (4, 4)."""
        return read_only(self.pose.matrix())


class TargetSpec(Entry):
    """What decides a predicate."""

    cameras: Annotated[int, Field(strict=True, ge=1, le=200)] = 1
    """How many cameras must each see all boxes."""
    boxes: list[BoxSpec] = Field(min_length=1, max_length=20, description="All of them decide it together.")


def usual_targets(objects: Sequence[str], detector: str) -> dict[str, dict[str, list[dict[str, object]]]]:
    """What recordings watch, by predicate: jaws and objects where they are, `hold` and `place` of each object."""
    boxes: dict[str, dict[str, object]] = {JAWS: {"frame": TOOL, "size": _JAWS_SIZE, "encloses": [TOOL, *objects]}}
    boxes |= {one: {"frame": one, "fits": one} for one in objects}
    if objects:  # stands for each of them
        boxes["hold"] = {"frame": TOOL, "fits": objects[0], "at": "grasp", "encloses": [objects[0]]}
        boxes["place"] = {"frame": f"{objects[0]}{AT_START}", "fits": objects[0]}
    return {name: {"boxes": [{"name": name, "detector": detector, **box}]} for name, box in boxes.items()}


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetBox(FileRecord):
    """A box to look at."""

    name: str
    detector: str
    """The name of its detector."""
    frame: Text
    """`world`, a link, an object, or `OBJECT@start`."""
    size: tuple[Finite, Finite, Finite]
    """Full extents [m]."""
    X_FB: Annotated[PoseMatrix, Field(alias="pose")]
    """Pose of the box in the frame, shape (4, 4)."""
    normal: tuple[Finite, Finite, Finite] | None
    """Unit vector in the box's axes, away from the surface, if it has one."""
    encloses: tuple[str, ...]
    """Names of links, objects or parts that do not hide the box, in order."""

    def seen_through(self, parts: Iterable[str]) -> Self:
        """The same box, from which some more parts hide nothing."""
        return replace(self, encloses=(*self.encloses, *dict.fromkeys(parts)))

    @classmethod
    def on_object(cls, name: str, **fields: Any) -> TargetBox:  # noqa: ANN401 - the others of a box
        """A box that moves with an object and encloses it."""
        return cls(name=name, frame=name, encloses=(name,), **fields)


def fact_words(literal: str, boxes: Iterable[TargetBox], objects: Container[str]) -> str:
    """What a literal says of the things that its boxes enclose: `the tool holds g1`, `g1 does not stand on tray`.

    objects: the names of all objects; other frames of boxes are links, which only the tool's boxes have. Of an atom
    about which the boxes do not say so, its name: "`open` holds".
    """
    atom = literal.removeprefix(NOT)
    holds, stands, be = ("holds", "stands", "is") if atom == literal else ("does not hold", "does not stand", "is not")
    if atom == JAWS:
        return f"the jaws are{' not' * (atom != literal)} where they should be"
    for box in boxes:
        name, place = object_of(atom, box, objects), box.frame.removesuffix(AT_START)
        if name is None or place == WORLD:
            continue
        if place not in objects:
            return f"the tool {holds} {name}"
        if place != box.frame or place != name:
            return f"{name} {stands} {'where it stood' if place == name else f'on {place}'}"
        if atom == name:  # as recordings watch it
            return f"{name} {be} where it should be"
    return f"`{atom}` {holds}"


def object_of(atom: str, box: TargetBox, objects: Container[str]) -> str | None:
    """The object that the box encloses or moves with; of a box that encloses nothing, else what its atom is about.

    objects: the names that count. None for a box that is for no object.
    """
    names = (*box.encloses, box.frame.removesuffix(AT_START), *(() if box.encloses else Atom.of(atom).arguments))
    return next((name for name in names if name in objects), None)
