"""How boxes are lit, by hand: cosines, shadows, gains and what a detector of colours can still tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.camera.light import Light, brightness_of
from sqrp_cli.geometry import look_at, pose
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.solids import Solid, load_solid
from sqrp_cli.sight.targets import SoughtBox
from tests.sight.views import box_part, look, make_box, make_camera, make_detector

GREEN = 39.5 / 255 / 0.65
"""The least light in which green paint has a value of 40 of 255, rounded."""

CUBE = replace(make_box(detector=make_detector(min_visible=0.5)), seeks="cube", color="green")
SIDE = CUBE.size[0]


def plate(left: float, right: float, height: float = 0.3) -> Solid:
    """A plate over the cube from left to right [m], beyond the sight of a camera above it that looks past."""
    return load_solid(box_part("roof", (right - left, 1.0, 0.002), pose(position=((left + right) / 2, 0.0, height))))


def cause(
    lights: Mapping[str, Light], solids: tuple[Solid, ...] = (), box: SoughtBox = CUBE, gain: float | None = None
) -> tuple[Cause, int]:
    """The verdict of a camera below a roof, and its culprit."""
    camera = replace(make_camera(look_at((0.0, 0.0, 0.25), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))), gain=gain)
    verdict = look(camera, box, solids, {"cube": pose()[None]}, lights)
    return Cause(int(verdict.cause[0, 0])), int(verdict.by[0, 0])


def sun(intensity: float, *direction: float) -> Light:
    return Light(intensity=intensity, direction=direction or (0.0, 0.0, -1.0))  # type: ignore[arg-type]


@pytest.mark.parametrize("factor", [0.98, 1.02])
@pytest.mark.parametrize(
    "lights",
    [
        {"room": Light(intensity=GREEN)},
        {"sun": sun(GREEN)},
        {"sun": sun(2 * GREEN, 3**0.5, 0.0, -1.0)},  # 60 degrees from the normal
        {"room": Light(intensity=GREEN / 2), "sun": sun(GREEN / 2)},
        {"lamp": Light(intensity=4 * GREEN, position=(0.0, 0.0, 2.0 + SIDE / 2), look_at=(0.0, 0.0, 0.0))},
    ],
    ids=["everywhere", "from above", "aslant", "both", "a lamp at twice the metre"],
)
def test_light_adds_up_by_cosine_and_distance(lights: Mapping[str, Light], factor: float) -> None:
    scaled = {name: replace(light, intensity=factor * light.intensity) for name, light in lights.items()}
    expected = Cause.NONE if factor > 1 else Cause.TOO_DARK
    assert cause(scaled)[0] is expected
    assert cause(lights, gain=factor)[0] is expected


def test_a_lamp_does_not_light_what_is_beside_its_beam() -> None:
    lamp = Light(intensity=4.0, position=(0.0, 0.0, 1.0), look_at=(1.0, 0.0, 0.0), beam=np.radians(88))
    assert cause({"lamp": lamp}) == (Cause.TOO_DARK, -1)
    assert cause({"lamp": replace(lamp, beam=np.radians(92))})[0] is Cause.NONE


def test_green_saturates_where_its_blue_and_red_come_near() -> None:
    """Red of 0.08, green of 0.65 and blue of 0.12 of the light: with green cut off, the hue runs away first."""
    light = np.linspace(2.0, 12.0, 2001)
    red, blue = np.minimum(0.08 * light, 1.0), np.minimum(0.12 * light, 1.0)
    hue = 60 + 30 * (blue - red) / (1.0 - red)  # OpenCV's half degrees, of what is greenest
    away = np.abs(hue - 62) > 12.5
    gone = light[(1.0 - red < 90 / 255) | away][0]
    assert brightness_of("green")[1] == pytest.approx(gone, rel=0.03)
    assert cause({"sun": sun(0.97 * gone)})[0] is Cause.NONE
    assert cause({"room": Light(intensity=0.1), "sun": sun(1.03 * gone)}) == (Cause.TOO_BRIGHT, 1)


@pytest.mark.parametrize(("left", "expected"), [(0.1 * SIDE, Cause.NONE), (-0.1 * SIDE, Cause.TOO_DARK)])
def test_half_of_what_is_looked_for_must_be_out_of_the_shadow(left: float, expected: Cause) -> None:
    roof = plate(left, 1.0)
    found = cause({"room": Light(intensity=GREEN / 2), "sun": sun(1.0)}, (roof,))
    assert found == (expected, 0 if expected is Cause.TOO_DARK else -1)


def test_a_shadow_counts_only_where_the_rest_of_the_light_is_too_little() -> None:
    assert cause({"room": Light(intensity=1.05 * GREEN), "sun": sun(1.0)}, (plate(-1.0, 1.0),))[0] is Cause.NONE


def test_what_is_looked_for_and_what_the_box_encloses_cast_no_shadow_on_it() -> None:
    roof = plate(-1.0, 1.0)
    box = replace(CUBE, encloses=("roof",))
    assert cause({"sun": sun(1.0)}, (roof,), box)[0] is Cause.NONE


def test_any_shadow_on_a_marker_is_too_much() -> None:
    marker = replace(
        CUBE, seeks=None, color=None, limits=replace(make_detector(), kind="aruco"), normal=(0.0, 0.0, 1.0)
    )
    lights = {"room": Light(intensity=0.05), "sun": sun(1.0)}
    assert cause(lights, box=marker)[0] is Cause.NONE
    assert cause(lights, (plate(0.4 * SIDE, 1.0),), marker) == (Cause.TOO_DARK, 0)


def test_a_box_that_nothing_is_told_of_needs_no_light() -> None:
    assert cause({"room": Light(intensity=0.0)}, box=replace(CUBE, seeks=None, color="grey"))[0] is Cause.NONE
