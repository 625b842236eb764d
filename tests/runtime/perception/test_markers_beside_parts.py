"""A marker is found where a known part of the robot covers its margin, and not where it covers the marker."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sqrp_cli.runtime.image import ImageArray
from sqrp_cli.runtime.perception.vision import find_markers, markers_beside

SIDE, EDGE = 56, 40
"""Of the black square, and where it begins [pixels]."""


def with_a_part(covered: float) -> tuple[ImageArray, np.ndarray]:
    """Marker 7 on white with a dark part to the left of it, which covers some of the square [pixels]; and the part."""
    gray = np.full((SIDE + 2 * EDGE,) * 2, 235, dtype=np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    gray[EDGE : EDGE + SIDE, EDGE : EDGE + SIDE] = cv2.aruco.generateImageMarker(dictionary, 7, SIDE)
    part = np.zeros(gray.shape, dtype=bool)
    part[10:-10, 15 : round(EDGE + covered)] = True
    gray[part] = 0
    return np.repeat(gray[:, :, None], 3, axis=2), part


@pytest.mark.parametrize("covered", [0, 1, 2, 3])
def test_a_marker_beside_a_part_is_found(covered: int) -> None:
    image, part = with_a_part(covered)
    assert not find_markers(image)
    (found,) = markers_beside(image, part, "aruco_original")
    assert found.id == 7
    middle = EDGE + (SIDE - 1) / 2
    assert np.abs(found.corners.mean(axis=0) - middle).max() <= 1.0 + covered / 2


def test_a_marker_behind_a_part_is_not_found() -> None:
    image, part = with_a_part(SIDE / 3)
    assert not markers_beside(image, part, "aruco_original")
