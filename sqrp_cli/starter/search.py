"""Where an arm can work: a home position, cubes within its reach, and cameras that see them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, cross, pose, transform
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.arm.inverse_kinematics import all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.arm.pose_search import spread_starts
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.solids import load_solids
from sqrp_cli.programming.task import read_task
from sqrp_cli.starter.layout import TASK, CameraView, Cube, Position

TOOL_GAP = 0.002
"""Gap between what the arm carries and the suction cup [m]."""

DIRECTIONS = tuple(turn * pi / 180 for turn in (0, -90, 90, 180))
"""Directions from the base in which the work may lie [rad], the preferred one first."""

HOME_SHARES = ((0.55, 0.35), (0.45, 0.3), (0.65, 0.3), (0.5, 0.5), (0.35, 0.35), (0.7, 0.2))
"""Tool positions at home: distance from the base and height above the table, as shares of the reach."""

CUBE_SHARES = (0.5, 0.62, 0.4, 0.72, 0.3)
"""Distances of cubes from the base, as shares of the reach."""

CUBE_TURNS = tuple(turn * pi / 180 for turn in (0, -25, 25, -50, 50))
"""Directions of cubes relative to that of the work [rad]."""

COLORS = ("green", "green", "green", "red")
"""Colours of the cubes, in the order in which they are placed."""

VIEW_HEIGHT = 35 * pi / 180
"""Elevation of the cameras above what they look at [rad]."""

BEHIND, ASIDE = 150 * pi / 180, -60 * pi / 180
"""Directions of the first camera, over the arm's shoulder, and of the second, relative to that of the work [rad]."""

HALF_VIEW = 20 * pi / 180
"""Half the angle within which the first camera sees all cubes [rad]; its image is wider, for arm and lift."""

CLOSE_UP = 0.35
"""Distance of the second camera as a share of the first's: it sees some of the cubes, and what is lifted there."""


@dataclass(frozen=True)
class Home:
    """A home position: of every joint of the arm, and the direction of the work from the base [rad]."""

    positions: Mapping[str, Position]
    direction: float


def tool_seat(cell: Cell, tip: str, carried: Sequence[str], out: Array) -> Array:
    """Pose X_LT of a tool in the link `tip`, z along `out` (3,), beyond everything that the arm carries; (4, 4)."""
    X_WL = cell.model.link_poses(cell.model.home[None])
    X_TW = np.linalg.inv(X_WL[tip][0])
    solids = load_solids([part for part in cell.model.parts if part.parent in carried])
    ends = [transform(X_TW @ X_WL[solid.part.parent][0], solid.vertices) @ out for solid in solids]
    furthest = max((float(end.max()) for end in ends), default=0.0)
    x = np.eye(3)[(int(np.abs(out).argmax()) + 1) % 3]
    x = x - out * (x @ out)
    x = x / np.linalg.norm(x)
    offset = furthest + TOOL_GAP if furthest > TOOL_GAP else 0.0
    return pose(np.column_stack([x, cross(out, x), out]), offset * out)


def lowest_point(cell: Cell) -> float:
    """Height of the lowest point of the links that do not move, in the world [m]; 0 if they have no solid part."""
    bound = cell.collision.bound.depth
    X_WL = cell.model.link_poses(cell.model.home[None])
    still = load_solids([part for part in cell.model.parts if bound[part.parent] == 0])
    return min((float(transform(X_WL[s.part.parent][0], s.vertices)[:, 2].min()) for s in still), default=0.0)


def arm_reach(model: RobotModel) -> float:
    """Approximate horizontal reach of the tool from the arm's first joint [m]."""
    q = spread_starts(model, 512)
    places = model.tool_poses_and_jacobians(q)[0][:, :2, 3]
    return float(np.quantile(np.linalg.norm(places - _root(model), axis=1), 0.98))


def find_home(cell: Cell, reach: float) -> Home | None:
    """A position with the tool pointing down and without contact.

    Of the IK branches at the first place that has any, the one that keeps the joints high and turns them little. None
    if there is none.
    """
    model = cell.model
    for far, high in HOME_SHARES:
        for direction in DIRECTIONS:
            free = _free_branches(cell, tool_down(model, far * reach, direction, high * reach))
            if free:
                q = max(free, key=lambda q: _ease(model, q, reach))
                joints = zip(model.arm, q.tolist(), model.turns.tolist(), strict=True)
                return Home({name: Position(value, turns) for name, value, turns in joints}, direction)
    return None


def _free_branches(cell: Cell, X_WT: Array) -> list[Array]:
    """The positions (n,) near X_WT, in whole degrees or millimetres, within the limits and without contact."""
    model = cell.model
    solutions = all_solutions(model, X_WT).solutions
    solutions = np.where(model.turns, np.radians(np.round(np.degrees(solutions))), np.round(solutions, 3))
    inside = solutions[((solutions >= model.lower) & (solutions <= model.upper)).all(axis=1)]
    contacts = cell.collision.placed(cell.initial_world).check_all(inside) if len(inside) else ()
    return [q for q, contact in zip(inside, contacts, strict=True) if contact is None]


def tool_down(model: RobotModel, far: float, direction: float, high: float) -> Array:
    """The pose of a tool frame that points down, at a distance and direction from the first joint; (4, 4)."""
    place = _root(model) + far * _heading(direction)
    return pose(axis_rotation(0, pi), [*place, high])


def places_to_try(model: RobotModel, reach: float, direction: float, size: float) -> Iterator[Cube]:
    """Cubes on the table with some distance between them, the most likely reachable ones first."""
    chosen: list[Array] = []
    for share in CUBE_SHARES:
        for turn in CUBE_TURNS:
            place = tool_down(model, share * reach, direction + turn, 0.5 * size)[:3, 3].round(2)
            if all(np.linalg.norm(place[:2] - other[:2]) > max(3 * size, 0.1) for other in chosen):
                chosen.append(place)
                yield Cube(f"c{len(chosen)}", "green", (float(place[0]), float(place[1]), 0.5 * size))


def cubes_in_reach(cell: Cell) -> list[Cube]:
    """Those of the cubes of a workspace that the arm can pick up, as many as `COLORS`, named by their colours."""
    world: World = cell.initial_world
    found: list[Cube] = []
    for candidate in read_task(TASK, cell.workspace).candidates:
        if not isinstance(feasible_motion(cell, candidate, world), Infeasible):
            (name,) = candidate.binding.values()
            x, y, z = world.X_WO[name][:3, 3].tolist()
            color = COLORS[len(found)]
            number = COLORS[: len(found)].count(color) + 1
            found.append(Cube(f"{color[0]}{number}", color, (x, y, z)))
        if len(found) == len(COLORS):
            break
    return found


def views_of(cubes: Sequence[Cube], direction: float, lift: float) -> tuple[CameraView, ...]:
    """A camera that sees all cubes while the arm is not in its way, and one that sees some of them from the side.

    lift: how far the cubes are lifted [m].
    """
    places = np.array([cube.position for cube in cubes])
    middle = np.append((places.min(axis=0) + places.max(axis=0))[:2] / 2, lift / 2)
    radius = float(np.linalg.norm(places - middle, axis=1).max()) + lift / 2
    distance = max(radius / np.sin(HALF_VIEW), 0.5)
    some_cube = np.append(places[len(places) // 3][:2], lift / 2)
    return (
        _view("cam1", middle, distance, direction + BEHIND),
        _view("cam2", some_cube, max(CLOSE_UP * distance, 0.25), direction + ASIDE),
    )


def _view(name: str, looks_at: Array, distance: float, turn: float) -> CameraView:
    """A camera at a distance from a point, in a direction [rad]."""
    ray = np.array([*(np.cos(VIEW_HEIGHT) * _heading(turn)), np.sin(VIEW_HEIGHT)])
    x, y, z = (looks_at + distance * ray).round(2).tolist()
    at_x, at_y, at_z = looks_at.round(2).tolist()
    return CameraView(name, (x, y, z), (at_x, at_y, at_z))


def _heading(turn: float) -> Array:
    """The unit vector along the ground in a direction [rad], shape (2,)."""
    return np.array([np.cos(turn), np.sin(turn)])


def _root(model: RobotModel) -> Array:
    """Where the arm's first joint is on the ground, shape (2,) [m]."""
    return model.joint_origins(model.home)[0, :2]


def _ease(model: RobotModel, q: Array, reach: float) -> float:
    """How well a position suits as home: joints high above the table, few of them turned far."""
    return float(model.joint_origins(q)[:, 2].mean() / reach - 0.05 * np.abs(q).sum())
