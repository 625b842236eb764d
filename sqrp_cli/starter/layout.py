"""The contents of a starter workspace, and its file as text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import degrees

from sqrp_cli.geometry import Array, matrix_to_rpy
from sqrp_cli.records import dataclass
from sqrp_cli.starter.description import NamedFile

TASK = "pickup green"  # the task of a starter workspace


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


@dataclass(frozen=True, eq=False)
class Layout:
    """Everything in the file of a starter workspace.

    urdf, srdf, package_roots: as the file names them. guessed: whether the robot is the user's own, so that guesses
    are marked. lift: height of the root link above the table [m].
    tip: the link of the robot that carries the suction cup, or grasps itself while there is none.
    X_LT: pose of the cup's root in that link, shape (4, 4); None while there is no cup.
    home: of every joint of the arm by name [rad, or m if it `slides`]. limits: what the file says of them.
    home_state: the state of the SRDF that stands for it, if there is one.
    table_side: of the square table, 0 for none [m]. table_at: where its middle is, along x and y of the world [m].
    directions: from the shoulder in which the work may lie, of a known home the one in which it lies [rad].
    """

    urdf: NamedFile
    srdf: NamedFile | None
    package_roots: tuple[str, ...]
    guessed: bool
    tip: str
    home: Mapping[str, float]
    slides: frozenset[str]
    limits: str
    home_state: str | None = None
    lift: float = 0.0
    X_LT: Array | None = None
    table_side: float = 0.0
    table_at: tuple[float, float] = (0.0, 0.0)
    directions: tuple[float, ...] = ()
    cube_size: float = 0.04
    cubes: Sequence[Cube] = ()
    views: Sequence[CameraView] = ()
    tasks: Sequence[str] = (TASK,)


def workspace_text(layout: Layout) -> str:
    """The workspace file. Guesses about a robot carry a comment that begins with `check:`."""

    def check(what: str) -> str:
        return f"  # check: {what}" if layout.guessed else ""

    arm, home = "your arm" if layout.guessed else "a six-axis arm", "where programs start and end"
    lines = [
        f"# A cell with {arm}, a suction cup and cameras. SI units and radians; `30 deg`, `20 mm`, `50 ms` work too.",
        *["# Lines marked `check:` were guessed; `sqrp show` prints what was understood."][: layout.guessed],
        "# Every key: sqrp schema",
        "",
        "robot:",
        f"  urdf: {_file(layout.urdf)}",
    ]
    if layout.srdf is not None:
        lines.append(f"  srdf: {_file(layout.srdf)}" + check("found beside the URDF"))
    if layout.package_roots:
        roots = ", ".join(map(_text, layout.package_roots))
        lines.append(f"  package_roots: [{roots}]" + check("where the package:// of its meshes is looked up"))
    base = f"  base: {{position: [0, 0, {_number(layout.lift)}], rpy: [0, 0, 0 deg]}}"
    lines.append(base + check("pose of the root link in the world; the table's top is z = 0"))
    if layout.X_LT is None:
        lines.append(f"  tool_frame: {_text(layout.tip)}")
    else:
        rpy = ", ".join(_degrees(value, 4) for value in matrix_to_rpy(layout.X_LT[:3, :3]))
        pose = f"{{position: {_vector(layout.X_LT[:3, 3].tolist())}, rpy: [{rpy}]}}"
        lines += [
            "  tool:" + check("a suction cup stands for your tool; its own URDF, fixed to a link of the arm"),
            "    urdf: robots/suction_cup.urdf",
            f"    link: {_text(layout.tip)}",
            f"    pose: {pose}" + check("where the tool begins, its z axis pointing out"),
            "  tool_frame: suction_tip" + check("the link that grasps; its z axis points into the object"),
        ]
    if layout.home_state is not None:
        lines.append(f"  home: {_text(layout.home_state)}" + check(f"{home}; a state of the SRDF"))
    else:
        lines.append("  home:" + check(home))
        for name, at in layout.home.items():
            lines.append(f"    {_text(name)}: {f'{_number(at)} m' if name in layout.slides else _degrees(at)}")
    lines += [
        f"  limits: {layout.limits}",
        "",
        "detectors:                  # what your detection algorithms can do",
        "  color: {kind: color, distance: [20 cm, 5 m], max_incidence: 90 deg, min_pixels: 12, min_visible: 0.5}",
        "",
    ]
    if layout.views:
        lines.append("cameras:                    # pose: where the lens is, and the point that it looks at")
        for view in layout.views:
            lines += [
                f"  {view.name}:" + check("yours; or `calibration: camera.yaml` (ROS) instead of `image`"),
                f"    pose: {{position: {_vector(view.position)}, look_at: {_vector(view.looks_at)}}}",
                "    image: {width: 1280, height: 960, horizontal_fov: 60 deg}",
                "    near: 20 cm",
                "    far: 6 m",
                "    rate: 10 Hz",
                "    latency: 50 ms",
            ]
        lines.append("")
    if layout.cubes:
        lines += [
            "skills: [skills/pickup]     # how the task is done and what the cameras must see; yours to change",
            "",
        ]
    if layout.table_side:
        side, cube_side = _number(layout.table_side), _number(layout.cube_size)
        table = f"pose: {{position: {_vector((*layout.table_at, -0.02))}}}"
        lines += [
            "objects:                    # pose: of the centre of a box of `size`",
            f"  table: {{type: table, color: grey, size: [{side}, {side}, 0.04], {table}, fixed: true}}",
        ]
        for cube in layout.cubes:
            turn = f", rpy: [0, 0, {round(degrees(cube.turn), 1):g} deg]" if cube.turn else ""
            size = ", ".join([cube_side] * 3)
            stands = f"pose: {{position: {_vector(cube.position)}{turn}}}, on: table"
            lines.append(f"  {cube.name}: {{type: cube, color: {cube.color}, size: [{size}], {stands}}}")
        lines.append("")
    if layout.cubes:
        lines += [
            "state:                      # what the sensors report now; every other fact is false",
            "  - hand_empty",
        ]
        lines += [*(f"  - obj_on_table({cube.name})" for cube in layout.cubes), ""]
        lines += ["tasks:", *(f"  - {{task: {task}}}" for task in layout.tasks), ""]
    return "\n".join(lines)


def _text(value: str) -> str:
    """Text as YAML, in quotes where it would be ambiguous."""
    plain = value[:1].isalpha() or value.startswith(("../", "./", "/"))
    harmless = all(character.isalnum() or character in "/._-:" for character in value) and not value.endswith(":")
    words = {"true", "false", "null"}
    return value if plain and harmless and value.lower() not in words else json.dumps(value, ensure_ascii=False)


def _file(file: NamedFile) -> str:
    """A file, with the arguments of a xacro."""
    if not file.arguments:
        return _text(file.path)
    arguments = ", ".join(f"{_text(name)}: {json.dumps(value)}" for name, value in file.arguments.items())
    return f"{{xacro: {_text(file.path)}, args: {{{arguments}}}}}"


def _number(value: float) -> str:
    return f"{round(value, 4) + 0.0:g}"


def _degrees(value: float, places: int = 1) -> str:
    return f"{round(degrees(value), places) + 0.0:g} deg"


def _vector(values: Sequence[float]) -> str:
    return "[" + ", ".join(_number(value) for value in values) + "]"
