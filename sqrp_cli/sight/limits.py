"""Why a camera does not cover a box.

Its limits and those of the detector, and what of the scene is in the way, are checked by the compiled kernel.
"""

from __future__ import annotations

from dataclasses import field
from enum import IntEnum
from typing import Literal, cast

from sqrp_cli.document import LEFT_OUT, Record
from sqrp_cli.records import dataclass


class Cause(IntEnum):
    """The first limit that fails, in the order in which the limits are checked; NONE where the box is covered."""

    NONE = 0
    BEHIND = 1
    TOO_NEAR = 2
    TOO_FAR = 3
    OUT_OF_IMAGE = 4
    DETECTOR_NEAR = 5
    DETECTOR_FAR = 6
    OBLIQUE = 7
    TOO_SMALL = 8
    HIDDEN = 9
    SAME_COLOUR = 10
    TOO_DARK = 11
    TOO_BRIGHT = 12

    @property
    def label(self) -> CauseLabel | None:
        """Name in the output, None for a covered box."""
        return None if self is Cause.NONE else cast("CauseLabel", self.name.lower())

    def by(self, culprit: str | None, figure: str = "") -> str:
        """The cause in words: `above its image`, "behind `table`", `0.03 m too near for its detector`.

        culprit: what hides it, has its colour or shades it, or the side of the image. figure: by how much it is missed.
        """
        words = _WORDS[self]
        if self is Cause.OUT_OF_IMAGE:
            words = _BESIDE.get(culprit or "", words)
        elif culprit is not None:
            words = {Cause.HIDDEN: "behind `{}`", Cause.TOO_DARK: "too dark in the shadow of `{}`"}.get(self, words)
        return words.format(culprit or "something", figure=f"{figure} " if figure else "")


_WORDS = {
    Cause.NONE: "seen",
    Cause.BEHIND: "behind the camera",
    Cause.TOO_NEAR: "{figure}too near",
    Cause.TOO_FAR: "{figure}too far",
    Cause.OUT_OF_IMAGE: "outside its image",
    Cause.DETECTOR_NEAR: "{figure}too near for its detector",
    Cause.DETECTOR_FAR: "{figure}too far for its detector",
    Cause.OBLIQUE: "seen {figure}too flat",
    Cause.TOO_SMALL: "{figure}too small",
    Cause.HIDDEN: "hidden",
    Cause.SAME_COLOUR: "of the same colour as `{}` behind it",
    Cause.TOO_DARK: "too dark",
    Cause.TOO_BRIGHT: "too bright in the light of `{}`",
}
"""What texts say of the causes."""

_BESIDE = {
    "left": "left of its image",
    "right": "right of its image",
    "top": "above its image",
    "bottom": "below its image",
}
"""What they say of what lies beyond a side of an image."""

CauseLabel = Literal[
    "behind", "too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small", "hidden",
    "same_colour", "too_dark", "too_bright",
]  # fmt: skip
"""The labels of all causes."""
SIDES = ("left", "right", "top", "bottom")  # Sides of an image, in the order of their codes


@dataclass(frozen=True, kw_only=True)
class Reason(Record):
    """Why a camera does not cover something: the first limit that fails."""

    cause: CauseLabel | None
    """The first limit that fails."""
    by: str | None
    """What hides it or has its colour behind it, or the side on which it is out of the image."""
    box: str | None = field(default=None, metadata=LEFT_OUT)
    """Of a target with several boxes: the first that fails, in their order."""

    @property
    def limit(self) -> Cause:
        """The limit; NONE where it is covered."""
        return Cause.NONE if self.cause is None else Cause[self.cause.upper()]

    @property
    def words(self) -> str:
        """It in a few words."""
        return self.limit.by(self.by)


@dataclass(frozen=True, kw_only=True)
class HidingPart(Record):
    """A part that hides something of a box, or of several on average."""

    name: str
    """As `by` names it; all pieces of a link are one part."""
    share: float
    """Share of the box's silhouette along whose rays from the camera it is the first part, in 0..1."""
    alone: float
    """Share that no other part hides: what would be seen without it, in 0..1."""
