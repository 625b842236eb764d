"""Detectors as they are: their curves and how far they read markers, against images that are drawn here.

Curves are learned by `calibrate` from labelled frames of some seeds and judged on those of others: things at random
poses before cameras with different lenses. Each image is the mean of pictures while the shutter is open, with noise,
through JPEG; what was drawn is known.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from sqrp_cli.ask.api.calibration import calibrate
from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import Detector, marker_range
from sqrp_cli.camera.markers import DICTIONARIES, ObjectMarker
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.calibrating.fit import DetectorLooks, fit, judge, tell
from sqrp_cli.geometry import Array, look_at, matrix_to_quaternion, pose
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.vision import find_markers
from tests.cells import ROOT, read_cases, write_cell
from tests.run.cell.scenes import camera, thing
from tests.run.perception.detector_limits import Stage, color_rates, marker_rate, staged, tilted

EXPOSURE = 0.02
"""Of every camera [s]."""

SUBFRAMES = 5
"""Pictures of which an image is the mean, where something moves."""

NOISE, QUALITY = 6.0, 75
"""Standard deviation of a pixel, of 255, besides the renderer's own; quality of the JPEG, of 100."""

AWAY = pose(position=(0.0, 0.0, -6.0))
"""Below the floor."""

SIDES = {"cube": 0.05, "plate": 0.045}
"""Of the coloured cube and of the marker on the plate [m]."""

SCREEN = 0.4
"""Side of what is held before them [m]."""

COLUMNS = ("camera", "file", "object", "detector", "there", *"xyz", "qx", "qy", "qz", "qw", "vx", "vy", "vz")


def write_workspace(folder: Path) -> Workspace:
    """A cell with the things."""
    folder.mkdir(parents=True, exist_ok=True)
    document = read_cases("labelled_cell.yaml")
    document["robot"]["urdf"] = str(ROOT / "tests" / "run" / "cell" / "post.urdf")
    return load_workspace(write_cell(document, folder))


class Shot(NamedTuple):
    """What is drawn: a thing, and perhaps a screen before it."""

    camera: str
    thing: str
    X_WO: Array
    velocity: Array
    X_screen: Array
    there: bool


def shots(workspace: Workspace, thing: str, count: int, seed: int) -> list[Shot]:
    """Random views of a thing, by all cameras in turn."""
    random, cameras = np.random.default_rng([seed, len(thing)]), list(workspace.cameras.values())
    return [_shot(cameras[number % len(cameras)], thing, random) for number in range(count)]


def _shot(camera: Camera, thing: str, random: np.random.Generator) -> Shot:
    focal, side, X_WC = float(camera.matrix[0, 0]), SIDES[thing], camera.X_FC
    pixels = float(np.exp(random.uniform(np.log(3.0 if thing == "cube" else 6.0), np.log(60.0))))
    incidence = float(np.arccos(random.uniform(np.cos(np.radians(84.0)), 1.0)))
    depth = float(np.clip(focal * side / pixels, 0.15, 6.0))
    reach = 0.38 * np.array([camera.width, camera.height]) / focal
    center = depth * np.array([*random.uniform(-reach, reach), 1.0])
    X_WO = X_WC @ pose(tilted(center, incidence, random), center)
    blur = float(random.uniform(0.0, 0.6) * pixels) if random.random() < 0.5 else 0.0
    heading = random.uniform(-np.pi, np.pi)
    velocity_C = np.array([np.cos(heading), np.sin(heading), 0.0]) * blur * depth / focal / EXPOSURE
    screen = AWAY
    if random.random() < 0.35:  # the edge of the screen runs across the thing
        turn = random.uniform(-np.pi, np.pi)
        across, along = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
        edge = 0.9 * (center + across * random.uniform(-0.8, 0.8) * side)
        screen = X_WC @ pose(np.column_stack([across, along, (0.0, 0.0, 1.0)]), edge + across * SCREEN / 2)
    there = thing == "plate" or bool(random.random() < 0.7)
    return Shot(camera.name, thing, X_WO, X_WC[:3, :3] @ velocity_C, screen, there)


def write_frames(workspace: Workspace, folder: Path, taken: Sequence[Shot], seed: int, detector: str) -> None:
    """Draw the shots, and write images and labels."""

    def numbers(*values: Array) -> list[str]:
        return [f"{value:.9g}" for value in np.concatenate(values)]

    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng([seed, 1])
    with closing(Stage(workspace)) as stage, (folder / "labels.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        for number, shot in enumerate(taken):
            name, X, X_screen = f"{number:05}.png", shot.X_WO, shot.X_screen
            image = _image(stage, shot, number, random)
            cv2.imwrite(str(folder / name), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
            own = numbers(X[:3, 3], matrix_to_quaternion(X[:3, :3]), shot.velocity)
            rows.writerow([shot.camera, name, shot.thing, detector, "yes" if shot.there else "no", *own])
            own = numbers(X_screen[:3, 3], matrix_to_quaternion(X_screen[:3, :3]))
            rows.writerow([shot.camera, name, "screen", "", "", *own, "", "", ""])


def _image(stage: Stage, shot: Shot, number: int, random: np.random.Generator) -> ImageArray:
    for name, X in (("cube", AWAY), ("plate", AWAY), ("screen", shot.X_screen)):
        stage.put(name, X)
    moves = bool(np.abs(shot.velocity).max() > 0)
    times = EXPOSURE * (np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - EXPOSURE / 2 if moves else np.zeros(1)
    total = np.zeros(stage.frame(shot.camera, float(number)).image.shape, dtype=np.float32)
    for t in times.tolist():
        if shot.there:
            stage.put(shot.thing, pose(shot.X_WO[:3, :3], shot.X_WO[:3, 3] + t * shot.velocity))
        total += stage.frame(shot.camera, number + t).image
    noisy = total / len(times) + NOISE * random.standard_normal(total.shape, dtype=np.float32)
    shown = cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR)
    _, content = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    seen: ImageArray = cv2.cvtColor(cv2.imdecode(content, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    return seen


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
        return marker_range(self.camera, self.markers[0].on(self.size), self.incidence)[1]

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
                seen[trial] = any(number == wanted for number, _ in found)
                stage.put(plate.name, away)
        one = np.ones(count)  # a curve through all of them
        sights = np.stack([1.0 / distance, 0.0 * one, one, one, 0.0 * one])
        looks = DetectorLooks(sights=sights, seen=seen, covered=seen, pose=np.arange(count))
        curve = fit(looks, Detector(kind="aruco", distance=(0.0, 2.0), max_incidence=1.5, min_pixels=0.0))
        assert curve.pixels
        share = 0.9 / curve.most
        return float(np.exp((curve.bias - np.log(share / (1.0 - share))) / curve.pixels))


MOST_ERROR, MOST_OF_LIMITS, MOST_OFF = 0.03, 0.5, 0.1
"""Asked: calibration error, Brier score as a share of that of the limits, and by how much ranges are off."""
FRAMES, LOOKS = 1600, 1000
"""Of each kind and seed, and random views of each marker."""


def curves(number: int, folder: Path) -> dict[str, Any]:
    """The curve of a detector, learned from the frames of one seed and judged on those of another."""
    detector, kind = (("aruco", "plate"), ("color", "cube"))[number]
    workspace, looks = write_workspace(folder / "cell"), dict[int, DetectorLooks]()
    for seed in (2, 1):
        write_frames(workspace, folder / f"{seed}", shots(workspace, kind, FRAMES, seed), seed, detector)
        found = calibrate(folder / f"{seed}", workspace=folder / "cell")
        looks[seed] = found.looked[detector]
    curve, others = found.detectors[detector].curve, looks[2]
    assert curve is not None
    own = judge(tell(curve, others, workspace.detectors[detector]), others.seen)
    ratio, error = own.brier / judge(others.covered * 1.0, others.seen).brier, own.calibration_error
    said = f"{detector}: calibration error {100 * error:.1f} points, Brier score {ratio:.2f} of that of limits"
    return {"said": said, "good": bool(error <= MOST_ERROR and ratio <= MOST_OF_LIMITS)}


def ranges(number: int, _folder: Path) -> dict[str, Any]:
    """Any size, dictionary, lens and angle, against images."""
    case = Case.by_seed(number)
    predicted, measured = case.predicted, case.measured(LOOKS, number)
    off = predicted / measured - 1.0
    said = f"{case}: predicted {predicted:.2f} m, measured {measured:.2f} m, {100 * off:+.1f} %"
    return {"said": said, "good": bool(abs(off) <= MOST_OFF)}


INCIDENCES, SHARES = (0, 30, 50, 60, 65, 70, 75, 80), (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2)


def limits(number: int, _folder: Path) -> dict[str, Any]:
    """How often markers at an angle are found, or cubes with a visible share judged right, by their size [pixels]."""
    if number < len(INCIDENCES):
        rates = {size: marker_rate(size, np.radians(INCIDENCES[number]), 40) for size in (8, 10, 12, 16, 20, 30)}
        found, what = {size: f"{rate:.0%}" for size, rate in rates.items()}, f"markers at {INCIDENCES[number]} deg"
    else:
        share = SHARES[number - len(INCIDENCES)]
        pairs = {size: color_rates(size, share, 40) for size in (4, 6, 8, 12, 16, 24)}
        found = {size: f"{there:.0%}/{gone:.0%}" for size, (there, gone) in pairs.items()}
        what = f"cubes of which {share:.0%} is visible, there/gone"
    return {"said": f"{what}: " + ", ".join(f"{size} px {rate}" for size, rate in found.items())}
