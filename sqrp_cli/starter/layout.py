"""The contents of a starter workspace, and its file as text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from math import degrees
from pathlib import Path

from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, matrix_to_rpy
from sqrp_cli.records import dataclass
from sqrp_cli.starter.description import PREFIX, Description, text_in_yaml
from sqrp_cli.starter.hand import Grip

TASK, RECORDED = "pickup green", "demo"  # the task of a starter workspace, also of one for a recording
SCHEMA = ".sqrp/workspace.schema.json"  # by which editors complete and check the workspace file beside it
Point = tuple[float, float, float]  # in the world [m]


@dataclass(frozen=True)
class Cube:
    """A cube on the table: its name, colour, the position of its centre in the world [m], and its turn [rad]."""

    name: str
    color: str
    position: Point
    turn: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """A starter workspace: its folder, everything in its file, and warnings about what could not be guessed.

    Texts are as the file has them. Poses are 4x4, lengths in m, angles in rad.
    """

    folder: Path
    robot: Description
    guessed: bool  # whether the robot is the user's own, so that guesses are marked
    tip: str  # the link of the robot that carries the tool, or grasps itself while there is none
    home: Mapping[str, float]  # of every joint of the arm by name [rad, or m if it `slides`]
    slides: frozenset[str]
    limits: str
    home_state: str | None = None  # the state of the SRDF that stands for home, if there is one
    lift: float = 0.0  # height of the root link above the table
    X_LT: Array | None = None  # pose of the tool's root in the link `tip`; None while there is no tool of its own
    grip: Grip | None = None  # how the fingers grasp, of the gripper or of the robot itself
    table_side: float = 0.0  # of the square table, 0 for none
    table_at: tuple[float, float] = (0.0, 0.0)  # where its middle is, along x and y of the world
    directions: tuple[float, ...] = ()
    """From the shoulder, in which the work may lie; of a known home the one in which it lies."""
    cube_size: float = 0.04
    cubes: Sequence[Cube] = ()
    views: Mapping[str, tuple[Point, Point]] = field(default_factory=dict)
    """Of each camera by name: where it is, and the point that it looks at."""
    recording: str = ""  # the entry of a recording, whose episodes are then the task
    told: tuple[str, ...] = ()  # what was guessed of it, in sentences
    warnings: tuple[Problem, ...] = ()

    @property
    def task(self) -> str | None:
        """A task to rank; None if nothing is within reach."""
        return TASK if self.cubes else RECORDED if self.recording else None


_ROBOT = """\
# yaml-language-server: $schema={schema}
# A cell with {arm}, {hand} and cameras. SI units and radians; `30 deg`, `20 mm`, `50 ms` work too.
{marked}# Every key: sqrp schema

robot:
  {urdf}
{files}  base: {{position: [0, 0, {lift}], rpy: [0, 0, 0 deg]}}  # check: pose of the root link in the world; the \
table's top is z = 0
{tool}{fingers}  home:{home}
  limits: {limits}

detectors:                  # what your detection algorithms can do
  color: {{kind: color, distance: [5 cm, 5 m], max_incidence: 90 deg, min_pixels: 12, min_visible: 0.5}}  # check: yours
"""

_CUP = """\
  tool:  # check: a suction cup stands for your tool; its own URDF, fixed to a link of the arm
    urdf: robots/suction_cup.urdf
    link: {link}
    pose: {pose}  # check: where the tool begins, its z axis pointing out
  tool_frame: suction_tip  # check: the link that grasps; its z axis points into the object
"""

_FRAME = "where it grasps: between the fingertips; z points into the object, the fingers close along y"

_FINGERS = """\
  fingers:  # check: the joints that drive the fingers; those that follow them need no line
    open: {{{open}}}
    closed: {{{closed}}}
    width: {width} mm  # check: how wide they open, fingertip to fingertip
"""

_LENS = """\
    image: {{width: 1280, height: 960, horizontal_fov: 60 deg}}
    near: 5 cm
    far: 6 m
    rate: 10 Hz
    latency: 50 ms
"""

_CAMERA = """\
  {name}:  # check: yours; or `calibration: camera.yaml` (ROS) instead of `image`
    pose: {{position: {position}, look_at: {look_at}}}
"""


def workspace_text(layout: Layout) -> str:
    """The workspace file. Guesses about a robot of the user's own carry a comment that begins with `check:`."""
    files, fingers, grip, robot = "", "", layout.grip, layout.robot
    gripper = None if layout.X_LT is None else robot.gripper_text  # else a suction cup
    if robot.srdf_text is not None:
        files += f"  srdf: {robot.srdf_text}  # check: found beside the URDF\n"
    if robot.package_roots:
        roots = ", ".join(map(text_in_yaml, robot.package_roots))
        files += f"  package_roots: [{roots}]  # check: where the package:// of its meshes is looked up\n"
    if gripper:
        files += "  geometry: visual  # check: which shapes are solid and hide things; `collision` is faster\n"
    if grip is not None:
        opened, closed = (
            ", ".join(f"{text_in_yaml(name)}: {_position(at, name in layout.slides)}" for name, at in of.items())
            for of in (grip.open, grip.closed)
        )
        fingers = _FINGERS.format(open=opened, closed=closed, width=f"{1000 * grip.width:.1f}")
        named = f"    urdf: {gripper}\n    prefix: {PREFIX}\n" if gripper else ""
        tool = "  tool:" + ("" if gripper else "  # check: the hand of the robot")
        tool += f"\n{named}    link: {text_in_yaml(layout.tip)}\n"
        if layout.X_LT is not None:
            tool += f"    pose: {_pose(layout.X_LT)}  # check: where the gripper begins, its z axis pointing out\n"
        tool += f"    frame: {_pose(grip.X_RT)}  # check: {_FRAME}\n"
    elif layout.X_LT is not None:
        tool = _CUP.format(link=text_in_yaml(layout.tip), pose=_pose(layout.X_LT))
    else:
        tool = f"  tool_frame: {text_in_yaml(layout.tip)}\n"
    home = f" {text_in_yaml(layout.home_state or '')}  # check: where programs start and end; a state of the SRDF"
    if layout.home_state is None:
        home = "  # check: where programs start and end"
        for name, at in layout.home.items():
            home += f"\n    {text_in_yaml(name)}: {_position(at, name in layout.slides)}"
    marked = "# Lines marked `check:` were guessed; `sqrp show` prints what was understood.\n"
    text = _ROBOT.format(
        schema=SCHEMA,
        arm="your arm" if layout.guessed else "a six-axis arm",
        hand="a suction cup" if grip is None else "its gripper",
        marked=marked if layout.guessed else "",
        urdf=f"{'mjcf' if robot.urdf.is_mjcf else 'urdf'}: {robot.urdf_text}",
        files=files,
        lift=_number(layout.lift),
        tool=tool,
        fingers=fingers,
        home=home,
        limits=layout.limits,
    )
    if layout.views:
        text += "\ncameras:                    # pose: where the lens is, and the point that it looks at\n"
        for name, (position, look_at) in layout.views.items():
            text += (_CAMERA + _LENS).format(name=name, position=_vector(position), look_at=_vector(look_at))
    if layout.cubes:
        text += "\nskills: [skills/pickup]     # how the task is done and what the cameras must see; yours to change\n"
    if layout.table_side:
        side, edge = _number(layout.table_side), ", ".join([_number(layout.cube_size)] * 3)
        table = f"pose: {{position: {_vector((*layout.table_at, -0.02))}}}"
        text += "\nobjects:                    # pose: of the centre of a box of `size`\n"
        text += f"  table: {{type: table, color: grey, size: [{side}, {side}, 0.04], {table}, fixed: true}}\n"
        for cube in layout.cubes:
            turn = f", rpy: [0, 0, {round(degrees(cube.turn), 1):g} deg]" if cube.turn else ""
            stands = f"pose: {{position: {_vector(cube.position)}{turn}}}, on: table"
            text += f"  {cube.name}: {{type: cube, color: {cube.color}, size: [{edge}], {stands}}}\n"
    if layout.cubes:
        text += f"\ntasks:\n  - {{task: {TASK}}}\n"
    if layout.recording:
        text += f"\nrecordings:\n{layout.recording}\n"
    return text if layout.guessed else re.sub(r"  # check: .*", "", text)


_MOUNTS = """\
# check: where cameras may go, and which: what `sqrp place` chooses from
mounts:
  left:
    rail: {{from: {}, to: {}, step: 25 cm}}
  right:
    rail: {{from: {}, to: {}, step: 25 cm}}
  above:
    grid: {{from: {}, to: {}, step: 25 cm}}

lenses:
  usual:
"""


def mounts_text(layout: Layout) -> str:
    """The file of mounts around a table, half as high as it is wide and once above it."""
    (x, y), half = layout.table_at, 0.5 * layout.table_side
    places = [(a, b, half) for b in (1, -1) for a in (-1, 1)] + [(-1, -1, 2 * half), (1, 1, 2 * half)]
    return (_MOUNTS + _LENS).format(*(_vector((x + a * half, y + b * half, height)) for a, b, height in places))


def _position(at: float, slides: bool) -> str:
    return f"{_number(at)} m" if slides else f"{round(degrees(at), 2) + 0.0:g} deg"


def _pose(X: Array) -> str:
    rpy = ", ".join(f"{round(degrees(value), 2) + 0.0:g} deg" for value in matrix_to_rpy(X[:3, :3]))
    return f"{{position: {_vector(X[:3, 3].tolist())}, rpy: [{rpy}]}}"


def _number(value: float) -> str:
    return f"{round(value, 4) + 0.0:g}"


def _vector(values: Sequence[float]) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"
