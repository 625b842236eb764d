"""How far away markers are read, measured in images of the simulated cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sqrp_cli.calibrating.fit import DetectorLooks, fit
from sqrp_cli.geometry import look_at, pose
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.curve import BoxSights
from sqrp_cli.knowledge.camera.detector import Detector
from sqrp_cli.knowledge.camera.marker_range import MarkerRange
from sqrp_cli.knowledge.markers import DICTIONARIES, ObjectMarker
from sqrp_cli.runtime.perception.vision import find_markers
from tests.runtime.cell.scenes import camera, thing
from tests.runtime.perception.detector_limits import staged, tilted

SPREAD = 1.7
"""How much nearer and farther than predicted markers are looked at."""


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

    @classmethod
    def by_seed(cls, seed: int) -> Case:
        """Any dictionary, size and lens, turned by up to 70 degrees."""
        random = np.random.default_rng(seed)
        return cls(
            dictionary=str(random.choice(list(DICTIONARIES))),
            side=round(float(random.uniform(0.03, 0.1)), 3),
            width=int(random.choice([640, 800, 1024, 1280])),
            focal=round(float(random.uniform(500.0, 1100.0))),
            incidence=float(np.radians(random.uniform(0.0, 70.0))),
        )

    @property
    def camera(self) -> Camera:
        size = (self.width, self.width * 3 // 4)
        return camera(X_FC=look_at((3.0, 0.0, 2.0), (5.0, 0.0, 1.5)), size=size, focal=(self.focal, self.focal))

    @property
    def marker(self) -> ObjectMarker:
        return ObjectMarker(id=5, dictionary=self.dictionary, side=self.side)

    @property
    def predicted(self) -> float:
        """How far away nine of ten images show it [m]."""
        size = (1.5 * self.side, 1.5 * self.side, 0.002)
        return MarkerRange.of(self.camera, self.marker.on(size), self.incidence).far

    def measured(self, count: int, seed: int) -> float:
        """The same by random views, at distances up to `SPREAD` times nearer and farther than predicted [m]."""
        random, eye = np.random.default_rng([seed, self.width, round(self.focal)]), self.camera
        plate = thing(
            "plate", (4, 0, 0.02), (1.5 * self.side, 1.5 * self.side, 0.002), color="white", marker=self.marker
        )
        distance = self.predicted * SPREAD ** random.uniform(-1.0, 1.0, count)
        reach = 0.35 * np.array([self.width, 0.75 * self.width]) / self.focal
        seen = np.zeros(count, dtype=bool)
        with staged([plate], [eye]) as stage:
            for trial in range(count):
                center = distance[trial] * np.array([*random.uniform(-reach, reach), 1.0])
                stage.put("plate", eye.X_FC @ pose(tilted(center, self.incidence, random), center))
                found = find_markers(stage.frame("cam", trial).image, self.dictionary)
                seen[trial] = any(marker.id == 5 for marker in found)
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
