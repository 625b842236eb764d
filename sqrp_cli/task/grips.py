"""The choices of what a candidate leaves free, but for branches, and how a way is said in words.

They are sides, yaws and stops; of what looks the same one counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import gcd, lcm

import numpy as np

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.files.entries import Entry
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.waypoints import setting_value
from sqrp_cli.robot.kinematics import RobotModel, positions_of
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Sphere
from sqrp_cli.skill.settings import (
    ANY,
    DIRECT,
    FIRST_NUMBER,
    FIRST_SIDE,
    NOTHING_SPECIAL,
    MotionValue,
    Reference,
    side_of,
)
from sqrp_cli.skill.skill import HOME, GraspWaypoint, JointMove, PutWaypoint, Skill
from sqrp_cli.task.candidate import whole_candidate
from sqrp_cli.task.task import Candidate, in_words


def first_grip(candidate: Candidate) -> Candidate:
    """The candidate with the first choice of all that it leaves free, other than branches and paths."""
    if candidate.steps:
        return whole_candidate(candidate.skill, [first_grip(step) for step in candidate.steps])
    first = {
        parameter: choice
        for setting, choice in (("side", FIRST_SIDE), ("yaw", FIRST_NUMBER), ("via", DIRECT))
        for parameter in _free(candidate, setting)
    }
    return replace(candidate, values={**candidate.values, **first}) if first else candidate


def grips(cell: Cell, candidate: Candidate, world: World) -> tuple[Candidate, ...]:
    """The candidate with each combination of the sides, yaws and stops that it leaves free, the first choices first.

    A side or a yaw is a choice if the object looks there to the tool as it does at the first one: by the symmetry of
    the part, and for a round tool at every yaw. A stop at home is none for a robot that is there.
    """
    found, begin, home = [candidate], positions_of(cell.model.arm, world.joints), cell.model.home
    at_home = [candidate.skill.primitives[0]] if np.allclose(begin, home, rtol=0.0, atol=1e-9) else []
    for setting in ("side", "yaw", "via"):
        longer: list[Candidate] = []
        for one in found:
            choices = dict[str, Sequence[MotionValue]]()
            for name, parts in _free(one, setting).items():  # of all waypoints or joint moves that it is for
                placed = [part for part in parts if isinstance(part, GraspWaypoint | PutWaypoint)]
                objects = [cell.workspace.objects[one.binding[part.object]] for part in placed]
                turns = [1] * (len(parts) - len(placed))
                if setting == "via":
                    choices[name] = [DIRECT] if parts == at_home else [DIRECT, HOME]
                elif setting == "side":
                    first, *others = map(equal_sides, objects)
                    choices[name] = [side for side in first if all(side in other for other in others)]
                else:
                    for part, obj in zip(placed, objects, strict=True):
                        side, tool, gripped = FIRST_SIDE, 1, 1
                        if isinstance(part, GraspWaypoint):
                            side, tool = side_of(setting_value(part.side, one.values)), tool_turns(cell.model)
                            # Fingers may close on any two opposite sides, of which one pair may be too far apart.
                            gripped = 4 if cell.model.fingers.joints else 1
                        turns.append(ROUND if tool == ROUND else lcm(part_turns(obj, side), gripped))
                    choices[name] = equal_turns(gcd(*turns))
            chosen = (dict(zip(choices, values, strict=True)) for values in product(*choices.values()))
            longer += [replace(one, values={**one.values, **values}) for values in chosen]
        found = longer
    return tuple(found)


def _free(candidate: Candidate, setting: str) -> dict[str, list[Entry]]:
    """The parameters that leave a setting free, each with the waypoints or joint moves that it is for."""
    found: dict[str, list[Entry]] = {}
    for part in (*candidate.skill.waypoints.values(), *candidate.skill.primitives):
        stated = getattr(part, setting, None)
        if isinstance(stated, Reference) and candidate.values[stated.parameter] == ANY:
            found.setdefault(stated.parameter, []).append(part)
    return found


ROUND = 0  # The number of turns of what looks the same in every turn; `math.gcd` takes it as divisible by all
TURNS_OF_ROUND = 4  # So many of the endlessly many turns of something round are tried: every 90 degrees
SAME_SIZE = 1e-6  # Lengths that differ by no more than this are equal [m], and so are directions [rad]
SIDES = ("+z", "+x", "-x", "+y", "-y", "-z")  # The sides of a box, first the one by which most objects are gripped


def tool_turns(model: RobotModel) -> int:
    """In how many equal turns about its z axis the tool looks the same; a gripper counts as 1."""
    X_WL = model.home_links
    X_TW = np.linalg.inv(X_WL[model.tool_frame])
    parts = [part for part in model.parts if part.parent in model.hand_links]
    placed = (_turns(part, X_TW @ X_WL[part.parent] @ part.X_PG, 2) for part in parts)
    return ROUND if parts and not model.fingers.joints and gcd(*placed) == ROUND else 1


def part_turns(obj: SceneObject, side: str) -> int:
    """In how many equal turns about the axis through one of its sides, such as `+z`, an object looks the same.

    About z as the workspace states it, else as its shapes do; one whose shapes do not show it counts as 1.
    """
    axis = "xyz".index(side[1])
    if axis == 2 and obj.symmetry is not None:
        return ROUND if obj.symmetry == "round" else obj.symmetry
    return gcd(*(_turns(part, part.X_PG, axis) for part in obj.parts))


def equal_turns(count: int) -> list[float]:
    """The turns that look the same [rad], in (-pi, pi], 0 first; some of them for what is round."""
    number = count or TURNS_OF_ROUND
    turns = [2 * np.pi * k / number for k in range(number)]
    return [float(turn if turn <= np.pi + SAME_SIZE else turn - 2 * np.pi) for turn in turns]


def equal_sides(obj: SceneObject) -> list[str]:
    """The sides at which an object looks to a tool as it does at +z: that one first, or alone."""
    if obj.symmetry is not None or len(obj.parts) != 1 or part_turns(obj, SIDES[0]) == 1:
        return [SIDES[0]]
    faces = {side: sorted(np.delete(obj.size, "xyz".index(side[1]))) for side in SIDES}
    box = isinstance(obj.parts[0].shape, Box | Sphere)
    alike = [side for side in SIDES if np.allclose(faces[side], faces[SIDES[0]], rtol=0.0, atol=SAME_SIZE)]
    return alike if box else [side for side in alike if side[1] == "z"]


def _turns(part: Part, X: Array, axis: int) -> int:
    """In how many turns about an axis of a frame a part looks the same; X: pose of its shape there, shape (4, 4)."""
    direction = np.eye(3)[axis]
    off = X[:3, 3] - X[axis, 3] * direction
    if np.abs(off).max() > SAME_SIZE:
        return 1
    along = np.abs(direction @ X[:3, :3])  # the shape's own axes along the axis
    own = int(along.argmax())
    if isinstance(part.shape, Sphere):
        return ROUND
    if along[own] < 1 - SAME_SIZE:
        return 1
    if isinstance(part.shape, Cylinder | Capsule):
        return ROUND if own == 2 else 2
    if isinstance(part.shape, Box):
        first, second = np.delete(part.shape.size, own)
        return 4 if abs(first - second) <= SAME_SIZE else 2
    return 1


_ORDER = ("left", "right", "no_flip", "flip", "up", "down")
"""The words of branches in the order in which they are said; other values follow."""
_UNSAID = ("no_flip", "up", "direct", "+z", "0")  # Values that are so usual that only the others are said

_SAID = {
    "left": "shoulder left",
    "right": "shoulder right",
    "flip": "wrist flipped",
    "down": "elbow down",
    "home": "via home",
    "seen": "path in sight",
}


def way_in_words(skill: Skill, asked: Mapping[str, MotionValue], found: Mapping[str, MotionValue]) -> str:
    """What a way's parameters say beyond those of its candidate, such as `shoulder left, tool turned 90 deg`.

    asked, found: the parameters of the candidate, and of the way. Where it chooses for several joint moves, each choice
    for one of them names it by what it does.
    """
    values = in_words(skill, found)
    chosen = [(name, values[name]) for name, value in found.items() if asked.get(name) != value]
    chosen.sort(key=lambda pair: _ORDER.index(pair[1]) if pair[1] in _ORDER else len(_ORDER))
    moves = [primitive for primitive in skill.primitives if isinstance(primitive, JointMove)]
    owners = dict[str, set[str]]()  # of each choice: the move or waypoint it is called after, or all moves with it
    for name, _ in chosen:
        owner, stated = name.rpartition(".")[0], Reference(name)
        users = {move.name for move in moves if stated in (move.elbow, move.shoulder, move.wrist, move.via)}
        owners[name] = {owner} if owner else users
    several = len(set().union(*owners.values()) & {move.name for move in moves}) > 1
    puts = [place for place in skill.waypoints.values() if isinstance(place, PutWaypoint)]
    said = []
    for name, value in chosen:
        if value not in _UNSAID:
            setting, owner = name.rpartition(".")[2], min(owners[name], default="")
            put = isinstance(skill.waypoints.get(owner), PutWaypoint) or any(Reference(name) == one.yaw for one in puts)
            words = f"arm position {value}" if setting == "solution" else _SAID.get(value, value)
            words = f"{'part' if put else 'tool'} turned {value}" if value.endswith(" deg") else words
            words = f"from its {value} side" if value[:1] in "+-" and value[1:] in ("x", "y", "z") else words
            named = len(owners[name]) == 1 and (several or setting not in (name, "solution"))
            said.append(f"{words} ({skill.pieces.get(owner, owner)})" if named else words)
    if asked.get("path", "direct") != found.get("path", "direct") == "direct":
        said.append("direct path")
    return ", ".join(said) or NOTHING_SPECIAL


def choice_in_words(asked: Candidate, way: Candidate) -> str:
    """What a way says beyond its candidate, of each step if there are several."""
    if not asked.steps:
        return way_in_words(asked.skill, asked.parameters, way.parameters)
    pairs = enumerate(zip(asked.steps, way.steps, strict=True), 1)
    return ", ".join(f"step {number} {choice_in_words(one, done)}" for number, (one, done) in pairs)
