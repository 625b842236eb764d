"""Cells by seed, with a suction cup or with two fingers, in which parts may slip."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sqrp_cli.geometry import Array
from tests.cells import shipped_cell, write_cell
from tests.random_cell import Crowd, random_cell

ROOT = Path(__file__).parents[2]

TASK = "pickup"

CUBES, CAMERAS = 4, 3

SCREWS = 3

SPEED, ACCELERATION, JERK = "60 deg/s", "300 deg/s^2", "3000 deg/s^3"
"""Of the arm with fingers: faster than that of `screws`, so that a trial takes less time."""


def make_cell(folder: Path, seed: int) -> Path:
    """A new cell in a folder; the even seeds have a suction cup and cubes, the odd ones two fingers and screws."""
    if seed % 2 == 0:
        return random_cell(folder, Crowd(seed, CUBES, CAMERAS))
    folder.mkdir()
    rng = np.random.default_rng(seed)
    cell = shipped_cell("screws")
    cell["skills"] = [str(ROOT / "skills" / "pickup")]
    for key, value in {"velocity": SPEED, "acceleration": ACCELERATION, "jerk": JERK}.items():
        limits = cell["robot"]["limits"][key]
        limits.update({joint: value for joint in limits if "finger" not in joint})
    places = list(_places(rng))
    table = {"table": cell["objects"]["table"]}
    cell["objects"] = table | {f"red{i + 1}": _screw(place) for i, place in enumerate(places)}
    cell["state"] = ["open", *(f"obj_on_table({name})" for name in cell["objects"] if name != "table")]
    cell["cameras"] = {f"cam{i + 1}": _camera(rng, places) for i in range(CAMERAS)}
    cell["tasks"] = [{"task": TASK}]
    write_cell(cell, folder)
    return folder


def _places(rng: np.random.Generator) -> list[Array]:
    """Where the screws stand [m]: in a ring around the robot, apart from each other."""
    found: list[Array] = []
    while len(found) < SCREWS:
        turn, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.65)
        place = np.array([far * np.cos(turn), far * np.sin(turn), 0.03]).round(3)
        if all(np.hypot(*(place - other)[:2]) > 0.2 for other in found):
            found.append(place)
    return found


def _screw(place: Array) -> dict[str, object]:
    return {
        "type": "screw",
        "color": "red",
        "size": ["3 cm", "3 cm", "6 cm"],
        "pose": {"position": place.tolist()},
        "on": "table",
    }


def _camera(rng: np.random.Generator, places: list[Array]) -> dict[str, object]:
    """A camera on a dome over one of the screws, which looks at some place beside it."""
    turn, height, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 1.0), rng.uniform(0.8, 1.3)
    target = places[rng.integers(len(places))] + rng.uniform(-0.08, 0.08, 3) + [0, 0, 0.08]
    ray = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
    return {
        "pose": {"position": (target + far * ray).round(3).tolist(), "look_at": target.round(3).tolist()},
        "image": {"width": 1024, "height": 768, "horizontal_fov": "48 deg"},
        "near": "20 cm",
        "far": "4 m",
        "rate": "10 Hz",
        "latency": "50 ms",
    }
