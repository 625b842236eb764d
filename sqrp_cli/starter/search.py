"""Where an arm can work: how it stands to a table, a home position, cubes within its reach, cameras that see them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import pi

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, cross, inverse, pose, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.waypoints import WaypointGrounder
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import MET, Unreachable, as_arm_turns, descend, halton, may_reach, spread_starts
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.starter.arm_guess import LEAST_SWING, ArmGuess
from sqrp_cli.starter.layout import TASK, Cube, Layout, Point
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.grips import grips
from sqrp_cli.task.task import read_task

LIFTS = (0.0, 0.15, 0.3, 0.45)
"""Heights of the root above the table to try, as shares of the reach: small arms need a pedestal to point down."""
SHOULDERS = (0.3, 0.15, 0.45, 0.6)
"""Heights of the shoulder above a table before the arm to try, as shares of the reach."""
DIRECTIONS = tuple(turn * pi / 180 for turn in (0, -90, 90, 180))
"""Directions from the base in which the work may lie [rad], the preferred one first."""
LARGEST_TABLE = 100.0  # side of the largest table, for arms on long rails [m]
GAP = 0.05  # between what stands and a table before it [m]
MOST_BEFORE = 3  # tables before the arm that are tried, those first that most of the tool's places are above
MOST_STANDS = len(LIFTS) + MOST_BEFORE  # heights and places of the table that are tried at most
PLACES, STEPS = 1024, 25
"""Positions of the joints from which places are searched where the tool points down, and steps of that search."""
WORK_HEIGHT = 0.3  # how far above a table the tool works, as a share of the reach
TOOL_GAP = 0.002  # gap between what the arm carries and the suction cup [m]
NEAR_AXIS = 0.95  # cosine of the angle within which a tool points along an axis of the link that carries it
HOME_SHARES = ((0.55, 0.35), (0.45, 0.3), (0.65, 0.3), (0.5, 0.5), (0.35, 0.35), (0.7, 0.2))
"""Tool positions at home: distance from the base and height above the table, as shares of the reach."""
MORE_HOMES, ASKEW = 24, 0.8
"""Other places of the tool that are tried at last, and how far off the direction of the work they may be [rad]."""
LOW = 0.25  # height below which places of the tool count as ones above the table, as a share of the reach
MORE_CUBES = 12  # cubes that are tried where few usual places are within reach
FREE_TURN = 5  # an arm with this many axes can turn a tool that points down about its axis; others may not
CUBE_SHARES = (0.5, 0.62, 0.4, 0.72, 0.3)  # distances of cubes from the base, as shares of the reach
CUBE_TURNS = tuple(turn * pi / 180 for turn in (0, -25, 25, -50, 50))
"""Directions of cubes relative to that of the work [rad]."""
TURNED_IN_VAIN = 3  # cubes that are tried with the tool turned where none can be picked up without
COLORS = ("green", "green", "red", "green")
"""Colours of the cubes, in the order in which they are placed: few then stand behind another of their colour."""
VIEW_HEIGHT = 35 * pi / 180  # elevation of the cameras above what they look at [rad]
BEHIND, ASIDE = 150 * pi / 180, -60 * pi / 180
"""Directions of the first camera, over the arm's shoulder, and of the second, relative to that of the work [rad]."""
HALF_VIEW = 20 * pi / 180
"""Half the angle within which the first camera sees all cubes [rad]; its image is wider, for arm and lift."""
SHIFTS = (0.0, 30 * pi / 180, -30 * pi / 180, 60 * pi / 180, -60 * pi / 180)
"""By how much a camera goes aside where the robot is in its place [rad]."""
CLEARANCE = 0.1  # between a camera and a link of the robot at home, at least [m]
CLOSE_UP = 0.35
"""Distance of the second camera as a share of the first's: it sees some of the cubes, and what is lifted there."""


def places_pointing_down(model: RobotModel) -> Array:
    """Poses of the tool frame that points down, spread over where the arm can bring it within its limits, (k, 4, 4)."""
    middle = np.where(model.turns, pi, 1.0)
    lower = np.where(np.isfinite(model.lower), np.maximum(model.lower, -2 * pi), -middle)
    upper = np.where(np.isfinite(model.upper), np.minimum(model.upper, 2 * pi), middle)
    q = lower + (upper - lower) * halton(PLACES, len(model.arm))
    # Each pose there, turned by the least angle that makes its z axis point down, about its own origin.
    X = model.tool_poses(q)
    z = np.array([0.0, 0.0, -1.0])
    x = X[:, :3, 0] - (X[:, :3, 0] @ z)[:, None] * z
    y = np.cross(z, X[:, :3, 1])  # x of a tool whose x axis was upright
    x = np.where(np.linalg.norm(x, axis=1, keepdims=True) > 0.1, x, -y)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    X[:, :3, 0], X[:, :3, 1], X[:, :3, 2] = x, np.cross(z, x), z
    reached, errors = descend(model, X, q, STEPS)
    return model.tool_poses(reached[np.abs(errors).max(axis=1) < MET + model.angle_tolerance])


def stands(layout: Layout, cell: Cell, bare: Cell, reach: float, down: Array) -> Iterator[Layout]:
    """A layout with the arm on the table or a pedestal on it, then beside a table that is wholly before the robot.

    The latter come with the most promising first. cell, bare: with the root at height 0, and the same without a tool.
    reach: of the arm [m]. down: as of `places_pointing_down`.
    """
    lowest = min((float(points[:, 2].min()) for points in still_points(bare)), default=0.0)
    for share in LIFTS:
        lift = round(max(0.0, -round(lowest, 3)) + share * reach, 3)
        yield replace(layout, lift=lift, table_side=min(round(2.4 * reach, 1), LARGEST_TABLE), directions=DIRECTIONS)
    places, shoulder, still = down[:, :3, 3], shoulder_of(cell.model), still_points(cell)
    found = []
    for direction in DIRECTIONS:
        ahead = _heading(direction)
        aside = np.array([-ahead[1], ahead[0]])
        edge = max((float((points[:, :2] @ ahead).max()) for points in still), default=0.0) + GAP
        narrow = np.abs((places[:, :2] - shoulder[:2]) @ aside) < 0.6 * reach
        beyond = (places[:, :2] @ ahead > edge + 0.05 * reach) & narrow
        for share in SHOULDERS:
            top = shoulder[2] - share * reach
            above = beyond & (places[:, 2] > top + 0.02) & (places[:, 2] < top + WORK_HEIGHT * reach)
            length = max(round(float(shoulder[:2] @ ahead + 1.2 * reach - edge), 1), 0.3)
            x, y = ((edge + length / 2) * ahead + (shoulder[:2] @ aside) * aside).tolist()
            at, lift = (round(x, 3), round(y, 3)), round(float(-top), 3)
            stand = replace(layout, lift=lift, table_side=length, table_at=at, directions=(direction,))
            found.append((int(above.sum()), stand))
    found.sort(key=lambda one: -one[0])  # stable: the preferred direction first
    yield from (stand for count, stand in found[:MOST_BEFORE] if count)


def shoulder_of(model: RobotModel) -> Array:
    """Where the last six joints of an arm begin at home, such as after a torso or a rail [m], shape (3,)."""
    shoulder: Array = model.joint_origins(model.home)[max(0, len(model.arm) - 6)]
    return shoulder


def still_points(cell: Cell) -> Sequence[Array]:
    """Corners of the solids that the arm does not move, in the world [m], shape (V, 3) each."""
    scene = cell.collision
    parts = [part for part in cell.model.parts if scene.depth[part.parent] == 0 and part.parent not in scene.rods]
    return [transform(cell.model.home_links[solid.part.parent], solid.vertices) for solid in load_solids(parts)]


def tool_seat(cell: Cell, arm: ArmGuess) -> Array:
    """Pose X_LT of a tool in the link at the arm's end, z out of it, beyond everything that it carries; (4, 4).

    An arm whose last joint may swing the tool points where what it carries reaches from that axis, and along an axis
    of the link if one is near; if the carried parts lie around the axis, as the arm was guessed.
    """
    X_WL, out = cell.model.home_links, arm.out
    X_TW = np.linalg.inv(X_WL[arm.tip])
    solids = load_solids([part for part in cell.model.parts if part.parent in arm.carried])
    points = [transform(X_TW @ X_WL[solid.part.parent], solid.vertices) for solid in solids]
    if arm.swinging is not None and points:
        center, _ = _extent(np.concatenate(points))
        along = float(center @ arm.swinging)
        across = center - arm.swinging * along
        far, nearest = float(np.linalg.norm(across)), int(np.abs(across).argmax())
        if far >= max(LEAST_SWING, 2.0 * abs(along)):
            near = abs(across[nearest]) > NEAR_AXIS * far
            out = np.sign(across[nearest]) * np.eye(3)[nearest] if near else across / far
    furthest = max((float((ends @ out).max()) for ends in points), default=0.0)
    x = np.eye(3)[(int(np.abs(out).argmax()) + 1) % 3]
    x = x - out * (x @ out)
    x = x / np.linalg.norm(x)
    offset = furthest + TOOL_GAP if furthest > TOOL_GAP else 0.0
    return pose(np.column_stack([x, cross(out, x), out]), offset * out)


def arm_reach(model: RobotModel) -> float:
    """Approximate horizontal reach of the tool from the arm's first joint [m]."""
    places = model.tool_poses_and_jacobians(spread_starts(model, 512))[0][:, :2, 3]
    return float(np.quantile(np.linalg.norm(places - shoulder_of(model)[:2], axis=1), 0.98))


def find_home(cell: Cell, reach: float, layout: Layout, down: Array) -> Layout | Infeasible:
    """The layout with a home position, the tool pointing down and without contact, in whole degrees or millimetres.

    Of the IK branches at the first place that has any, the one that keeps the joints high and turns them little.
    """
    model, tried, first = cell.model, 0, ""
    unit, fine = np.where(model.turns, pi / 180, 1e-3), np.where(model.turns, pi / 18000, 1e-4)
    for X_WT, direction in _homes(model, reach, layout.directions, pose(position=(0.0, 0.0, layout.lift)) @ down):
        if first and not may_reach(model, X_WT[None]):
            tried += 1
            continue
        found = all_solutions(model, X_WT)
        q = np.empty((0, len(model.arm))) if isinstance(found, Unreachable) else found
        q = np.round(q / unit) * unit  # as the file has them, where a limit is closer a hundredth or a tenth of that
        q = np.clip(q, np.ceil(model.lower / fine) * fine, np.floor(model.upper / fine) * fine)
        q = q[((q >= model.lower) & (q <= model.upper)).all(axis=1)]
        contacts = cell.collision.placed(cell.initial_world).check_all(q) if len(q) else ()
        free = [one for one, contact in zip(q, contacts, strict=True) if contact is None]
        if free:
            # Joints high above the table, few of them turned far.
            ease = [float(model.joint_origins(one)[:, 2].mean() / reach - 0.05 * np.abs(one).sum()) for one in free]
            best = free[int(np.argmax(ease))]
            return replace(layout, home=dict(zip(model.arm, best.tolist(), strict=True)), directions=(direction,))
        tried += 1
        reason = found if isinstance(found, Unreachable) else next(iter(contacts), "at a limit")
        far = float(np.linalg.norm(X_WT[:2, 3] - shoulder_of(model)[:2]))
        first = first or f"pointing down {far:.2f} m from the base and {X_WT[2, 3]:.2f} m above the table: {reason}"
    return Infeasible((f"none of {tried} home positions is possible; the first, {first}",))


def _homes(model: RobotModel, reach: float, preferred: Sequence[float], places: Array) -> Iterator[tuple[Array, float]]:
    """Poses of the tool frame to try as home, (4, 4), and the direction of the work from there [rad].

    First those at usual places, for an arm of few axes also turned as the arm has the tool there, then some of all
    `places` that the arm can take, (k, 4, 4); without any, one will do.
    """
    for far, high in HOME_SHARES:
        for direction in preferred:
            X_WT = tool_down(model, far * reach, direction, high * reach)
            yield X_WT, direction
            if len(model.arm) < FREE_TURN:
                yield as_arm_turns(model, X_WT), direction
            if not len(places):
                return
    off = places[:, :3, 3] - np.append(shoulder_of(model)[:2], 0.0)
    far, high = np.linalg.norm(off[:, :2], axis=1) / reach, off[:, 2] / reach
    directions = np.arctan2(off[:, 1], off[:, 0])
    ahead = np.abs(np.angle(np.exp(1j * (directions - preferred[0])))) < ASKEW
    usable = (high > 0.15) & (high < 0.7) & (far > 0.2) & (ahead | (len(preferred) > 1))
    cost = np.hypot(far - HOME_SHARES[0][0], high - HOME_SHARES[0][1]) + 0.2 * ~ahead
    for row in sorted(np.flatnonzero(usable), key=lambda row: float(cost[row]))[:MORE_HOMES]:
        yield places[row], float(directions[row])


def tool_down(model: RobotModel, far: float, direction: float, high: float) -> Array:
    """The pose of a tool frame that points down, at a distance and direction from the first joint; (4, 4)."""
    return pose(axis_rotation(0, pi), [*(shoulder_of(model)[:2] + far * _heading(direction)), high])


def cube_places(model: RobotModel, reach: float, layout: Layout, down: Array | None) -> Iterator[Cube]:
    """Cubes on the table with some distance between them, the most likely reachable ones first.

    down: places where the arm can point the tool down, (k, 4, 4), below which the cubes are, for arms that reach few
    usual places; None for the usual places. For an arm that cannot turn the tool they are turned so that it can take
    them from above.
    """
    ahead, size = layout.directions[0], layout.cube_size
    if down is None:
        usual = [(share * reach, ahead + turn) for share in CUBE_SHARES for turn in CUBE_TURNS]
        tools = [tool_down(model, far, direction, 0.5 * size) for far, direction in usual]
    else:
        found = down[:, :3, 3] + [0.0, 0.0, layout.lift]
        low = found[(found[:, 2] > size) & (found[:, 2] < LOW * reach)]
        far = np.linalg.norm(low[:, :2] - shoulder_of(model)[:2], axis=1)
        nearest = low[np.argsort(np.abs(far - CUBE_SHARES[0] * reach), kind="stable"), :2].round(2)
        tools = [pose(axis_rotation(0, pi), (*place, 0.5 * size)) for place in nearest]
    chosen: list[Array] = []
    for X_WT in tools:
        place = X_WT[:2, 3].round(2)
        apart = all(np.linalg.norm(place - other) > max(3 * size, 0.1) for other in chosen)
        if apart and np.abs(place - layout.table_at).max() < 0.5 * layout.table_side - size:
            chosen.append(place)
            x, y = place.tolist()
            turn, above = 0.0, pose(position=(0.0, 0.0, 0.5 * size)) @ X_WT
            if len(model.arm) < FREE_TURN and not may_reach(model, above[None]):
                R = as_arm_turns(model, above)[:3, :3] @ X_WT[:3, :3].T
                turn = float(np.arctan2(R[1, 0], R[0, 0]))
            yield Cube(f"c{len(chosen)}", "green", (x, y, 0.5 * size), turn)
        if down is not None and len(chosen) == MORE_CUBES:
            return


def cubes_in_reach(cell: Cell, trial: Sequence[Cube]) -> tuple[Sequence[Cube], str]:
    """The cubes of a workspace, placed as `trial` says, that the arm can pick up, until there are `COLORS` of them.

    They are named by the colours that they get. Also why the first one that cannot be picked up cannot; empty without.
    First with the tool turned as the cubes are; those that cannot be picked up like that, with it turned otherwise.
    """
    cubes = {cube.name: cube for cube in trial}
    candidates = [(cubes[one.binding["object"]], one) for one in read_task(TASK, cell.workspace).candidates]
    world, at_home = cell.initial_world, cell.model.tool_pose(cell.model.home)
    found: list[Cube] = []
    first = ""
    for turns in (slice(0, 1), slice(1, None)):
        for cube, candidate in candidates[: None if turns.start == 0 or found else TURNED_IN_VAIN]:
            if cube in found or len(found) == len(COLORS):
                continue
            why = "there is one way to grip it"
            for grip in grips(cell, candidate, world)[turns]:
                if first:  # one failed: of the others, only those are planned whose waypoints may all be reached
                    settings = grip.skill.waypoints, grip.binding, grip.values
                    grounder = WaypointGrounder(*settings, cell.workspace.objects, at_home, world.X_WO, {})
                    X_WT = np.array([grounder.pose(name) for name in grip.skill.waypoints])
                    if not may_reach(cell.model, X_WT):
                        continue
                motion = feasible_motion(cell, grip, world)
                if not isinstance(motion, Infeasible):
                    found.append(cube)
                    break
                why = motion.reasons[0]
            else:
                x, y = (value + 0.0 for value in cube.position[:2])  # no -0.00
                first = first or f"a cube at x {x:.2f} m, y {y:.2f} m: {why}"
    numbers = [COLORS[: index + 1].count(color) for index, color in enumerate(COLORS)]
    named = zip(found, COLORS, numbers, strict=False)
    return [replace(cube, name=f"{color[0]}{number}", color=color) for cube, color, number in named], first


def views_of(cell: Cell, layout: Layout, cubes: Sequence[Cube], lift: float) -> dict[str, tuple[Point, Point]]:
    """A camera that sees all cubes while the arm is not in its way, and one that sees some of them from the side.

    Where they are and look, as `Layout.views`. Neither is in the robot or close to it, if there is such a place. lift:
    how far the cubes are lifted [m].
    """
    q = np.array([layout.home[joint] for joint in cell.model.arm])
    X_WL = cell.model.link_poses(q[None])
    solids = [(inverse(X_WL[one.part.parent][0]), *_extent(one.vertices)) for one in load_solids(cell.model.parts)]
    places = np.array([cube.position for cube in cubes])
    middle = np.append(_extent(places)[0][:2], lift / 2)
    radius = float(np.linalg.norm(places - middle, axis=1).max()) + lift / 2
    distance = max(radius / np.sin(HALF_VIEW), 0.5)
    some_cube = np.append(places[len(places) // 3][:2], lift / 2)
    views = dict[str, tuple[Point, Point]]()
    for name, looks_at, far, turn in (
        ("cam1", middle, distance, BEHIND), ("cam2", some_cube, max(CLOSE_UP * distance, 0.25), ASIDE)
    ):  # fmt: skip
        at_x, at_y, at_z = looks_at.round(2).tolist()
        # In a direction relative to that of the work, or the next one in which no robot is.
        for heading in (_heading(layout.directions[0] + sign * turn + by) for by in SHIFTS for sign in (1, -1)):
            way = np.append(np.cos(VIEW_HEIGHT) * heading, np.sin(VIEW_HEIGHT))
            x, y, z = (looks_at + far * way).round(2).tolist()
            views.setdefault(name, ((x, y, z), (at_x, at_y, at_z)))
            eye = np.array([[x, y, z]])
            if all((np.abs(transform(X, eye) - mid) >= half + CLEARANCE).any() for X, mid, half in solids):
                views[name] = (x, y, z), (at_x, at_y, at_z)
                break
    return views


def _extent(points: Array) -> tuple[Array, Array]:
    """The middle of the box around points (n, 3), and half its sides."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, (high - low) / 2


def _heading(turn: float) -> Array:
    """The unit vector along the ground in a direction [rad], shape (2,)."""
    return np.array([np.cos(turn), np.sin(turn)])
