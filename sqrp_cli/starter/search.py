"""Where an arm can work: a home position, cubes within its reach, and cameras that see them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product
from math import pi

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, cross, inverse, pose, transform
from sqrp_cli.programming.arm.inverse_kinematics import all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.arm.pose_search import descend, spread_starts
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.solids import load_solids
from sqrp_cli.programming.task import Candidate, read_task
from sqrp_cli.programming.ways.grips import grips
from sqrp_cli.starter.arm_guess import LEAST_SWING, ArmGuess
from sqrp_cli.starter.layout import TASK, CameraView, Cube, Position
from sqrp_cli.starter.stands import DownPlaces, Stand, shoulder_of

TOOL_GAP = 0.002
"""Gap between what the arm carries and the suction cup [m]."""

NEAR_AXIS = 0.95
"""Cosine of the angle within which a tool points along an axis of the link that carries it."""

HOME_SHARES = ((0.55, 0.35), (0.45, 0.3), (0.65, 0.3), (0.5, 0.5), (0.35, 0.35), (0.7, 0.2))
"""Tool positions at home: distance from the base and height above the table, as shares of the reach."""

MORE_HOMES, ASKEW = 24, 0.8
"""Other places of the tool that are tried at last, and how far off the direction of the work they may be [rad]."""

LOW = 0.25
"""Height below which places of the tool count as ones above the table, as a share of the reach."""

MORE_CUBES = 12
"""Cubes that are tried where few usual places are within reach."""

FREE_TURN = 5
"""An arm with this many axes can turn a tool that points down about its axis; others may not."""

TURN_STARTS, TURN_STEPS = 64, 30
"""Starting points and steps of the search for how an arm turns the tool at a place."""

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

SHIFTS = (0.0, 30 * pi / 180, -30 * pi / 180, 60 * pi / 180, -60 * pi / 180)
"""By how much a camera goes aside where the robot is in its place [rad]."""

CLEARANCE = 0.1
"""Between a camera and a link of the robot at home, at least [m]."""

CLOSE_UP = 0.35
"""Distance of the second camera as a share of the first's: it sees some of the cubes, and what is lifted there."""


@dataclass(frozen=True)
class Home:
    """A home position: of every joint of the arm, and the direction of the work from the base [rad]."""

    positions: Mapping[str, Position]
    direction: float


@dataclass
class NoHome:
    """Why no home position was found."""

    tried: int = 0
    """Places of the tool."""
    first: str = ""
    """What fails at the first of them, and where that is."""

    def add(self, X_WT: Array, root: Array, reason: str) -> None:
        """Another place X_WT of the tool, (4, 4), failed; root: where the arm begins on the ground, (2,)."""
        self.tried += 1
        far, high = float(np.linalg.norm(X_WT[:2, 3] - root)), float(X_WT[2, 3])
        self.first = self.first or f"pointing down {far:.2f} m from the base and {high:.2f} m above the table: {reason}"

    def __str__(self) -> str:
        return f"none of {self.tried} home positions is possible; the first, {self.first}"


def tool_seat(cell: Cell, arm: ArmGuess) -> Array:
    """Pose X_LT of a tool in the link at the arm's end, z out of it, beyond everything that it carries; (4, 4)."""
    X_WL = cell.model.home_links
    X_TW = np.linalg.inv(X_WL[arm.tip])
    solids = load_solids([part for part in cell.model.parts if part.parent in arm.carried])
    points = [transform(X_TW @ X_WL[solid.part.parent], solid.vertices) for solid in solids]
    out = arm.out if arm.swinging is None or not points else _swung(np.concatenate(points), arm.swinging, arm.out)
    furthest = max((float((ends @ out).max()) for ends in points), default=0.0)
    x = np.eye(3)[(int(np.abs(out).argmax()) + 1) % 3]
    x = x - out * (x @ out)
    x = x / np.linalg.norm(x)
    offset = furthest + TOOL_GAP if furthest > TOOL_GAP else 0.0
    return pose(np.column_stack([x, cross(out, x), out]), offset * out)


def _swung(points: Array, axis: Array, out: Array) -> Array:
    """The direction in which points (n, 3) reach from the axis that swings them, (3,); `out` if they lie around it.

    Along an axis of their frame if one is near.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    across = center - axis * (center @ axis)
    far = float(np.linalg.norm(across))
    if far < max(LEAST_SWING, 2.0 * abs(float(center @ axis))):
        return out
    nearest = int(np.abs(across).argmax())
    if abs(across[nearest]) > NEAR_AXIS * far:
        across = np.sign(across[nearest]) * np.eye(3)[nearest]
    direction: Array = across / np.linalg.norm(across)
    return direction


def arm_reach(model: RobotModel) -> float:
    """Approximate horizontal reach of the tool from the arm's first joint [m]."""
    q = spread_starts(model, 512)
    places = model.tool_poses_and_jacobians(q)[0][:, :2, 3]
    return float(np.quantile(np.linalg.norm(places - _root(model), axis=1), 0.98))


def find_home(cell: Cell, reach: float, stand: Stand, down: DownPlaces) -> Home | NoHome:
    """A position with the tool pointing down and without contact.

    Of the IK branches at the first place that has any, the one that keeps the joints high and turns them little.
    """
    failures = NoHome()
    for X_WT, direction in _homes(cell.model, reach, stand, down.at(stand.lift)):
        free = _free_branches(cell, X_WT, failures)
        if free:
            q = max(free, key=lambda q: _ease(cell.model, q, reach))
            joints = zip(cell.model.arm, q.tolist(), cell.model.turns.tolist(), strict=True)
            return Home({name: Position(value, turns) for name, value, turns in joints}, direction)
    return failures


def _homes(model: RobotModel, reach: float, stand: Stand, places: Array) -> Iterator[tuple[Array, float]]:
    """Poses of the tool frame to try as home, (4, 4), and the direction of the work from there [rad].

    First those at usual places, then some of all `places` that the arm can take, (k, 4, 4); without any, one will do.
    """
    for far, high in HOME_SHARES:
        for direction in stand.directions:
            for X_WT in turns_to_try(model, tool_down(model, far * reach, direction, high * reach)):
                yield X_WT, direction
            if not len(places):
                return
    off = places[:, :3, 3] - np.append(_root(model), 0.0)
    far, high = np.linalg.norm(off[:, :2], axis=1) / reach, off[:, 2] / reach
    directions = np.arctan2(off[:, 1], off[:, 0])
    ahead = np.abs(np.angle(np.exp(1j * (directions - stand.directions[0])))) < ASKEW
    usable = (high > 0.15) & (high < 0.7) & (far > 0.2) & (ahead | (len(stand.directions) > 1))
    cost = np.hypot(far - HOME_SHARES[0][0], high - HOME_SHARES[0][1]) + 0.2 * ~ahead
    for row in sorted(np.flatnonzero(usable), key=lambda row: float(cost[row]))[:MORE_HOMES]:
        yield places[row], float(directions[row])


def turns_to_try(model: RobotModel, X_WT: Array) -> Iterator[Array]:
    """A pose of the tool frame, (4, 4), and for an arm of few axes the one turned as the arm has it there."""
    yield X_WT
    if len(model.arm) < FREE_TURN:
        yield as_arm_turns(model, X_WT)


def as_arm_turns(model: RobotModel, X_WT: Array) -> Array:
    """A pose that points down, (4, 4), turned about the vertical so that the arm comes closest to it."""
    q = np.concatenate([model.home[None], spread_starts(model, TURN_STARTS)])
    for weight in (0.02, 1.0, 1.0):
        q, _ = descend(model, X_WT, q, TURN_STEPS, turn_weight=weight).best(8)
        turned = model.tool_poses(q[:1])[0, :3, :3] @ X_WT[:3, :3].T
        turn = float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
        X_WT = pose(axis_rotation(2, turn) @ X_WT[:3, :3], X_WT[:3, 3])
    return X_WT


def _free_branches(cell: Cell, X_WT: Array, failures: NoHome) -> list[Array]:
    """The positions (n,) near X_WT, in whole degrees or millimetres, within the limits and without contact."""
    model = cell.model
    solutions, reason = (found := all_solutions(model, X_WT)).solutions, found.reason
    solutions = np.where(model.turns, np.radians(np.round(np.degrees(solutions))), np.round(solutions, 3))
    inside = solutions[((solutions >= model.lower) & (solutions <= model.upper)).all(axis=1)]
    contacts = cell.collision.placed(cell.initial_world).check_all(inside) if len(inside) else ()
    failures.add(X_WT, _root(model), str(reason) if reason is not None else str(next(iter(contacts), "at a limit")))
    return [q for q, contact in zip(inside, contacts, strict=True) if contact is None]


def tool_down(model: RobotModel, far: float, direction: float, high: float) -> Array:
    """The pose of a tool frame that points down, at a distance and direction from the first joint; (4, 4)."""
    place = _root(model) + far * _heading(direction)
    return pose(axis_rotation(0, pi), [*place, high])


def places_to_try(model: RobotModel, reach: float, direction: float, size: float, stand: Stand) -> Iterator[Cube]:
    """Cubes on the table with some distance between them, the most likely reachable ones first."""
    ways = product(CUBE_SHARES, CUBE_TURNS)
    tools = (tool_down(model, share * reach, direction + turn, 0.5 * size) for share, turn in ways)
    return _cubes_below(model, tools, size, stand)


def other_places(model: RobotModel, reach: float, size: float, stand: Stand, down: DownPlaces) -> Iterator[Cube]:
    """Cubes on the table below places where the arm can point the tool down, for arms that reach few usual places."""
    found = down.at(stand.lift)
    low = found[(found[:, 2, 3] > size) & (found[:, 2, 3] < LOW * reach)][:, :3, 3]
    far = np.linalg.norm(low[:, :2] - _root(model), axis=1)
    nearest = low[np.argsort(np.abs(far - CUBE_SHARES[0] * reach), kind="stable"), :2].round(2)
    tools = (pose(axis_rotation(0, pi), (*place, 0.5 * size)) for place in nearest)
    return islice(_cubes_below(model, tools, size, stand), MORE_CUBES)


def _cubes_below(model: RobotModel, tools: Iterable[Array], size: float, stand: Stand) -> Iterator[Cube]:
    """Cubes below poses of the tool, (4, 4) each, as far as they are on the table and apart from those before."""
    chosen: list[Array] = []
    for X_WT in tools:
        place = X_WT[:2, 3].round(2)
        apart = all(np.linalg.norm(place - other) > max(3 * size, 0.1) for other in chosen)
        if apart and np.abs(place - stand.at).max() < 0.5 * stand.side - size:
            chosen.append(place)
            x, y = place.tolist()
            yield Cube(f"c{len(chosen)}", "green", (x, y, 0.5 * size), _turn_of(model, X_WT, size))


def _turn_of(model: RobotModel, X_WT: Array, size: float) -> float:
    """How a cube is turned so that the arm can take it from above [rad]: not, if it can turn the tool.

    X_WT: pose of the tool that points down at it, (4, 4), in its middle.
    """
    if len(model.arm) >= FREE_TURN:
        return 0.0
    above = pose(position=(0.0, 0.0, 0.5 * size)) @ X_WT
    if all_solutions(model, above).reason is None:
        return 0.0
    R = as_arm_turns(model, above)[:3, :3] @ X_WT[:3, :3].T
    return float(np.arctan2(R[1, 0], R[0, 0]))


@dataclass(frozen=True)
class Reachable:
    """The cubes of a workspace that the arm can pick up, named by their colours, and why it cannot pick up another."""

    cubes: Sequence[Cube]
    """As many as `COLORS` at most."""
    reason: str
    """Of the first one that cannot; empty if there is none."""


def cubes_in_reach(cell: Cell, trial: Sequence[Cube]) -> Reachable:
    """Try to pick up the cubes of a workspace, which were placed as `trial` says, until there are enough.

    First with the tool turned as the cubes are; those that cannot be picked up like that, with it turned otherwise.
    """
    cubes = {cube.name: cube for cube in trial}
    candidates = [(cubes[one.binding["object"]], one) for one in read_task(TASK, cell.workspace).candidates]
    found: list[Cube] = []
    reason = ""
    for first in (True, False):
        for cube, candidate in candidates:
            if cube in found or len(found) == len(COLORS):
                continue
            motion = _first_motion(cell, candidate, first=first)
            if not isinstance(motion, Infeasible):
                found.append(cube)
            elif first and not reason:
                x, y = (value + 0.0 for value in cube.position[:2])  # no -0.00
                reason = f"a cube at x {x:.2f} m, y {y:.2f} m: {motion.reasons[0]}"
    return Reachable([*_coloured(found)], reason)


def _first_motion(cell: Cell, candidate: Candidate, *, first: bool) -> Motion | Infeasible:
    """That of the candidate's first grip, or of the first of the others that is possible."""
    motion: Motion | Infeasible = Infeasible(("there is one way to grip it",))
    for grip in grips(cell, candidate, cell.initial_world)[slice(0, 1) if first else slice(1, None)]:
        motion = feasible_motion(cell, grip, cell.initial_world)
        if not isinstance(motion, Infeasible):
            break
    return motion


def _coloured(cubes: Sequence[Cube]) -> Iterator[Cube]:
    """Cubes with the colours that they get, and named by these."""
    for index, (cube, color) in enumerate(zip(cubes, COLORS, strict=False)):
        number = COLORS[: index + 1].count(color)
        yield replace(cube, name=f"{color[0]}{number}", color=color)


def views_of(cell: Cell, home: Home, cubes: Sequence[Cube], lift: float) -> tuple[CameraView, ...]:
    """A camera that sees all cubes while the arm is not in its way, and one that sees some of them from the side.

    Neither is in the robot or close to it, if there is such a place. lift: how far the cubes are lifted [m].
    """
    places = np.array([cube.position for cube in cubes])
    middle = np.append((places.min(axis=0) + places.max(axis=0))[:2] / 2, lift / 2)
    radius = float(np.linalg.norm(places - middle, axis=1).max()) + lift / 2
    distance = max(radius / np.sin(HALF_VIEW), 0.5)
    some_cube = np.append(places[len(places) // 3][:2], lift / 2)
    return (
        _clear_view(cell, home, "cam1", middle, distance, BEHIND),
        _clear_view(cell, home, "cam2", some_cube, max(CLOSE_UP * distance, 0.25), ASIDE),
    )


def _clear_view(cell: Cell, home: Home, name: str, looks_at: Array, distance: float, turn: float) -> CameraView:
    """A camera in a direction relative to that of the work [rad], or the next one in which no robot is."""
    q = np.array([home.positions[joint].value for joint in cell.model.arm])
    X_WL = cell.model.link_poses(q[None])
    views = [_view(name, looks_at, distance, home.direction + sign * turn + by) for by in SHIFTS for sign in (1, -1)]
    for view in views:
        eye = np.array([view.position])
        if not any(
            (np.abs(transform(inverse(X_WL[solid.part.parent][0]), eye) - middle) < half + CLEARANCE).all()
            for solid in load_solids(cell.model.parts)
            for middle, half in [_extent(solid.vertices)]
        ):
            return view
    return views[0]


def _extent(points: Array) -> tuple[Array, Array]:
    """The middle of the box around points (n, 3), and half its sides."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, (high - low) / 2


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
    """Where the arm begins on the ground, shape (2,) [m]."""
    return shoulder_of(model)[:2]


def _ease(model: RobotModel, q: Array, reach: float) -> float:
    """How well a position suits as home: joints high above the table, few of them turned far."""
    return float(model.joint_origins(q)[:, 2].mean() / reach - 0.05 * np.abs(q).sum())
