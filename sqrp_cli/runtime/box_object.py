"""Which object a box of a target is for."""

from __future__ import annotations

from collections.abc import Container

from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.logic.literal import Atom


def object_of(atom: str, box: TargetBox, objects: Container[str]) -> str | None:
    """The object that the box encloses or moves with; of a box that encloses nothing, else what its atom is about.

    objects: the names that count. None for a box that is for no object.
    """
    names = (*box.encloses, box.frame.owner, *(() if box.encloses else Atom.of(atom).arguments))
    return next((name for name in names if name in objects), None)
