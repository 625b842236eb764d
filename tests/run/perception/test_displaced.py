"""Where a part lies beside where it is expected, in masks that are painted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.geometry import Mask
from sqrp_cli.run.perception.vision import displacement

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


@given(down=steps, right=steps)
def test_a_part_that_is_seen_whole_is_found_where_it_is(down: int, right: int) -> None:
    assert found(np.ones(SHAPE, dtype=bool), down, right) == (down, right)


@pytest.mark.parametrize("end", [slice(0, TOP + 8), slice(TOP + ROWS - 8, None)])
@given(down=steps, right=steps)
def test_what_hides_one_end_of_it_does_not_matter(end: slice, down: int, right: int) -> None:
    judged = np.ones(SHAPE, dtype=bool)
    judged[end] = False
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
def test_a_part_further_away_than_the_first_reach_is_found_within_the_next(far: tuple[int, int]) -> None:
    seen = part(*far)
    across, along = displacement(seen, np.ones_like(seen), lambda margin: part(margin=margin), (REACH, 17)).tolist()
    assert (along, across) == far


def test_what_is_alike_further_away_does_not_matter() -> None:
    end = slice(TOP + 8, None)
    judged = np.ones(SHAPE, dtype=bool)
    judged[end] = False
    seen = (part() | part(0, 16)) & judged
    assert displacement(seen, judged, lambda margin: part(margin=margin), (REACH, 17)).tolist() == [0.0, 0.0]
