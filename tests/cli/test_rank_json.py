"""What `rank --json` and `check --json` say of a candidate that is out of reach."""

from __future__ import annotations

import math
import re
from typing import Any

from tests.cells import write_cell

Document = dict[str, Any]


def missing_reach(candidate: Document) -> float | None:
    """By how much [m] a candidate is said to be too far, None where it is not for that."""
    figure = re.search(r"(\d+(?:\.\d+)?) m\b", candidate["reasons"][0] if candidate["reasons"] else "")
    return float(figure[1]) if figure and "out of reach" in candidate["reasons"][0] else None


def test_the_reason_of_g6_says_by_how_much_it_is_out_of_reach_and_moving_it_by_less_does_not_help(
    ranked, sqrp, tabletop_cell, tmp_path
):
    # The reason of g6 says by how much it is out of reach.
    figure = missing_reach(ranked.document["candidates"][-1])
    assert figure is not None
    assert figure > 0.0
    # Moving an object by less than it is too far does not help.
    x, y, z = tabletop_cell["objects"]["g6"]["pose"]["position"]
    away = math.hypot(x, y)
    closer = 0.9 * (figure - 0.005)  # the figure is rounded
    tabletop_cell["objects"]["g6"]["pose"]["position"] = [x - closer * x / away, y - closer * y / away, z]
    write_cell(tabletop_cell, tmp_path)
    (g6,) = sqrp("check", tmp_path, "pickup g6", "--json").document["candidates"]
    assert 0.0 <= missing_reach(g6) < figure
