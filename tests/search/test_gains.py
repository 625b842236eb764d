"""What lenses see by a light, each with a gain of its own: by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from sqrp_cli.camera.camera import ImageEntry
from sqrp_cli.camera.light import Light
from sqrp_cli.cell.mounts import LensChoice, Spot
from sqrp_cli.geometry import look_at
from sqrp_cli.search.sites import Installation, verdicts_of
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates, fixed_frame
from tests.sight.visibility.test_lighting import CUBE, GREEN

ABOVE = look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""A camera that sees the top of the cube alone."""
STATES = SceneStates(1, {"world": fixed_frame(), "cube": fixed_frame()})

IMAGE = ImageEntry(width=640, height=480, horizontal_fov=1.0)
LENSES = [
    LensChoice(name=f"gain {gain}", image=IMAGE, price=1.0, rate=10.0, latency=0.05, near=0.01, far=10.0, gain=gain)
    for gain in (1.0, 0.4, 2.0, 60.0, None)
]
WAY = SimpleNamespace(
    scene=SimpleNamespace(targets=[SimpleNamespace(boxes=(CUBE,))]),
    states=STATES,
    items=(np.array([0]), np.array([0])),
    needed=np.array([1]),
)


def seen(lights: dict[str, Light], lenses: list[LensChoice] = LENSES) -> list[bool]:
    """Whether each lens sees the top of a green cube from above."""
    spot = Spot(
        mount="m", name="m", frame="world", position=ABOVE[:3, 3], entry=SimpleNamespace(), lenses=tuple(lenses)
    )
    cell = SimpleNamespace(observer=Observer((), (), lights))
    places = [Installation(spot, ABOVE, None, np.zeros(3), lens) for lens in lenses]
    return verdicts_of(cell, WAY, places)[:, 0].tolist()


def test_light_is_judged_with_the_gain_of_each_lens_in_any_order() -> None:
    dim = {"sun": Light(intensity=0.7 * GREEN, direction=(0.0, 0.0, -1.0))}
    assert seen(dim) == [False, False, True, False, False]  # too dark, too dark, enough, too bright, as with gain 1
    assert seen(dim, LENSES[::-1]) == [False, False, True, False, False]


def test_without_lights_no_gain_matters() -> None:
    assert seen({}) == [True] * len(LENSES)
