"""Pictures of ArUco markers for the simulated cell."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.knowledge.marker import MODULES

DEPTH = 2e-4
"""How far a marker stands out from its face, so that it is drawn in front of it [m]."""

_PIXELS = 32
"""Of the texture along a module."""


def marker_picture(marker: int) -> NDArray[np.uint8]:
    """A marker seen from outside, its black square without margin; shape (n, n, 3)."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    gray = cv2.aruco.generateImageMarker(dictionary, marker, MODULES * _PIXELS, borderBits=1)
    return np.repeat(gray[:, :, None], 3, axis=2)
