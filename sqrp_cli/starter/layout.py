"""The contents of a starter workspace, and its file as text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from sqrp_cli.geometry import Array, matrix_to_rpy
from sqrp_cli.starter.description import NamedFile

TASK = "pickup green"
"""The task of a starter workspace."""

TOOL_FRAME = "suction_tip"
"""The grasping link of the shipped suction cup."""


@dataclass(frozen=True)
class Cube:
    """A cube on the table: its name, colour, the position of its centre in the world [m], and its turn [rad]."""

    name: str
    color: str
    position: tuple[float, float, float]
    turn: float = 0.0


@dataclass(frozen=True)
class CameraView:
    """A camera: its name, where it is and the point that it looks at, in the world [m]."""

    name: str
    position: tuple[float, float, float]
    looks_at: tuple[float, float, float]


@dataclass(frozen=True)
class Position:
    """Where a joint is [rad, or m if it slides]."""

    value: float
    turns: bool


@dataclass(frozen=True, eq=False)
class Layout:
    """Everything in the file of a starter workspace.

    urdf, srdf, package_roots: as the file names them. guessed: whether the robot is the user's own, so that guesses
    are marked. lift: height of the root link above the table [m].
    tip: the link of the robot that carries the suction cup, or grasps itself while there is none.
    X_LT: pose of the cup's root in that link, shape (4, 4); None while there is no cup.
    home: of every joint of the arm by name. limits: what the file says of them.
    home_state: the state of the SRDF that stands for it, if there is one.
    table_side: of the square table, 0 for none [m]. table_at: where its middle is, along x and y of the world [m].
    """

    urdf: NamedFile
    srdf: NamedFile | None
    package_roots: tuple[str, ...]
    guessed: bool
    tip: str
    home: Mapping[str, Position]
    limits: str
    home_state: str | None = None
    lift: float = 0.0
    X_LT: Array | None = None
    table_side: float = 0.0
    table_at: tuple[float, float] = (0.0, 0.0)
    cube_size: float = 0.04
    cubes: Sequence[Cube] = ()
    views: Sequence[CameraView] = ()
    tasks: Sequence[str] = (TASK,)


def workspace_text(layout: Layout) -> str:
    """The workspace file. Guesses about a robot carry a comment that begins with `check:`."""
    sections = [_head(layout), _robot(layout), _DETECTORS, _cameras(layout)]
    if layout.cubes:
        tasks = "\n".join(f"  - {{task: {task}}}" for task in layout.tasks)
        sections += [_SKILLS, _objects(layout), _state(layout), f"tasks:\n{tasks}\n"]
    else:
        sections.append(_objects(layout))
    return "\n".join(section for section in sections if section)


def _check(layout: Layout, what: str) -> str:
    return f"  # check: {what}" if layout.guessed else ""


def _head(layout: Layout) -> str:
    arm = "your arm" if layout.guessed else "a six-axis arm"
    return (
        f"# A cell with {arm}, a suction cup and cameras. SI units and radians; `30 deg`, `20 mm`, `50 ms` work too.\n"
        + ("# Lines marked `check:` were guessed; `sqrp show` prints what was understood.\n" if layout.guessed else "")
        + "# Every key: sqrp schema\n"
    )


def _robot(layout: Layout) -> str:
    lines = ["robot:", f"  urdf: {_file(layout.urdf)}"]
    if layout.srdf is not None:
        lines.append(f"  srdf: {_file(layout.srdf)}{_check(layout, 'found beside the URDF')}")
    if layout.package_roots:
        roots = ", ".join(map(_text, layout.package_roots))
        lines.append(f"  package_roots: [{roots}]{_check(layout, 'where the package:// of its meshes is looked up')}")
    lines.append(
        f"  base: {{position: [0, 0, {_number(layout.lift)}], rpy: [0, 0, 0 deg]}}"
        + _check(layout, "pose of the root link in the world; the table's top is z = 0")
    )
    if layout.X_LT is None:
        lines.append(f"  tool_frame: {_text(layout.tip)}")
    else:
        lines += [
            "  tool:" + _check(layout, "a suction cup stands for your tool; its own URDF, fixed to a link of the arm"),
            "    urdf: robots/suction_cup.urdf",
            f"    link: {_text(layout.tip)}",
            f"    pose: {_pose(layout.X_LT)}" + _check(layout, "where the tool begins, its z axis pointing out"),
            f"  tool_frame: {TOOL_FRAME}" + _check(layout, "the link that grasps; its z axis points into the object"),
        ]
    lines += _home(layout)
    lines.append(f"  limits: {layout.limits}")
    return "\n".join(lines) + "\n"


_DETECTORS = """\
detectors:                  # what your detection algorithms can do
  color: {kind: color, distance: [20 cm, 5 m], max_incidence: 90 deg, min_pixels: 12, min_visible: 0.5}
"""


def _cameras(layout: Layout) -> str:
    if not layout.views:
        return ""
    lines = ["cameras:                    # pose: where the lens is, and the point that it looks at"]
    for view in layout.views:
        lines += [
            f"  {view.name}:" + _check(layout, "yours; or `calibration: camera.yaml` (ROS) instead of `image`"),
            f"    pose: {{position: {_vector(view.position)}, look_at: {_vector(view.looks_at)}}}",
            "    image: {width: 1280, height: 960, horizontal_fov: 60 deg}",
            "    near: 20 cm",
            "    far: 6 m",
            "    rate: 10 Hz",
            "    latency: 50 ms",
        ]
    return "\n".join(lines) + "\n"


_SKILLS = "skills: [skills/pickup]     # how the task is done and what the cameras must see; yours to change\n"


def _objects(layout: Layout) -> str:
    if not layout.table_side:
        return ""
    side = _number(layout.table_side)
    place = f"pose: {{position: {_vector((*layout.table_at, -0.02))}}}, fixed: true"
    lines = [
        "objects:                    # pose: of the centre of a box of `size`",
        f"  table: {{type: table, color: grey, size: [{side}, {side}, 0.04], {place}}}",
    ]
    side = _number(layout.cube_size)
    lines += [
        f"  {cube.name}: {{type: cube, color: {cube.color}, size: [{side}, {side}, {side}], "
        f"pose: {{position: {_vector(cube.position)}{_turn(cube.turn)}}}, on: table}}"
        for cube in layout.cubes
    ]
    return "\n".join(lines) + "\n"


def _state(layout: Layout) -> str:
    facts = ["hand_empty", *(f"obj_on_table({cube.name})" for cube in layout.cubes)]
    heading = "state:                      # what the sensors report now; every other fact is false"
    return "\n".join([heading, *(f"  - {fact}" for fact in facts)]) + "\n"


def _text(value: str) -> str:
    """Text as YAML, in quotes where it would be ambiguous."""
    plain = value[:1].isalpha() or value.startswith(("../", "./", "/"))
    harmless = all(character.isalnum() or character in "/._-:" for character in value) and not value.endswith(":")
    words = {"true", "false", "null"}
    return value if plain and harmless and value.lower() not in words else json.dumps(value, ensure_ascii=False)


def _home(layout: Layout) -> list[str]:
    what = "where programs start and end"
    if layout.home_state is not None:
        return [f"  home: {_text(layout.home_state)}" + _check(layout, f"{what}; a state of the SRDF")]
    positions = [f"    {_text(name)}: {_joint(position)}" for name, position in layout.home.items()]
    return ["  home:" + _check(layout, what), *positions]


def _file(file: NamedFile) -> str:
    """A file, with the arguments of a xacro."""
    if not file.arguments:
        return _text(file.path)
    arguments = ", ".join(f"{_text(name)}: {json.dumps(value)}" for name, value in file.arguments.items())
    return f"{{xacro: {_text(file.path)}, args: {{{arguments}}}}}"


def _number(value: float) -> str:
    return f"{round(value, 4) + 0.0:g}"


def _vector(values: Sequence[float]) -> str:
    return "[" + ", ".join(_number(value) for value in values) + "]"


def _turn(turn: float) -> str:
    return f", rpy: [0, 0, {round(degrees(turn), 1):g} deg]" if turn else ""


def _joint(position: Position) -> str:
    if position.turns:
        return f"{round(degrees(position.value), 1) + 0.0:g} deg"
    return f"{_number(position.value)} m"


def _pose(X: Array) -> str:
    rpy = ", ".join(f"{round(degrees(value), 4) + 0.0:g} deg" for value in matrix_to_rpy(X[:3, :3]))
    return f"{{position: {_vector(X[:3, 3].tolist())}, rpy: [{rpy}]}}"
