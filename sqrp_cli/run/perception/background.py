"""The background of a camera, without robot and objects: it proves that an object is absent."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Mask
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.vision import Crop, color_mask, dilated, inpainted, same_color, shade_of

TOLERANCE = 24
"""Largest difference of a colour channel (of 255) from the background; covers noise and mild changes of light."""

SHADE_TOLERANCE = 0.12
"""How much of a pixel's brightness may be of another hue in a shade of the background."""

COLOR_BITS = 4
"""Bits per channel of the coarse colours that make up the robot's palette."""

LEAST_PALETTE_SHARE = 5e-4
"""Share of the robot's pixels that a coarse colour must have to belong to its palette."""


class Background:
    """Learns, from the images of one camera, the picture of what never moves, and the colours of the robot.

    What the robot or a watched object covers in the first image is guessed from its surroundings until it is seen.
    For a camera that moves there is no such picture: colours of what surrounds the robot stand for it.
    """

    def __init__(
        self, image: ImageArray, robot: Mask, sought: Mask, movables: Mask, *, moving: bool, shadows: bool = False
    ) -> None:
        """robot, sought, movables: what the robot, watched and movable objects cover in the first image.

        shadows: whether shadows may fall on the background, so that a darker or lighter shade of it is background too.
        Objects may stand before the robot: their colours are not the robot's. What looks like the watched one in one
        place must not count as surroundings in another.
        """
        objects, self._shadows = sought | movables, shadows
        self._palette = _palette(image[robot & ~dilated(objects, 2)])
        self._surroundings = _palette(image[~(robot | objects)]) if moving else None
        self._unknown = dilated(robot | sought, 3)
        self._picture = image if moving else inpainted(image, self._unknown)
        self._news = np.zeros_like(self._unknown)

    def learn(self, image: ImageArray, covered: Mask) -> None:
        """Take from an image what was still unknown and is not covered in it."""
        if self._surroundings is not None:
            return
        fresh: Mask = self._unknown & ~covered
        self._picture[fresh] = image[fresh]
        self._unknown &= covered
        self._news |= fresh

    def guess_again(self, crop: Crop) -> None:
        """Guess what is still unknown in a crop by what was learned there since it was guessed last."""
        if self._news[crop].any() and self._unknown[crop].any():
            self._picture[crop] = inpainted(self._picture[crop], self._unknown[crop])
            self._news[crop] = False

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left to learn."""
        return self._surroundings is not None or not self._unknown.any()

    def matches(self, image: ImageArray, crop: Crop) -> Mask:
        """Which pixels of a crop show the background."""
        part = image[crop]
        if self._surroundings is not None:
            return self._surroundings[_coarse(part)]
        same = same_color(part, self._picture[crop], TOLERANCE)
        return same | shade_of(part, self._picture[crop], SHADE_TOLERANCE, TOLERANCE / 4) if self._shadows else same

    def has_hue(self, image: ImageArray, crop: Crop, color: str) -> Mask:
        """Where, in a crop, the background has the hue of a colour: a shade of it there may be the background's own."""
        if self._surroundings is not None:
            return self.matches(image, crop) & color_mask(image[crop], color)
        return color_mask(self._picture[crop], color)

    def robot_colored(self, image: ImageArray, crop: Crop) -> Mask:
        """Which pixels of a crop have a colour of the robot."""
        return self._palette[_coarse(image[crop])]


def _coarse(pixels: ImageArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    r, g, b = (pixels[..., channel].astype(np.int64) >> (8 - COLOR_BITS) for channel in range(3))
    return (r << 2 * COLOR_BITS) | (g << COLOR_BITS) | b


def _palette(pixels: ImageArray) -> Mask:
    counts = np.bincount(_coarse(pixels).ravel(), minlength=2 ** (3 * COLOR_BITS))
    found: Mask = counts > LEAST_PALETTE_SHARE * max(counts.sum(), 1)
    return found
