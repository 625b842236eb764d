"""A skill: what it needs and does (PDDL), how it moves, and what must be seen while it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sqrp_cli.errors import Place, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.setting_kind import Kind
from sqrp_cli.logic.mtl import Formula
from sqrp_cli.logic.pddl import Action, Domain

MotionValue = float | str
"""Value of a motion parameter: a number in SI units, or a word such as `+z` or `up`."""


@dataclass(frozen=True)
class MotionParameter:
    """A parameter of the motion with the values that candidates try, in order; the first is the default.

    kinds: what each setting that uses it may be.
    """

    name: str
    values: tuple[MotionValue, ...]
    kinds: tuple[Kind, ...] = ()


@dataclass(frozen=True)
class Reference:
    """The name of a motion parameter, where a number or word may also stand directly."""

    parameter: str


Setting = MotionValue | Reference


@dataclass(frozen=True)
class GraspWaypoint:
    """The tool frame's origin in the centre of one side of an object, its z axis pointing into the object.

    object: the skill parameter that names the object. side: the outward axis of that side in the object's frame, one of
    `+x -x +y -y +z -z`. yaw: turn of the tool about its z axis [rad]; at yaw 0 the tool's x axis lies along the
    object's x axis (y axis for the sides +x and -x). depth: how far the tool frame goes into the object from there, for
    fingers [m].
    """

    object: str
    side: Setting
    yaw: Setting
    depth: Setting = 0.0


@dataclass(frozen=True)
class PutWaypoint:
    """The tool frame where the object that it holds stands upright on top of another object.

    object, on: the skill parameters that name them. along, across: where on it, in -1..1 along its x and its y axis:
    at 0 in the middle, at -1 and 1 flush with the edges. yaw: turn of the object against what it stands on [rad].
    """

    object: str
    on: str
    along: Setting
    across: Setting
    yaw: Setting


@dataclass(frozen=True)
class TurnWaypoint:
    """Another waypoint, turned about the tool's z axis by `turn` and then about its x axis by `tilt` [rad]."""

    waypoint: str
    turn: Setting
    tilt: Setting


@dataclass(frozen=True)
class RetreatWaypoint:
    """Another waypoint, moved back against the tool's z axis by `distance` [m]."""

    waypoint: str
    distance: Setting


@dataclass(frozen=True)
class RaiseWaypoint:
    """Another waypoint, moved up along the world's z axis by `distance` [m]."""

    waypoint: str
    distance: Setting


@dataclass(frozen=True, eq=False)
class PoseWaypoint:
    """The tool frame at a fixed pose, `X_WT`, shape (4, 4)."""

    X_WT: Array


Waypoint = GraspWaypoint | PutWaypoint | RetreatWaypoint | RaiseWaypoint | TurnWaypoint | PoseWaypoint

HOME = "home"
"""The waypoint that every skill has: the robot's home configuration."""


@dataclass(frozen=True)
class JointMove:
    """All joints move together to a waypoint; speed is a share of the joints' velocity limits, in (0, 1].

    elbow, shoulder, wrist: which branch of inverse kinematics it ends in, or `any`; see `programming.arm.branches`.
    via: `direct`, or `home` for a stop at the home configuration on the way.
    """

    name: str
    to: str
    speed: Setting
    elbow: Setting = "any"
    shoulder: Setting = "any"
    wrist: Setting = "any"
    via: Setting = "direct"


@dataclass(frozen=True)
class StraightMove:
    """The tool frame moves to a waypoint on a straight line.

    speed [m/s], acceleration [m/s^2] and jerk [m/s^3] are those of the tool.
    """

    name: str
    to: str
    speed: Setting
    acceleration: Setting
    jerk: Setting


@dataclass(frozen=True)
class Grasp:
    """The tool takes hold of an object; it is attached at the end of `duration` [s]."""

    name: str
    object: str
    duration: Setting


@dataclass(frozen=True)
class Release:
    """The tool lets go of what it holds, which is detached at the end of `duration` [s]."""

    name: str
    duration: Setting


@dataclass(frozen=True)
class Wait:
    """The robot stands still for `duration` [s]."""

    name: str
    duration: Setting


PrimitiveAction = JointMove | StraightMove | Grasp | Release | Wait


@dataclass(frozen=True)
class Response:
    """What the robot does when a formula is violated or a fault is seen.

    retries: how often a `retry` may be tried. condition: what must be seen before a retry starts, None for nothing.
    """

    action: Literal["stop", "retry", "continue"]
    retries: int = 0
    condition: Formula | None = None


@dataclass(frozen=True)
class Requirement:
    """A temporal sensing requirement: an MTL formula over the skill's predicates, with the response to its violation.

    name: `None` for a plain requirement; the fault's name for a formula that describes a fault.
    settle: time that a literal may lag behind its expected change before it counts as violated [s].
    place: where the formula's text starts.
    """

    name: str | None
    formula: Formula
    response: Response
    settle: float
    place: Place


@dataclass(frozen=True, eq=False)
class BoxSpec:
    """One box of a target, before grounding.

    frame: `world`, a link, `tool` (the tool frame), a skill parameter or an object (the box moves with it), or either
    of them with `@start` (where that object is when the skill begins).
    fits: a skill parameter or an object: the box has the size of that object, enlarged by `margin` [m] on every side.
    at: with `fits`, a waypoint: the box lies where the object would be if it were held there: with frame `tool` that is
    its place in the tool, with another one its place in the world, from where the box then moves with that frame.
    None: the box lies at the frame, or `size` is given.
    size: full extents [m]. X_FB: pose of the box in the frame (on top of `fits`), shape (4, 4).
    normal: unit vector in the box's axes, away from the surface it lies on, or None.
    encloses: links, objects, skill parameters or `tool` (all parts of the tool) that the box encloses; None for the
    default: the object of the frame.
    """

    name: str
    frame: str
    fits: str | None
    at: str | None
    margin: float
    size: tuple[float, float, float] | None
    X_FB: Array
    detector: str
    normal: tuple[float, float, float] | None
    encloses: tuple[str, ...] | None
    place: Place


@dataclass(frozen=True)
class TargetSpec:
    """What decides a predicate: `cameras` of the cell must each see all the boxes."""

    predicate: str
    cameras: int
    boxes: tuple[BoxSpec, ...]
    place: Place


@dataclass(frozen=True)
class Skill:
    """A skill as its two files define it; `action` is its PDDL action, `domain` the types and predicates around it."""

    name: str
    folder: Path
    domain: Domain
    action: Action
    motion_parameters: tuple[MotionParameter, ...]
    waypoints: Mapping[str, Waypoint]
    primitives: tuple[PrimitiveAction, ...]
    requirements: tuple[Requirement, ...]
    targets: Mapping[str, TargetSpec]
    places: Mapping[str, Place]
    """Position of every key of skill.yaml, by its dotted path (such as `primitives.0.to`)."""
    warnings: tuple[Problem, ...]
    """Findings that do not prevent its use."""

    @property
    def retried_faults(self) -> frozenset[str]:
        """Names of the faults after which the robot tries again."""
        retried = (requirement.name for requirement in self.requirements if requirement.response.action == "retry")
        return frozenset(name for name in retried if name is not None)
