"""Why a camera does not cover a box."""

from __future__ import annotations

from enum import IntEnum


class Cause(IntEnum):
    """The first limit that fails, in the order in which the limits are checked; NONE where the box is covered."""

    NONE = 0
    TOO_NEAR = 1
    TOO_FAR = 2
    OUT_OF_IMAGE = 3
    DETECTOR_NEAR = 4
    DETECTOR_FAR = 5
    OBLIQUE = 6
    TOO_SMALL = 7
    HIDDEN = 8
    SAME_COLOUR = 9
    TOO_DARK = 10
    TOO_BRIGHT = 11

    @property
    def label(self) -> str | None:
        """Name in the output, None for a covered box."""
        return None if self is Cause.NONE else self.name.lower()

    @property
    def words(self) -> str:
        """The cause in words, for sentences and tables."""
        detector = " for its detector" if self in (Cause.DETECTOR_NEAR, Cause.DETECTOR_FAR) else ""
        return self.name.lower().replace("detector", "too").replace("_", " ") + detector

    def by(self, culprit: str | None) -> str:
        """The cause in words, with the culprit if there is one, or the side of the image."""
        patterns = {
            Cause.HIDDEN: "{} by {}",
            Cause.OUT_OF_IMAGE: "{} ({})",
            Cause.SAME_COLOUR: "{} as {} behind it",
            Cause.TOO_BRIGHT: "{} in the light of {}",
        }
        if culprit is not None:
            patterns[Cause.TOO_DARK] = "{} in the shadow of {}"
        return patterns.get(self, "{}").format(self.words, culprit)


SIDES = ("left", "right", "top", "bottom")
"""Sides of an image, in the order of their codes."""
