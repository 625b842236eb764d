"""A new workspace filled at random: any number of cubes and cameras, obstacles, tasks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count
from math import ceil, pi, sqrt
from pathlib import Path

import numpy as np

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.starter.layout import Cube, Point, workspace_text
from sqrp_cli.starter.make import make_starter
from sqrp_cli.starter.search import arm_reach

COLORS = ("green", "red", "blue")
"""Colours of the cubes, in turn; each colour in use gets a task."""
CUBES_PER_OBSTACLE = 6
NEAREST, FARTHEST = 0.3, 0.75
"""Ring of the work: distances from the base as shares of the reach; larger if the cubes need more room."""
CLEARANCE = 0.05
"""Least distance between items on the table, added to the half diagonals of their sides [m]."""
HOME_CLEARANCE = 0.25
"""Radius around the tool at home in which nothing tall stands [m]."""
HALF_VIEW = 20 * pi / 180
"""Half the angle within which a camera has one cube at least [rad]; its image is wider."""
DRAWN_VIEWS = 200
"""How many views are drawn at most until one has a cube."""


@dataclass(frozen=True)
class Crowd:
    """Random contents of a cell; seed: of all random numbers."""

    seed: int
    objects: int
    cameras: int


def random_cell(folder: Path, crowd: Crowd) -> Path:
    """A new workspace with cubes, obstacles, cameras and tasks drawn at random; returns its folder.

    Not every cube is in reach of the arm from every side: some candidates are infeasible, as in real cells.
    """
    layout = make_starter(folder, None)
    cell = Cell.load(load_workspace(folder))
    reach, rng, size = arm_reach(cell.model), np.random.default_rng(crowd.seed), layout.cube_size
    base = np.array(cell.model.joint_origins(cell.model.home)[0, :2])
    home = cell.model.tool_pose(cell.model.home)[:2, 3]
    farthest = max(FARTHEST * reach, sqrt((NEAREST * reach) ** 2 + crowd.objects * 3 * (size + CLEARANCE) ** 2 / pi))
    taken: list[tuple[Array, float]] = []  # the middle and radius of each item [m]

    def free_place(radius: float, by: float) -> Array:
        """A place for an item, uniform over the ring around the base, which grows if none is free; (2,), in whole mm.

        by: the distance to keep from the tool at home.
        """
        for tries in count():
            distance = sqrt(rng.uniform((NEAREST * reach + radius) ** 2, (farthest * 1.1 ** (tries // 200)) ** 2))
            turn = rng.uniform(-pi, pi)
            place = (base + distance * np.array([np.cos(turn), np.sin(turn)])).round(3)
            apart = all(np.linalg.norm(other - place) - r - radius > CLEARANCE for other, r in taken)
            if apart and np.linalg.norm(place - home) >= by:
                taken.append((place, radius))
                return place
        raise AssertionError

    obstacles, cubes = [], []
    for index in range(crowd.objects // CUBES_PER_OBSTACLE):
        extents = rng.uniform((0.06, 0.06, 0.08), (0.12, 0.12, 0.2)).round(2)
        place = free_place(float(np.hypot(*extents[:2])) / 2, HOME_CLEARANCE)
        size_of, at = list(_triple(extents)), list(_triple([*place, extents[2] / 2]))
        head = f"  block{index + 1}: {{type: block, color: grey, size: {size_of}, pose: {{position: {at}}}"
        obstacles.append(f"{head}, fixed: true, on: table}}\n")
    for index in range(crowd.objects):
        color, place = COLORS[index % len(COLORS)], free_place(size / sqrt(2), 0.0)
        cubes.append(Cube(f"{color[0]}{index // len(COLORS) + 1}", color, _triple([*place, size / 2])))
    places = np.array([cube.position for cube in cubes])
    views = {f"cam{index + 1}": _view_of_some(rng, base, reach, places) for index in range(crowd.cameras)}
    edge = max(farthest + float(np.abs(base).max()), *(float(np.abs(place).max()) + radius for place, radius in taken))
    side = max(layout.table_side, ceil(20 * (edge + 0.2)) / 10)
    text = workspace_text(replace(layout, cubes=cubes, views=views, table_side=side))
    tasks = "".join(f"  - {{task: pickup {color}}}\n" for color in dict.fromkeys(cube.color for cube in cubes))
    text = text[: text.index("tasks:\n")] + f"tasks:\n{tasks}"
    start = text.index("\n", text.index(f"  {cubes[-1].name}: {{")) + 1
    (folder / "workspace.yaml").write_text(text[:start] + "".join(obstacles) + text[start:], encoding="utf-8")
    return folder


def _view_of_some(rng: np.random.Generator, base: Array, reach: float, places: Array) -> tuple[Point, Point]:
    """Where a camera on a dome over the cell is, and the place of the work that it looks at, both drawn.

    At least one of the places (n, 3) is well inside its image; where none is drawn so, as with few places far out, it
    looks at the first of them.
    """
    for _ in range(DRAWN_VIEWS):
        turn, height, distance = rng.uniform(-pi, pi), rng.uniform(0.5, 1.2), rng.uniform(0.9, 1.6) * reach
        around, far = rng.uniform(-pi, pi), rng.uniform(NEAREST, FARTHEST) * reach
        target = np.array([*(base + far * np.array([np.cos(around), np.sin(around)])), 0.05])
        ray = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
        eye, looks_at = _triple(target + distance * ray), _triple(target)
        rays, axis = places - np.array(eye), np.subtract(looks_at, eye)
        cosines = rays @ axis / (np.linalg.norm(rays, axis=1) * np.linalg.norm(axis))
        if cosines.max() > np.cos(HALF_VIEW):
            return eye, looks_at
    return eye, _triple(places[0])


def _triple(values: Array | list[float]) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 3) for value in values)
    return x, y, z
