"""How far away markers are read, measured in images of the simulated cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import BoxSights, Detector, MarkerRange
from sqrp_cli.camera.markers import DICTIONARIES, ObjectMarker
from sqrp_cli.field.calibrating.fit import DetectorLooks, fit
from sqrp_cli.geometry import look_at, pose
from sqrp_cli.run.perception.vision import find_markers
from tests.run.cell.scenes import camera, thing
from tests.run.perception.detector_limits import staged, tilted

SPREAD = 1.7
"""How much nearer and farther than predicted markers are looked at."""

MIDDLE = 0.1
"""How far from the middle of the image, at most, as a tangent: lenses stretch what is farther out."""

MARKERS = 5
"""Of a dictionary: which bits a marker has makes up to a tenth of its range."""


class Case(NamedTuple):
    """A marker before a camera."""

    dictionary: str
    side: float
    """[m]"""
    width: int
    """Of the image, 4:3 [pixels]."""
    focal: float
    """[pixels]"""
    incidence: float
    """[rad]"""
    ids: tuple[int, ...] = (5,)
    """Of the markers that are looked at in turn."""

    @classmethod
    def by_seed(cls, seed: int) -> Case:
        """Any dictionary, size and lens, and some of its markers, turned by up to 70 degrees."""
        random = np.random.default_rng(seed)
        dictionary = str(random.choice(list(DICTIONARIES)))
        return cls(
            dictionary=dictionary,
            side=round(float(random.uniform(0.03, 0.1)), 3),
            width=int(random.choice([640, 800, 1024, 1280])),
            focal=round(float(random.uniform(500.0, 1100.0))),
            incidence=float(np.radians(random.uniform(0.0, 70.0))),
            ids=tuple(random.choice(DICTIONARIES[dictionary].ids, MARKERS, replace=False).tolist()),
        )

    @property
    def camera(self) -> Camera:
        size = (self.width, self.width * 3 // 4)
        return camera(X_FC=look_at((3.0, 0.0, 2.0), (5.0, 0.0, 1.5)), size=size, focal=(self.focal, self.focal))

    @property
    def markers(self) -> list[ObjectMarker]:
        return [ObjectMarker(id=one, dictionary=self.dictionary, side=self.side) for one in self.ids]

    @property
    def size(self) -> tuple[float, float, float]:
        """Of the plate that a marker is on [m]."""
        return 1.5 * self.side, 1.5 * self.side, 0.002

    @property
    def predicted(self) -> float:
        """How far away nine of ten images show it [m]."""
        return MarkerRange.of(self.camera, self.markers[0].on(self.size), self.incidence).far

    def measured(self, count: int, seed: int) -> float:
        """The same by random views, at distances up to `SPREAD` times nearer and farther than predicted [m]."""
        random, eye = np.random.default_rng([seed, self.width, round(self.focal)]), self.camera
        plates = [thing(f"plate {one.id}", (4, 0, 0.02), self.size, color="white", marker=one) for one in self.markers]
        away = pose(position=eye.X_FC[:3, 3] - 10.0 * eye.X_FC[:3, 2])
        distance = self.predicted * SPREAD ** random.uniform(-1.0, 1.0, count)
        seen = np.zeros(count, dtype=bool)
        with staged(plates, [eye]) as stage:
            for plate in plates:
                stage.put(plate.name, away)
            for trial in range(count):
                plate, wanted = plates[trial % len(plates)], self.ids[trial % len(plates)]
                center = distance[trial] * np.array([*random.uniform(-MIDDLE, MIDDLE, 2), 1.0])
                stage.put(plate.name, eye.X_FC @ pose(tilted(center, self.incidence, random), center))
                found = find_markers(stage.frame("cam", trial).image, self.dictionary)
                seen[trial] = any(marker.id == wanted for marker in found)
                stage.put(plate.name, away)
        return _nine_of_ten(distance, seen)


def _nine_of_ten(distance: np.ndarray, seen: np.ndarray) -> float:
    """The distance at which nine of ten images show it, by a curve through all of them."""
    one = np.ones(len(distance))
    sights = BoxSights(pixels=1.0 / distance, incidence=0.0 * one, distance=one, visible=one, blur=0.0 * one)
    looks = DetectorLooks(sights=sights, seen=seen, covered=seen, pose=np.arange(len(seen)))
    curve = fit(looks, Detector(kind="aruco", distance=(0.0, 2.0), max_incidence=1.5, min_pixels=0.0))
    assert curve.pixels
    share = 0.9 / curve.most
    return float(np.exp((curve.bias - np.log(share / (1.0 - share))) / curve.pixels))
