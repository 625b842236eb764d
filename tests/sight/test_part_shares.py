"""Which of the parts that hide a box is named: of plates with known shares."""

from __future__ import annotations

import pytest

from sqrp_cli.geometry import look_at, pose
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.solids import load_solids
from tests.sight.views import box_part, look, make_box, make_camera, make_detector

CUBE = make_box((0.1, 0.1, 0.1), detector=make_detector(0.9))


def culprit(**widths: tuple[float, float, float]) -> str:
    """Who hides the cube from a camera 1 m before it, of upright plates: depth, from and to where across [m]."""
    parts = [
        box_part(name.split("_")[0], (abs(end - start), 1.0, 0.001), pose(position=((start + end) / 2, 0.0, depth)))
        for name, (depth, start, end) in widths.items()
    ]
    solids = load_solids(parts)
    verdicts = look(make_camera(look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))), CUBE, solids)
    assert verdicts.cause[0, 0] == Cause.HIDDEN
    return solids[verdicts.by[0, 0]].name


POST_1, POST_2, BAR = (0.2, -0.04, -0.02), (0.2, 0.01, 0.04), (0.3, -0.03, 0.005)


@pytest.mark.parametrize(
    ("plates", "named"),
    [
        ({"sliver": (0.6, -0.001, 0.001), "wall": (0.2, 0.0, 0.5)}, "wall"),  # though the sliver is before the middle
        ({"screen": (0.5, -0.02, 0.5), "wall": (0.2, -0.036, 0.5)}, "wall"),  # though most of it is behind the screen
        ({"b": (0.6, -0.5, 0.5), "a": (0.2, -0.5, 0.5)}, "a"),  # of equals the first by name
        ({"a": (0.6, -0.5, 0.5), "b": (0.2, -0.5, 0.5)}, "a"),
        ({"post_1": POST_1, "post_2": POST_2, "bar_1": BAR}, "post"),  # pieces with one name are one part
        ({"post_1": POST_1, "bar_1": BAR}, "bar"),
    ],
)
def test_the_part_that_hides_most_is_named(plates: dict[str, tuple[float, float, float]], named: str) -> None:
    assert culprit(**plates) == named
