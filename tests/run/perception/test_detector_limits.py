"""The limits that workspaces state for detectors are those at which perception really begins to fail.

Each rate is measured over random views, rendered and looked at like any other image.
"""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.logic.truth import Truth
from tests.run.cell.scenes import workspace
from tests.run.perception.detector_limits import beside, color_rates, marker_rate

DETECTORS = workspace("workspaces/tabletop").detectors
MARKERS, COLORS = DETECTORS["aruco"], DETECTORS["color"]


@pytest.mark.parametrize("incidence", [0.0, 0.5, 1.0])
def test_markers_within_the_limits_are_found(incidence: float) -> None:
    """incidence: share of the largest one."""
    assert marker_rate(MARKERS.min_pixels, incidence * MARKERS.max_incidence, 40) >= 0.95


def test_smaller_or_more_oblique_markers_are_missed() -> None:
    assert marker_rate(0.4 * MARKERS.min_pixels, 0.0, 40) <= 0.3
    assert marker_rate(MARKERS.min_pixels, np.radians(80.0), 40) <= 0.8


@pytest.mark.parametrize(("size", "visible"), [(1.0, 1.0), (1.0, 0.0), (3.0, 0.0)])
def test_coloured_things_within_the_limits_are_judged_right(size: float, visible: float) -> None:
    """size: in smallest ones. visible: from the least share, 0, to all, 1."""
    share = COLORS.min_visible + visible * (1.0 - COLORS.min_visible)
    there, gone = color_rates(size * COLORS.min_pixels, share, 20)
    assert there >= 0.95
    assert gone >= 0.95


def test_what_shows_in_a_slit_is_judged_as_what_shows_beside_one_edge() -> None:
    assert color_rates(30, COLORS.min_visible, 20, slit=True) == (1.0, 1.0)


def test_what_is_mostly_hidden_or_tiny_is_not_judged() -> None:
    assert color_rates(2.0 * COLORS.min_pixels, 0.5 * COLORS.min_visible, 20) == (0.0, 0.0)
    assert max(color_rates(0.33 * COLORS.min_pixels, COLORS.min_visible, 20)) <= 0.3


def test_a_detector_that_asks_for_more_is_not_content_with_less() -> None:
    assert color_rates(30, 0.41, 10, min_visible=0.35) == (1.0, 1.0)
    assert color_rates(30, 0.41, 10, min_visible=0.5) == (0.0, 0.0)
    assert color_rates(30, 0.6, 10, min_visible=1.0) == (1.0, 1.0)


@pytest.mark.parametrize(("share", "says"), [(0.4, Truth.TRUE), (0.6, Truth.FALSE), (0.66, Truth.FALSE)])
def test_a_part_beside_its_place_is_in_it_if_its_middle_is(share: float, says: Truth) -> None:
    assert beside(share, 20) == 20 * [says]
