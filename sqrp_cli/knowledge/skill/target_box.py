"""The boxes of targets: where to look for what, from the grounding of a task to the images of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from sqrp_cli.knowledge.frames import StoredFrame
from sqrp_cli.knowledge.text.entries import Finite, PoseMatrix, Stored


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetBox(Stored):
    """A box to look at."""

    name: str
    detector: str
    """The name of the detector that looks for what is in it."""
    frame: StoredFrame
    """`world`, a link, an object, or `OBJECT@start`."""
    size: tuple[Finite, Finite, Finite]
    """Full extents [m]."""
    X_FB: Annotated[PoseMatrix, Field(alias="pose")]
    """Pose of the box in the frame, shape (4, 4)."""
    normal: tuple[Finite, Finite, Finite] | None
    """Unit vector in the box's axes, away from the surface, if it has one."""
    encloses: tuple[str, ...]
    """Names of links, objects or parts that do not hide the box, in order."""
