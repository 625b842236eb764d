"""Workspaces, calibrations and skills of sizes that nobody has."""

from __future__ import annotations

from collections.abc import Callable

from tests.damage.bombs import TEXT, YAML, Bomb, replaced

_CAMERA = "{pose: {position: [1, 0, 1], look_at: [0, 0, 0]}, image: {width: 64, height: 48, fx: 50}, rate: 10 Hz}"
_CUBE = "{type: cube, color: green, size: [0.01, 0.01, 0.01], pose: {position: [0.4, %g, 0.005]}}"


def _entries(name: str, section: str, count: int, entry: Callable[[int], str]) -> Bomb:
    """A bomb of so many more entries at the beginning of a section."""

    def text() -> str:
        return f"\n{section}:\n" + "".join(f"  extra{i}: {entry(i)}\n" for i in range(count)) + "  # "

    return replaced(name, f"\n{section}:", text)


WORKSPACE = (
    *TEXT, *YAML,
    _entries("50-cameras", "cameras", 50, lambda _: _CAMERA),
    _entries("1000-cameras", "cameras", 1000, lambda _: _CAMERA),
    _entries("200-objects", "objects", 200, lambda i: _CUBE % (-0.4 + 0.003 * i)),
    _entries("5000-objects", "objects", 5000, lambda i: _CUBE % (-0.4 + 0.0001 * i)),
    _entries("objects-on-objects", "objects", 300, lambda i: _CUBE % 0.3 + "" if i == 0 else (_CUBE % 0.3)[:-1]
        + f", on: extra{i - 1}}}"),
    replaced("5000-facts", "\nstate:", lambda: "\nstate:\n" + "".join(f"  - on(g1, g{i})\n" for i in range(5000))
        + "other:"),
    replaced("5000-tasks", "- {task: pickup green}", lambda: "- {task: pickup green}\n  " * 5000
        + "- {task: pickup red}"),
    replaced("5000-skills", "skills: [skills/pickup]", lambda: f"skills: [{'skills/pickup, ' * 5000}skills/pickup]"),
    replaced("skill-of-dots", "skills/pickup]", "../" * 3000 + "x]"),
    replaced("skill-nul", "skills/pickup]", '"skills\\0"]'),
    replaced("skill-of-a-file", "skills/pickup]", "workspace.yaml]"),
    replaced("500-parts", "parts: [", lambda: "parts: [" + "{mesh: cube.stl, scale: 0.01}, " * 500),
    replaced("5000-parts", "parts: [", lambda: "parts: [" + "{mesh: cube.stl, scale: 0.01}, " * 5000),
    replaced("scale-1e9", "scale: 0.04", "scale: 1e9"),
    replaced("scale-1e-9", "scale: 0.04", "scale: 1e-9"),
    replaced("scale-0", "scale: 0.04", "scale: 0"),
    replaced("mesh-of-zeros", "mesh: cube.stl", "mesh: /dev/zero"),
    replaced("mesh-nul", "mesh: cube.stl", 'mesh: "cube\\0.stl"'),
    replaced("mesh-surrogate", "mesh: cube.stl", 'mesh: "cube\\ud800.stl"'),
    replaced("mesh-long", "mesh: cube.stl", "mesh: " + "x" * 5000),
    replaced("urdf-folder", "urdf: robots/six_axis_arm.urdf", "urdf: robots"),
    replaced("urdf-of-nobody", "urdf: robots/six_axis_arm.urdf", "urdf: ~nobody-of-that-name/x.urdf"),
    replaced("urdf-package", "urdf: robots/six_axis_arm.urdf", "urdf: package://" + "../" * 100 + "x.urdf"),
    replaced("limits-1e300", "acceleration: 2, jerk: 20", "acceleration: 1e300, jerk: 1e300"),
    replaced("limits-1e-9", "acceleration: 2, jerk: 20", "acceleration: 1e-9, jerk: 1e-9"),
    replaced("home-1e18", "joint_1: -13 deg", "joint_1: 1e18 deg"),
    replaced("home-1e6", "joint_1: -13 deg", "joint_1: 1e6"),
    replaced("base-1e6", "position: [0, 0, 0]", "position: [1e6, 0, 0]"),
    replaced("rate-1e9", "rate: 10 Hz", "rate: 1e9 Hz"),
    replaced("rate-1e-9", "rate: 10 Hz", "rate: 1e-9 Hz"),
    replaced("latency-1e9", "latency: 50 ms", "latency: 1e9 s"),
    replaced("far-1e300", "far: 6 m", "far: 1e300"),
    replaced("image-of-1e6", "calibration: camera.yaml",
        "image: {width: 1000000, height: 1000000, horizontal_fov: 60 deg}"),
    replaced("image-of-1", "calibration: camera.yaml", "image: {width: 1, height: 1, horizontal_fov: 60 deg}"),
    replaced("lens-of-180", "calibration: camera.yaml",
        "image: {width: 64, height: 48, horizontal_fov: 179.999 deg}"),
    replaced("look-at-itself", "look_at: [", "look_at: [-0.32, 0.32, 0.6]  # "),
    replaced("size-1e-9", "size: [0.04, 0.04, 0.04]", "size: [1e-9, 0.04, 0.04]"),
    replaced("size-1e9", "size: [0.04, 0.04, 0.04]", "size: [1e9, 1e9, 1e9]"),
    replaced("on-itself", "on: table", "on: g1"),
)  # fmt: skip

CAMERA = (
    *TEXT, *YAML,
    replaced("width-1e9", "image_width: ", "image_width: 1000000000 # "),
    replaced("width-0", "image_width: ", "image_width: 0 # "),
    replaced("rows-1e9", "rows: 3", "rows: 1000000000"),
    replaced("rows--1", "rows: 3", "rows: -1"),
    replaced("data-of-100000", "data: [", lambda: "data: [" + "0.5, " * 100_000),
    replaced("distortion-1e300", "data: [", "data: [1e300, "),
)  # fmt: skip

HAND_EYE = (
    *TEXT, *YAML,
    replaced("far-away", "x: 0.4", "x: 1e300"),
    replaced("far", "x: 0.4", "x: 1e9"),
    replaced("no-rotation", "x: -0.92388", "x: 0\n    w: 0\n    #"),
    replaced("huge-rotation", "x: -0.92388", "x: 1e200"),
    replaced("tiny-rotation", "x: -0.92388", "x: 1e-200"),
)  # fmt: skip

_FORMULA = "eventually[a4.start, a4.end] (not hold and obj_on_table)"
_ALWAYS = "always[a4.start, a5.end] (hold and not obj_on_table)"
_BOX = "{name: at_cup, frame: tool, fits: object, at: grasp, detector: color, encloses: [object]}"


def _formula(name: str, text: str | Callable[[], str]) -> Bomb:
    return replaced(f"formula-{name}", _FORMULA, text)


SKILL = (
    *TEXT, *YAML,
    _formula("of-parentheses", lambda: "(" * 20_000 + "hold" + ")" * 20_000),
    _formula("of-negations", lambda: "not " * 20_000 + "hold"),
    _formula("of-operators", lambda: "eventually[0, 1] " * 2000 + "hold"),
    _formula("of-20000-literals", lambda: "eventually[a4.start, a4.end] (" + "hold and " * 20_000 + "hold)"),
    _formula("of-1e999", "eventually[a4.start, 1e999] hold"),
    _formula("of-400-digits", f"eventually[a4.start, a4.end + {'9' * 400}] hold"),
    _formula("of-5000-digits", f"eventually[a4.start, a4.end + {'9' * 5000}] hold"),
    _formula("of-1e300", "eventually[a4.start, a4.end + 1e300] hold"),
    _formula("of-offsets", lambda: f"eventually[a4.start{' + 0.1' * 20_000}, a4.end] hold"),
    _formula("of-signs", "◇[a4.start, a4.end] (¬hold ∧ ∧ hold)"),
    _formula("of-controls", '"eventually[a4.start, a4.end] (ho\\x01ld)"'),
    _formula("of-a-surrogate", '"eventually[a4.start, a4.end] (ho\\ud800ld)"'),
    _formula("of-line-ends", '"eventually[a4.start,\\n\\n\\n a4.end] (hold\\n\\n andd obj_on_table)"'),
    _formula("empty", "''"),
    _formula("blank", "'   '"),
    replaced("5000-formulas", f"  - {_ALWAYS}", lambda: f"  - {_ALWAYS}\n" * 5000),
    replaced("100-formulas", f"  - {_ALWAYS}", lambda: f"  - {_ALWAYS}\n" * 100),
    replaced("100-primitives", "  - {name: a5,", lambda: "".join(
        f"  - {{name: b{i}, wait: 1 s}}\n" for i in range(100)) + "  - {name: a5,"),
    replaced("5000-primitives", "  - {name: a5,", lambda: "".join(
        f"  - {{name: b{i}, wait: 1 s}}\n" for i in range(5000)) + "  - {name: a5,"),
    replaced("wait-1e9", "duration: 1 s", "duration: 1e9 s"),
    replaced("wait-1e-12", "duration: 1 s", "duration: 1e-12 s"),
    replaced("100-boxes", _BOX, lambda: "\n      - ".join(_BOX.replace("at_cup", f"b{i}") for i in range(100))),
    replaced("5000-boxes", _BOX, lambda: "\n      - ".join(_BOX.replace("at_cup", f"b{i}") for i in range(5000))),
    replaced("chain-of-waypoints", "  lifted:", lambda: "  w0: {from: grasp, raise: 1 mm}\n" + "".join(
        f"  w{i}: {{from: w{i - 1}, raise: 1 mm}}\n" for i in range(1, 3000)) + "  lifted:"),
    replaced("waypoint-of-itself", "{from: grasp, raise: $lift}", "{from: lifted, raise: $lift}"),
    replaced("a-million-values", "lift: 10 cm", "lift: {from: 1 cm, to: 20 cm, count: 1000000}"),
    replaced("1e18-values", "lift: 10 cm", "lift: {from: 1 cm, to: 20 cm, count: 1000000000000000000}"),
    replaced("values-of-all", "lift: 10 cm", "lift: {from: 1 cm, to: 20 cm, count: 300}"),
    replaced("cameras-1e9", "cameras: 1", "cameras: 1000000000"),
    replaced("retries-1e9", "retry: 2", "retry: 1000000000"),
    replaced("speed-1e-300", "speed: 5 cm/s", "speed: 1e-300"),
    replaced("speed-1e300", "speed: 5 cm/s", "speed: 1e300"),
    replaced("lift-1e300", "lift: 10 cm", "lift: 1e300"),
    replaced("lift-1e-12", "lift: 10 cm", "lift: 1e-12"),
    replaced("lift-900-m", "lift: 10 cm", "lift: 900 m"),
)  # fmt: skip

_PRECONDITION = ":precondition (and "


def _forall(count: int) -> str:
    names = " ".join(f"?v{i} - movable" for i in range(count))
    return f"{_PRECONDITION}(forall ({names}) (not (on ?v0 ?v{count - 1}))) "


def _pddl(name: str, old: str, new: str | Callable[[], str]) -> Bomb:
    return replaced(name, old, new)


PDDL = (
    *TEXT,
    *(_pddl(f"forall-{n}", _PRECONDITION, lambda n=n: _forall(n)) for n in (2, 6, 10, 15, 100)),
    _pddl("forall-in-forall", _PRECONDITION, lambda: _PRECONDITION + "".join(
        f"(forall (?n{i} - movable) " for i in range(15)) + "(not (on ?n0 ?n14))" + ")" * 15),
    *(_pddl(f"{n}-parameters", "(?object - movable)\n", lambda n=n: "(?object " + " ".join(f"?v{i}"
        for i in range(n)) + " - movable)\n")
      for n in (2, 4, 12, 15, 1000)),
    *(_pddl(f"{n}-parameters-to-plan", "(?object - movable)\n", lambda n=n: "(?object " + " ".join(f"?v{i}"
        for i in range(n)) + " - movable)\n  ")
      for n in (5, 10)),
    _pddl("effect-forall-10", ":effect (and ", ":effect (and (forall (" + " ".join(f"?v{i} - movable"
        for i in range(10)) + ") (not (on ?v0 ?v9))) "),
    _pddl("nested-not", "(not (hold ?object))", lambda: "(not " * 3000 + "(hold ?object)" + ")" * 3000),
    _pddl("nested-and", _PRECONDITION, lambda: ":precondition " + "(and " * 3000 + "(hand_empty)" + ")" * 3000
        + " (and "),
    _pddl("or-2^20", _PRECONDITION, lambda: _PRECONDITION + "(or (hand_empty) (hold ?object)) " * 20),
    _pddl("imply", _PRECONDITION, lambda: _PRECONDITION + "(imply (hand_empty) (hand_empty)) " * 20),
    _pddl("exists", _PRECONDITION, lambda: _PRECONDITION + "(exists (" + " ".join(f"?v{i} - movable"
        for i in range(12)) + ") (on ?v0 ?v11)) "),
    _pddl("20000-literals", _PRECONDITION, lambda: _PRECONDITION + "(hand_empty) " * 20_000),
    _pddl("20000-predicates", "(:predicates", lambda: "(:predicates " + " ".join(f"(p{i} ?x)"
        for i in range(20_000))),
    _pddl("predicate-of-1000", "(:predicates", lambda: "(:predicates (p " + " ".join(f"?x{i}" for i in range(1000))
        + ")"),
    _pddl("20000-types", "(:types", lambda: "(:types " + " ".join(f"t{i}" for i in range(20_000))),
    _pddl("chain-of-types", "(:types", lambda: "(:types " + " ".join(f"t{i} - t{i + 1}" for i in range(3000))
        + " t3000 "),
    _pddl("types-in-a-circle", "(:types", "(:types a - b b - a "),
    _pddl("20000-constants", "(:predicates", lambda: "(:constants " + " ".join(f"c{i}" for i in range(20_000))
        + " - movable) (:predicates"),
    _pddl("either", "?object - movable", lambda: "?object - (either " + "movable " * 10_000 + ")"),
    _pddl("20000-actions", "(:action pickup", lambda: "(:action x :parameters () :effect (hand_empty)) " * 20_000
        + "(:action pickup"),
    _pddl("control-in-name", "(hand_empty))", "(hand\x01empty))"),
    _pddl("bidi-in-name", "(hand_empty))", "(hand\u202eempty))"),
    _pddl("numbers", _PRECONDITION, _PRECONDITION + "(= (total-cost) 1e999) (> (x) " + "9" * 5000 + ") "),
    _pddl("quotes", "(hand_empty))", '"(hand_empty))'),
    _pddl("unicode-name", "hand_empty", "händ_émpty"),
)  # fmt: skip
