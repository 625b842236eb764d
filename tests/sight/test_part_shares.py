"""What each part hides of a box, and which is named: plates with known shares, and what is seen without a part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import look_at, pose
from sqrp_cli.shapes import Part
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import BoxViews, Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import load_solid, load_solids
from tests.sight.views import box_part, look, make_box, make_camera, make_detector

BOX = make_box((0.1, 0.1, 0.002), normal=(0.0, 0.0, 1.0), detector=make_detector(0.9))
"""Thin, so that its silhouette is that of its face at the depth 1 m."""
HALF_RAY = 0.5 / 32
ONE = BoxViews(*(np.zeros(1, dtype=np.int64) for _ in range(3)))


def plate(name: str, depth: float, start: float, end: float) -> Part:
    """A plate before the box as a camera 1 m away sees it: from and to which place across the box, of -1 to 1."""
    half = 0.05 * (1 - depth)
    return box_part(name, (half * (end - start), 1.0, 1e-5), pose(position=(half * (start + end) / 2, 0.0, depth)))


def hiding(*plates: Part, names: dict[str, str] | None = None) -> dict[str, tuple[float, float]]:
    """Share and share alone of the plates that hide something of the box."""
    camera = make_camera(look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    observer = Observer((camera,), tuple(load_solid(one, (names or {}).get(one.name, one.name)) for one in plates))
    (parts,) = observer.occluders([BOX], SceneStates(1, {"world": pose()[None]}), ONE)
    assert [(-one.share, one.name) for one in parts] == sorted((-one.share, one.name) for one in parts)
    return {part.name: (part.share, part.alone) for part in parts}


def about(share: float, alone: float) -> object:
    return pytest.approx((share, alone), abs=HALF_RAY)


def test_what_two_plates_hide_belongs_to_the_nearer_one() -> None:
    found = hiding(plate("screen", 0.5, -0.5, 0.5), plate("wall", 0.2, 0.0, 1.0))
    assert found == {"screen": about(0.5, 0.25), "wall": about(0.25, 0.25)}


def test_a_plate_behind_another_one_hides_nothing_and_is_left_out() -> None:
    assert hiding(plate("screen", 0.5, -0.5, 0.5), plate("wall", 0.2, -0.2, 0.2)) == {"screen": about(0.5, 0.3)}


def test_plates_that_cross_share_what_they_hide() -> None:
    """A tilted plate is in front on one side only."""
    tilted = plate("tilted", 0.5, -2.0, 2.0)
    turned = pose(position=(0.0, 0.0, 0.5))
    turned[:3, :3] = [[np.cos(0.5), 0, np.sin(0.5)], [0, 1, 0], [-np.sin(0.5), 0, np.cos(0.5)]]
    found = hiding(plate("flat", 0.5, -1.0, 1.0), replace(tilted, X_PG=turned))
    assert found == {"flat": about(0.5, 0.0), "tilted": about(0.5, 0.0)}


def test_pieces_of_one_name_are_one_part() -> None:
    pieces = {"post_1": "post", "post_2": "post"}
    found = hiding(plate("post_1", 0.5, -0.5, 0.1), plate("post_2", 0.2, -0.1, 0.5), names=pieces)
    assert found == {"post": about(0.5, 0.5)}


def test_what_is_beside_or_behind_the_box_hides_nothing() -> None:
    behind = box_part("behind", (1.0, 1.0, 0.01), pose(position=(0.0, 0.0, -0.1)))
    assert hiding(plate("beside", 0.5, 1.1, 2.0), behind) == {}


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


def test_a_sliver_before_the_middle_is_not_named_before_what_hides_half() -> None:
    assert culprit(sliver=(0.6, -0.001, 0.001), wall=(0.2, 0.0, 0.5)) == "wall"


def test_what_another_part_hides_already_counts_all_the_same() -> None:
    """The wall's share is larger than the screen's, though most of it lies behind the screen."""
    assert culprit(screen=(0.5, -0.02, 0.5), wall=(0.2, -0.036, 0.5)) == "wall"


def test_of_parts_that_hide_the_same_share_the_first_by_name_is_named() -> None:
    assert culprit(b=(0.6, -0.5, 0.5), a=(0.2, -0.5, 0.5)) == "a"
    assert culprit(a=(0.6, -0.5, 0.5), b=(0.2, -0.5, 0.5)) == "a"


def test_pieces_with_one_name_are_one_part() -> None:
    pieces = {"post_1": (0.2, -0.04, -0.02), "post_2": (0.2, 0.01, 0.04)}
    assert culprit(**pieces, bar_1=(0.3, -0.03, 0.005)) == "post"
    assert culprit(post_1=pieces["post_1"], bar_1=(0.3, -0.03, 0.005)) == "bar"
