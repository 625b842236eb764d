"""What each part hides of a box, and which is named: plates with known shares, and what is seen without a part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import look_at, pose
from sqrp_cli.shapes import Part
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import load_solid, load_solids
from tests.sight.views import box_part, look, make_box, make_camera, make_detector

BOX = make_box((0.1, 0.1, 0.002), normal=(0.0, 0.0, 1.0), detector=make_detector(0.9))
"""Thin, so that its silhouette is that of its face at the depth 1 m."""
HALF_RAY = 0.5 / 32
ONE = np.zeros(1, dtype=np.int64)


def plate(name: str, depth: float, start: float, end: float) -> Part:
    """A plate before the box as a camera 1 m away sees it: from and to which place across the box, of -1 to 1."""
    half = 0.05 * (1 - depth)
    return box_part(name, (half * (end - start), 1.0, 1e-5), pose(position=(half * (start + end) / 2, 0.0, depth)))


def hiding(*plates: Part, names: dict[str, str] | None = None) -> dict[str, tuple[float, float]]:
    """Share and share alone of the plates that hide something of the box."""
    camera = make_camera(look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    observer = Observer((camera,), tuple(load_solid(one, (names or {}).get(one.name, one.name)) for one in plates))
    (parts,) = observer.occluders([BOX], SceneStates(1, {"world": pose()[None]}), ONE, ONE, ONE)
    assert [(-one.share, one.name) for one in parts] == sorted((-one.share, one.name) for one in parts)
    return {part.name: (part.share, part.alone) for part in parts}


def about(share: float, alone: float) -> object:
    return pytest.approx((share, alone), abs=HALF_RAY)


SCREEN = plate("screen", 0.5, -0.5, 0.5)


@pytest.mark.parametrize(
    ("plates", "names", "expected"),
    [
        # What two plates hide belongs to the nearer one.
        ([SCREEN, plate("wall", 0.2, 0.0, 1.0)], {}, {"screen": about(0.5, 0.25), "wall": about(0.25, 0.25)}),
        # One behind another hides nothing and is left out.
        ([SCREEN, plate("wall", 0.2, -0.2, 0.2)], {}, {"screen": about(0.5, 0.3)}),
        # Pieces of one name are one part.
        (
            [plate("post_1", 0.5, -0.5, 0.1), plate("post_2", 0.2, -0.1, 0.5)],
            {"post_1": "post", "post_2": "post"},
            {"post": about(0.5, 0.5)},
        ),
        # What is beside or behind the box hides nothing.
        ([plate("beside", 0.5, 1.1, 2), box_part("behind", (1, 1, 0.01), pose(position=(0, 0, -0.1)))], {}, {}),
    ],
)
def test_of_plates_the_first_on_a_ray_hides_what_is_behind_it(
    plates: list[Part], names: dict[str, str], expected: object
) -> None:
    assert hiding(*plates, names=names) == expected


def test_plates_that_cross_share_what_they_hide() -> None:
    """A tilted plate is in front on one side only."""
    tilted = plate("tilted", 0.5, -2.0, 2.0)
    turned = pose(position=(0.0, 0.0, 0.5))
    turned[:3, :3] = [[np.cos(0.5), 0, np.sin(0.5)], [0, 1, 0], [-np.sin(0.5), 0, np.cos(0.5)]]
    found = hiding(plate("flat", 0.5, -1.0, 1.0), replace(tilted, X_PG=turned))
    assert found == {"flat": about(0.5, 0.0), "tilted": about(0.5, 0.0)}


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
