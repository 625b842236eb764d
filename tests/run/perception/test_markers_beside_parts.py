"""A marker is found where a known part covers its margin or the image ends, and not where one covers the marker."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.vision import find_markers

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
    (found,) = find_markers(image, "aruco_original", part)
    assert found.id == 7
    middle = EDGE + (SIDE - 1) / 2
    assert np.abs(found.corners.mean(axis=0) - middle).max() <= 1.0 + covered / 2


def test_a_marker_behind_a_part_is_not_found() -> None:
    image, part = with_a_part(SIDE / 3)
    assert not find_markers(image, "aruco_original", part)


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("inside", [0.5, 1, 1.5, 2, 3])
def test_a_whole_marker_at_the_edge_of_the_image_is_found(inside: float, turn: float) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    fine, size = 4, 40.0
    square = size / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    turned = square @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = turned + np.array([200 - inside - turned[:, 0].max(), 100.0])
    source = np.array([[0, 0], [300, 0], [300, 300], [0, 300]], dtype=np.float32)
    way = cv2.getPerspectiveTransform(source, (fine * corners).astype(np.float32))
    big = np.full((200 * fine, 200 * fine), 200, dtype=np.uint8)
    marker = cv2.aruco.generateImageMarker(dictionary, 7, 300)
    cv2.warpPerspective(marker, way, big.shape, dst=big, borderMode=cv2.BORDER_TRANSPARENT)
    gray = cv2.resize(big, (200, 200), interpolation=cv2.INTER_AREA)
    (found,) = find_markers(np.repeat(gray[:, :, None], 3, axis=2))
    assert found.id == 7
    assert np.abs(found.corners - corners).max() <= 1.5
