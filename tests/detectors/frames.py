"""Labelled frames by seed: things at random poses before cameras with different lenses, blurred, noisy and compressed.

Each image is the mean of pictures while the shutter is open, with noise, through JPEG; what was drawn is known.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, matrix_to_quaternion, pose
from sqrp_cli.run.image import ImageArray
from tests.cells import write_cell
from tests.run.cell.scenes import ROOT
from tests.run.perception.detector_limits import Stage, tilted

EXPOSURE = 0.02
"""Of every camera [s]."""

SUBFRAMES = 5
"""Pictures of which an image is the mean, where something moves."""

NOISE, QUALITY = 6.0, 75
"""Standard deviation of a pixel, of 255, besides the renderer's own; quality of the JPEG, of 100."""

AWAY = pose(position=(0.0, 0.0, -6.0))
"""Below the floor."""

LENSES = {"near": (640, 480, 35.0), "wide": (640, 480, 60.0), "fine": (960, 720, 45.0)}
"""Width and height [pixels], and horizontal field of view [deg] of each camera."""

CUBE, PLATE, SCREEN = 0.05, 0.06, (0.4, 0.4, 0.004)
"""Side of the coloured cube and of the plate with the marker, and size of what is held before them [m]."""

COLUMNS = ("camera", "file", "object", "detector", "there", *"xyz", "qx", "qy", "qz", "qw", "vx", "vy", "vz")

MARKER = {"id": 7, "dictionary": "4x4_50", "side": 0.045}


def write_workspace(folder: Path, detectors: dict[str, object] | None = None) -> Workspace:
    """A cell with the things, 2 m apart from the robot, and the limits that the shipped cells state."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = {
        name: {
            "pose": {"position": [4.0, -1.0 + index, 3.0], "look_at": [4.0, -1.0 + index, 0.0], "up": [1, 0, 0]},
            "image": {"width": width, "height": height, "horizontal_fov": f"{fov} deg"},
            "near": 0.05,
            "far": 10.0,
            "rate": 10,
            "exposure": EXPOSURE,
        }
        for index, (name, (width, height, fov)) in enumerate(LENSES.items())
    }
    things: dict[str, dict[str, object]] = {
        "cube": {"type": "cube", "color": "green", "size": [CUBE] * 3},
        "plate": {"type": "plate", "color": "white", "size": [PLATE, PLATE, 0.004], "marker": MARKER},
        "screen": {"type": "screen", "color": "black", "size": list(SCREEN)},
    }
    document = {
        "robot": {"urdf": str(ROOT / "tests/run/cell/post.urdf"), "tool_frame": "tip", "home": {"turn": 0.0}},
        "detectors": detectors
        or {
            "color": {
                "kind": "color",
                "distance": [0.2, 3.0],
                "max_incidence": 1.57,
                "min_pixels": 12,
                "min_visible": 0.5,
            },
            "aruco": {"kind": "aruco", "distance": [0.15, 2.5], "max_incidence": 1.047, "min_pixels": 24},
        },
        "cameras": cameras,
        "objects": {
            "floor": {
                "type": "floor",
                "color": "grey",
                "size": [20, 20, 0.02],
                "pose": {"position": [4, 0, -4.0]},
                "fixed": True,
            },
            **{
                name: {**thing, "pose": {"position": [4.0, 5.0 + k, 0.5]}}
                for k, (name, thing) in enumerate(things.items())
            },
        },
    }
    return load_workspace(write_cell(document, folder))


@dataclass(frozen=True, eq=False)
class Shot:
    """What is drawn: a thing, and perhaps a screen before it."""

    camera: str
    thing: str
    X_WO: Array
    velocity: Array
    X_screen: Array | None
    there: bool


def shots(workspace: Workspace, thing: str, count: int, seed: int) -> list[Shot]:
    """Random views of a thing, by all cameras in turn."""
    random = np.random.default_rng([seed, len(thing)])
    names = list(LENSES)
    return [_shot(workspace.cameras[names[number % len(names)]], thing, random) for number in range(count)]


def _shot(camera: Camera, thing: str, random: np.random.Generator) -> Shot:
    focal, side = float(camera.matrix[0, 0]), CUBE if thing == "cube" else 0.045
    pixels = float(np.exp(random.uniform(np.log(3.0 if thing == "cube" else 6.0), np.log(60.0))))
    incidence = float(np.arccos(random.uniform(np.cos(np.radians(84.0)), 1.0)))
    depth = float(np.clip(focal * side / pixels, 0.15, 6.0))
    reach = 0.38 * np.array([camera.width, camera.height]) / focal
    center = depth * np.array([*random.uniform(-reach, reach), 1.0])
    R = tilted(center, incidence, random)
    X_CO = pose(R, center)
    X_WC = camera.X_FC
    blur = float(random.uniform(0.0, 0.6) * pixels) if random.random() < 0.5 else 0.0
    heading = random.uniform(-np.pi, np.pi)
    velocity_C = np.array([np.cos(heading), np.sin(heading), 0.0]) * blur * depth / focal / EXPOSURE
    screen = None
    if random.random() < 0.35:
        screen = X_WC @ _screen(center, side, random)
    return Shot(
        camera.name,
        thing,
        X_WC @ X_CO,
        X_WC[:3, :3] @ velocity_C,
        screen,
        thing == "plate" or bool(random.random() < 0.7),
    )


def _screen(center: Array, side: float, random: np.random.Generator) -> Array:
    """A screen before the thing whose edge runs across it."""
    turn = random.uniform(-np.pi, np.pi)
    across, along = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    edge = 0.9 * (center + across * random.uniform(-0.8, 0.8) * side)
    return pose(np.column_stack([across, along, (0.0, 0.0, 1.0)]), edge + across * SCREEN[0] / 2)


def write_frames(workspace: Workspace, folder: Path, taken: Sequence[Shot], seed: int, detector: str) -> None:
    """Draw the shots, and write images and labels."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng([seed, 1])
    stage = Stage(workspace)
    try:
        with (folder / "labels.csv").open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(COLUMNS)
            for number, shot in enumerate(taken):
                name = f"{number:05}.png"
                image = _image(stage, shot, number, random)
                cv2.imwrite(str(folder / name), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
                X_screen = AWAY if shot.X_screen is None else shot.X_screen
                yes = "yes" if shot.there else "no"
                rows.writerow(
                    [shot.camera, name, shot.thing, detector, yes, *_numbers(shot.X_WO), *_text(shot.velocity)]
                )
                rows.writerow([shot.camera, name, "screen", "", "", *_numbers(X_screen), "", "", ""])
    finally:
        stage.close()


def _image(stage: Stage, shot: Shot, number: int, random: np.random.Generator) -> ImageArray:
    for name in ("cube", "plate", "screen"):
        stage.put(name, AWAY)
    if shot.X_screen is not None:
        stage.put("screen", shot.X_screen)
    moves = bool(np.abs(shot.velocity).max() > 0)
    times = EXPOSURE * (np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - EXPOSURE / 2 if moves else np.zeros(1)
    total = np.zeros(stage.frame(shot.camera, float(number)).image.shape, dtype=np.float32)
    for t in times.tolist():
        if shot.there:
            stage.put(shot.thing, pose(shot.X_WO[:3, :3], shot.X_WO[:3, 3] + t * shot.velocity))
        total += stage.frame(shot.camera, number + t).image
    noisy = total / len(times) + NOISE * random.standard_normal(total.shape, dtype=np.float32)
    _, content = cv2.imencode(
        ".jpg",
        cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, QUALITY],
    )
    seen: ImageArray = cv2.cvtColor(cv2.imdecode(content, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    return seen


def _numbers(X: Array) -> list[str]:
    return [*_text(X[:3, 3]), *_text(matrix_to_quaternion(X[:3, :3]))]


def _text(values: Array) -> list[str]:
    return [f"{value:.9g}" for value in values]
