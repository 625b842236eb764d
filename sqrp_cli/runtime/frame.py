"""An image with the time at which it was taken: all that perception ever learns of a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of one camera.

    t: time of exposure [s]. image: colours as red, green, blue, shape (height, width, 3); pixel (0, 0) is the centre of
    the first pixel, at the top left.
    """

    camera: str
    t: float
    image: NDArray[np.uint8]
