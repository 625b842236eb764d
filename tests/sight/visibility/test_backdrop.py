"""What is behind a box, by hand: a colour that looks the same takes coverage away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from sqrp_cli.geometry import Array, look_at, pose
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.shapes import Part
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.solids import Solid, load_solid
from sqrp_cli.sight.targets import SoughtBox
from tests.sight.views import box_part, look, make_box, make_camera, make_detector

EYE = (0.0, -1.0, 0.0)
"""Where the camera is; it looks along y, at a cube in the origin."""

SEES_HALF = make_detector(min_visible=0.5)


def painted(part: Part, color: str | None) -> Solid:
    return replace(load_solid(part), color=color)


def plate(name: str, y: float, color: str | None, left: float = -1.0, right: float = 1.0) -> Solid:
    """A plate across the view at a distance behind the cube, from left to right [m]."""
    return painted(box_part(name, (right - left, 0.01, 2.0), pose(position=((left + right) / 2, y, 0.0))), color)


CUBE = replace(make_box(detector=SEES_HALF), seeks="cube", color="green")


def seen(solids: tuple[Solid, ...], box: SoughtBox = CUBE, X_WC: Array | None = None) -> BoxVerdicts:
    X_WC = look_at(EYE, (0.0, 0.0, 0.0)) if X_WC is None else X_WC
    return look(make_camera(X_WC), box, solids, {"cube": pose()[None]})


CASES: Mapping[str, tuple[tuple[Solid, ...], str | None]] = {
    "nothing behind": ((), None),
    "a wall of its colour": ((plate("wall", 1.0, "green"),), "wall"),
    "a wall that looks alike": ((plate("wall", 1.0, "Green"),), "wall"),
    "a wall of another colour": ((plate("wall", 1.0, "red"),), None),
    "a grey wall": ((plate("wall", 1.0, "grey"),), None),
    "a wall without a colour": ((plate("wall", 1.0, ""),), None),
    "a grey wall before one of its colour": ((plate("wall", 1.0, "green"), plate("grey", 0.5, "grey")), None),
    "one of its colour before a grey wall": ((plate("wall", 0.5, "green"), plate("grey", 1.0, "grey")), "wall"),
    "the robot before a wall of its colour": ((plate("wall", 1.0, "green"), plate("arm", 0.5, None)), "wall"),
    "a wall behind less than half of it": ((plate("wall", 1.0, "green", left=0.005),), None),
    "a wall behind more than half of it": ((plate("wall", 1.0, "green", left=-0.005),), "wall"),
    "a wall beside it": ((plate("wall", 1.0, "green", left=0.2),), None),
    "what it stands on": ((painted(box_part("mat", (2.0, 2.0, 0.02), pose(position=(0, 0, -0.03))), "green"),), None),
}


@pytest.mark.parametrize(("solids", "by"), CASES.values(), ids=CASES.keys())
def test_a_box_must_be_told_from_what_is_behind_it(solids: tuple[Solid, ...], by: str | None) -> None:
    verdict = seen(solids)
    assert Cause(int(verdict.cause[0, 0])) is (Cause.NONE if by is None else Cause.SAME_COLOUR)
    assert (None if by is None else solids[int(verdict.by[0, 0])].name) == by


def test_from_above_what_it_stands_on_is_behind_it() -> None:
    mat = painted(box_part("mat", (2.0, 2.0, 0.02), pose(position=(0, 0, -0.03))), "green")
    above = look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert seen((mat,), X_WC=above).cause[0, 0] == Cause.SAME_COLOUR


def test_the_object_itself_is_never_behind_its_box() -> None:
    moved = painted(box_part("moved", (0.3, 0.01, 0.3), pose(position=(0.0, 1.0, 0.0)), parent="cube"), "green")
    assert seen((moved,)).cause[0, 0] == Cause.NONE


@pytest.mark.parametrize("box", [replace(CUBE, color=None), replace(CUBE, color="grey"), replace(CUBE, color="lilac")])
def test_without_a_colour_that_detectors_know_nothing_is_said(box: SoughtBox) -> None:
    assert seen((plate("wall", 1.0, "green"), plate("other", 2.0, "lilac")), box).cause[0, 0] == Cause.NONE


def test_what_hides_and_what_is_alike_behind_count_together() -> None:
    """A third hidden, a third before its colour: what is left is less than half."""
    wall, screen = plate("wall", 1.0, "green", left=0.02), plate("screen", -0.3, "grey", right=-0.0045)
    assert seen((wall,)).cause[0, 0] == seen((screen,)).cause[0, 0] == Cause.NONE
    both = seen((wall, screen))
    assert both.cause[0, 0] == Cause.SAME_COLOUR
    assert both.by[0, 0] == 0
