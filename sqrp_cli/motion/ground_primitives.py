"""A skill's primitive actions, grounded as far as possible before the arm's motion is planned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from itertools import pairwise

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.motion.collision import CollisionScene, NamePairs, pair
from sqrp_cli.motion.fingers import closed_on, move_fingers, opened_to
from sqrp_cli.motion.tool_path import SHORTEST_LINE, ToolCurve, arc_through, helix_about, tool_line
from sqrp_cli.motion.waypoints import UnknownPlaceError, WaypointGrounder, setting_value
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import positions_of
from sqrp_cli.sight.solids import distance
from sqrp_cli.skill.settings import ANY, FASTEST, Reference
from sqrp_cli.skill.skill import (
    HOME,
    ArcMove,
    FingerMove,
    Grasp,
    GraspWaypoint,
    HelixMove,
    JointMove,
    PrimitiveAction,
    Release,
    SkillChoice,
    StraightMove,
    ToolMove,
    Wait,
)
from sqrp_cli.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class GroundPrimitive:
    """A primitive action whose waypoint, settings and surroundings are known."""

    name: str
    kind: type[PrimitiveAction]
    to: str | None
    X_start: Array
    X_end: Array  # Pose X_WT of the tool frame when it begins and ends, shape (4, 4)
    world: World  # poses of objects, and the held one, during it
    home: bool = False
    """A joint move to the home configuration.

    Otherwise any joint positions of the wanted branches that bring the tool to `X_end`.
    """
    via_home: bool = False  # a joint move that stops at home on the way
    vias: Array | None = None
    """Joint positions that a joint move bends around on its way, shape (k, n) [rad or m]; not one by home."""
    branches: Mapping[str, str] = field(default_factory=dict)
    """Of a joint move: the wanted words of `robot.branches`, by `elbow`, `shoulder`, `wrist`."""
    free: Mapping[str, str] = field(default_factory=dict)
    """Of a joint move: the motion parameters that leave its branch free, by `elbow`, `shoulder`, `wrist`."""
    speed: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0  # Of the primitive: a share for joint moves, in m and s for straight ones, otherwise 0
    turn_speed: float | None = None  # how fast the tool may turn on a curve [rad/s], None if only its joints limit that
    curves: tuple[ToolCurve, ...] = ()
    """Of a move of the tool: what it moves along, with a stop after each; empty for all else."""
    force: float | None = None  # of a straight move that ends at contact: at the tool, what counts as contact [N]
    beyond: ToolCurve | None = None  # then the line from where contact is expected to where the move ends without
    touching: frozenset[str] = frozenset()
    """Names of the objects that tool and held object may touch from here to the next joint move."""
    hold: float = 0.0  # how long it stands still [s]; 0 for moves
    fingers: Trajectory | None = None  # motion of the fingers during it, None if they stand still
    allowed: NamePairs = frozenset()  # pairs of names that may touch as part of the skill

    @property
    def legs(self) -> tuple[ToolCurve, ...]:
        """All that the tool may move along."""
        return (
            *self.curves,
            *([self.beyond] if self.beyond is not None and self.beyond.length > SHORTEST_LINE else ()),
        )


def ground_primitives(
    choice: SkillChoice, world: World, scene: CollisionScene
) -> tuple[tuple[GroundPrimitive, ...], World] | Infeasible:
    """The primitives of a skill in a world, and the world after the last one, with facts and arm joints as before.

    Tool and objects are followed through the skill; infeasible if the pose of an object is unknown.
    """
    model = scene.model
    X_home, X_WT = model.tool_pose(model.home), model.tool_pose(positions_of(model.arm, world.joints))
    X_TO: dict[str, Array] = {}
    grounded: list[GroundPrimitive] = []
    for primitive in choice.skill.primitives:
        if world.held is not None and world.X_TO is not None:
            X_TO[world.held] = world.X_TO
        waypoints = WaypointGrounder(
            waypoints=choice.skill.waypoints,
            binding=choice.binding,
            values=choice.values,
            objects=scene.objects,
            X_WH=X_home,
            X_WO=world.X_WO,
            X_TO=X_TO,
        )
        begun = GroundPrimitive(primitive.name, type(primitive), to=None, X_start=X_WT, X_end=X_WT, world=world)
        try:
            ground = _ground(primitive, waypoints, begun)
        except UnknownPlaceError as why:
            return Infeasible((str(why),))
        if ground.kind is JointMove and not ground.via_home:
            ground = replace(ground, vias=choice.vias.get(primitive.name))
        if isinstance(primitive, StraightMove) and primitive.until_contact is not None:
            # Its first part ends where contact is expected; the rest is where it goes on without.
            (line,), other = ground.curves, choice.binding[primitive.until_contact]
            expected = other in world.X_WO and other != world.held
            share = _contact_share(scene, world, line, other) if expected else None
            first = line if share is None else tool_line(X_WT, line.poses(np.array([share]))[0])
            beyond, force = tool_line(first.X_end, line.X_end), waypoints.number(primitive.force)
            ground = replace(ground, X_end=first.X_end, curves=(first,), beyond=beyond, force=force)
        after = _after(primitive, waypoints, world, ground.X_end, scene)
        if isinstance(after, Infeasible):
            return after
        start, end = positions_of(model.fingers.joints, world.joints), positions_of(model.fingers.joints, after.joints)
        if not np.array_equal(start, end):  # as long as its standstill, or longer
            fingers = move_fingers(model.fingers, start, end, ground.hold)
            ground = replace(ground, fingers=fingers, hold=fingers.duration)
        grounded.append(ground)
        X_WT, world = ground.X_end, after
    return _with_allowed_contacts(grounded, world, scene), world


def _ground(primitive: PrimitiveAction, waypoints: WaypointGrounder, ground: GroundPrimitive) -> GroundPrimitive:
    """A primitive that begins as `ground` with its waypoints, curves and settings; raises UnknownPlaceError."""
    number, values, at = waypoints.number, waypoints.values, waypoints.pose
    match primitive:
        case JointMove(to=to):
            settings = {"elbow": primitive.elbow, "shoulder": primitive.shoulder, "wrist": primitive.wrist}
            named = {name: setting.parameter for name, setting in settings.items() if isinstance(setting, Reference)}
            words = {name: str(setting_value(setting, values)) for name, setting in settings.items()}
            return replace(
                ground,
                to=to,
                X_end=at(to),
                home=to == HOME,
                via_home=to != HOME and setting_value(primitive.via, values) == HOME,
                branches={name: word for name, word in words.items() if word not in (ANY, FASTEST)},
                free={name: one for name, one in named.items() if to != HOME and values[one] == ANY},
                speed=number(primitive.speed),
            )
        case ToolMove():
            X_start, names = ground.X_start, list[str]()
            match primitive:
                case StraightMove(waypoints=[*names]):
                    poses = [X_start, *map(at, names)]
                    curves = tuple(tool_line(one, other) for one, other in pairwise(poses))
                case ArcMove(to=names):
                    through, end = map(at, names)
                    curves = (arc_through(X_start, through[:3, 3], end),)
                case HelixMove(turn=turn, advance=advance, keep_orientation=keep):
                    names, angle, along = [primitive.axis], number(turn), number(advance)
                    curves = (helix_about(at(primitive.axis), X_start, angle, along, keep_orientation=keep),)
            touched = [*primitive.touching, getattr(primitive, "until_contact", None)]
            return replace(
                ground,
                to=names[-1],
                X_end=curves[-1].X_end,
                curves=curves,
                speed=number(primitive.speed),
                acceleration=number(primitive.acceleration),
                jerk=number(primitive.jerk),
                turn_speed=None if primitive.turn_speed is None else number(primitive.turn_speed),
                touching=frozenset(waypoints.binding[name] for name in touched if name is not None),
            )
        case FingerMove() | Grasp() | Release() | Wait():
            return replace(ground, hold=number(primitive.duration))


def _after(
    primitive: PrimitiveAction, waypoints: WaypointGrounder, world: World, X_WT: Array, scene: CollisionScene
) -> World | Infeasible:
    """The world after a primitive that ends with the tool at X_WT.

    Grasp closes the fingers on the object and attaches it, release opens them and detaches it.
    """
    name, model = primitive.name, scene.model
    fingers: Array | str
    match primitive:
        case Grasp(object=parameter):
            grasped = waypoints.binding[parameter]
            if world.held is not None:
                return Infeasible((f"the tool still holds `{world.held}`, so `{name}` cannot grasp `{grasped}`",))
            if grasped not in world.X_WO:
                return Infeasible((f"it is not known where `{grasped}` is",))
            X_TO = inverse(X_WT) @ world.X_WO[grasped]
            for one in waypoints.waypoints.values():  # what closes pushes it to the jaw that stands still
                if isinstance(one, GraspWaypoint) and one.object == parameter and one.beside is not None:
                    X_TO = pose(position=(0.0, -waypoints.number(one.beside), 0.0)) @ X_TO
            fingers = closed_on(scene, grasped, X_TO, positions_of(model.fingers.joints, world.joints))
            world = replace(world, held=grasped, X_TO=X_TO)
        case Release(width=width):
            if world.held is None or world.X_TO is None:
                return Infeasible((f"the tool holds nothing that `{name}` could release",))
            world = replace(world, X_WO={**world.X_WO, world.held: X_WT @ world.X_TO}, held=None, X_TO=None)
            fingers = opened_to(model.fingers, None if width is None else waypoints.number(width))
        case FingerMove(width=width):
            if world.held is not None:
                return Infeasible((f"the tool holds `{world.held}`, so `{name}` cannot move its fingers",))
            fingers = opened_to(model.fingers, None if width is None else waypoints.number(width))
        case _:
            return world
    if isinstance(fingers, str):
        return Infeasible((f"{name}: {fingers}",))
    return replace(world, joints={**world.joints, **dict(zip(model.fingers.joints, fingers.tolist(), strict=True))})


def _with_allowed_contacts(
    primitives: Sequence[GroundPrimitive], final: World, scene: CollisionScene
) -> tuple[GroundPrimitive, ...]:
    """The primitives with the contacts that grasps and releases allow, up to the nearest joint moves around them.

    The grasped or released object may touch its support, and a tool without fingers. Fingers may touch it only while
    they close on it, hold it (see `CollisionScene.placed`) and open; when open they keep their clearance from it.
    """
    worlds = [*(primitive.world for primitive in primitives), final]
    allowed: list[set[tuple[str, str]]] = [set() for _ in primitives]
    cuts = [-1, *(i for i, primitive in enumerate(primitives) if primitive.kind is JointMove), len(primitives)]
    for i, primitive in enumerate(primitives):
        first = max(cut for cut in cuts if cut < i) + 1
        last = min(cut for cut in cuts if cut > i)
        for k in range(i, last) if primitive.touching else ():
            own = {*scene.model.hand_links, *filter(None, [worlds[k].held])}
            allowed[k] |= {pair(one, other) for one in own for other in primitive.touching if one != other}
        before = primitive.kind is Release  # held before it, and resting after it; of a grasp the other way round
        name, resting = worlds[i if before else i + 1].held, worlds[i + 1 if before else i]
        if name is None or primitive.kind not in (Grasp, Release):
            continue
        contacts = {pair(name, other) for other in scene.supports(name, resting.X_WO[name], resting)}
        at_tool = {pair(name, link) for link in scene.model.hand_links}
        for k in range(first, last):
            allowed[k] |= contacts | (at_tool if k == i or not scene.model.fingers.joints else set())
    return tuple(replace(p, allowed=frozenset(contacts)) for p, contacts in zip(primitives, allowed, strict=True))


TOUCH = 1e-5  # distance that counts as contact [m]
ARM_OF_TURN = 0.5
"""No part of tool and held object is further from the tool frame [m]: bounds their motion while the tool turns."""


def _contact_share(scene: CollisionScene, world: World, line: ToolCurve, other: str) -> float | None:
    """The first s in [0, 1] at which the tool, or what it holds, touches an object on a line; None if it does not.

    Steps are as long as the distance allows (conservative advancement), so that no contact is stepped over.
    """
    model = scene.model
    X_WF = model.link_poses(model.with_fingers(model.home, positions_of(model.fingers.joints, world.joints))[None])
    X_TW = inverse(X_WF[model.tool_frame][0])
    names = [(solid, solid.part.parent) for solid in scene.solids]
    moving = [(solid, X_TW @ X_WF[name][0]) for solid, name in names if name in model.hand_links]
    if world.held is not None and world.X_TO is not None:
        moving += [(solid, world.X_TO) for solid in scene.object_solids[world.held]]
    motion = line.length + ARM_OF_TURN * line.turning
    s = 0.0
    while s <= 1.0:
        X_WT, left = line.poses(np.array([s]))[0], (1.0 - s) * motion + TOUCH
        near = [
            apart
            for solid, X_TP in moving
            for resting in scene.object_solids[other]
            if (apart := distance(solid, X_WT @ X_TP, resting, world.X_WO[other], left, TOUCH)) is not None
        ]
        if not near:
            return None
        if min(near) <= TOUCH:
            return s
        s += max(min(near), TOUCH) / motion
    return None
