"""Where parts and markers are in images that are painted by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.geometry import Mask
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.vision import displacement, find_markers

SHAPE, REACH = (60, 80), 9
TOP, LEFT, ROWS, COLUMNS = 20, 30, 24, 18


def part(down: int = 0, right: int = 0, *, margin: int = 0) -> Mask:
    """An upright part, moved from where it is expected, in an image with a margin."""
    mask = np.zeros((SHAPE[0] + 2 * margin, SHAPE[1] + 2 * margin), dtype=bool)
    top, left = TOP + down + margin, LEFT + right + margin
    mask[top : top + ROWS, left : left + COLUMNS] = True
    return mask


def found(judged: Mask, down: int, right: int) -> tuple[float, float]:
    across, along = displacement(part(down, right), judged, lambda by: part(margin=by), (REACH,)).tolist()
    return along, across


steps = st.integers(-REACH + 1, REACH - 1)


@pytest.mark.parametrize("hidden", [slice(0, 0), slice(0, TOP + 8), slice(TOP + ROWS - 8, None)])
@given(down=steps, right=steps)
def test_a_part_that_is_seen_whole_or_but_for_one_end_is_found_where_it_is(
    hidden: slice, down: int, right: int
) -> None:
    judged = np.ones(SHAPE, dtype=bool)
    judged[hidden] = False
    assert found(judged, down, right) == (down, right)


@given(down=steps)
def test_where_both_ends_are_hidden_it_may_be_where_it_is_expected(down: int) -> None:
    judged = np.zeros(SHAPE, dtype=bool)
    judged[TOP + 9 : TOP + ROWS - 9] = True
    assert found(judged, down, 0) == (0, 0)


@given(down=steps, right=steps)
def test_the_edge_of_the_image_is_no_end_of_it(down: int, right: int) -> None:
    first = TOP + ROWS // 2
    seen = part(down, right)[first:]
    across, along = displacement(seen, np.ones_like(seen), lambda by: part(margin=by)[first:], (REACH,)).tolist()
    assert (along, across) == (down, right)


@pytest.mark.parametrize("far", [(0, 4), (0, 13), (-14, 0), (12, 13)])
def test_a_part_further_away_than_the_first_reach_is_found_within_the_next_unless_it_may_be_nearer(far) -> None:
    judged = np.ones(SHAPE, dtype=bool)
    across, along = displacement(part(*far), judged, lambda margin: part(margin=margin), (REACH, 17)).tolist()
    assert (along, across) == far
    judged[TOP + 8 :] = False
    seen = (part() | part(0, 16)) & judged
    assert displacement(seen, judged, lambda margin: part(margin=margin), (REACH, 17)).tolist() == [0.0, 0.0]


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
    ((number, corners),) = find_markers(image, "aruco_original", part)
    assert number == 7
    middle = EDGE + (SIDE - 1) / 2
    assert np.abs(corners.mean(axis=0) - middle).max() <= 1.0 + covered / 2


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
    ((number, found),) = find_markers(np.repeat(gray[:, :, None], 3, axis=2))
    assert number == 7
    assert np.abs(found - corners).max() <= 1.5
