"""The XML of robot descriptions, URDF and SRDF: plain, or expanded from xacro.

Xacro files are expanded by the library `xacro`, in a process of its own with limits (`xacro_child`).
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, first_names
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.xml_file import MAX_BYTES, MAX_DEPTH, Element, parse_xml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.mjcf import mjcf_as_urdf

MAX_SECONDS = 20  # most computing time of an expansion [s]
MAX_MEMORY = 1_500_000_000  # most memory of an expansion [bytes]
MAX_WAIT = 90.0  # longest wait for an expansion, on however busy a machine [s]
_ARGUMENT = re.compile(r"\$\(arg\s+(\w+)\s*\)")
ROOT = "robot"  # the root element of URDF and SRDF


@dataclass(frozen=True)
class RobotSource:
    """What a robot description is made of besides its own file."""

    roots: Sequence[Path] = ()  # folders in which packages are looked up
    arguments: Mapping[str, str] = field(default_factory=dict)  # values of xacro arguments by name
    search: Sequence[Path] = ()
    """Further folders in which packages may be found; of these folders, nothing but those packages is read."""


@dataclass(frozen=True, eq=False)
class RobotXml:
    """A robot description as XML."""

    robot: Element  # its `<robot>`, without xacro
    expanded: str | None  # the same as text, if it was expanded from xacro
    content: bytes  # what its digest is of: the file, or what its xacro stands for
    packages: tuple[str, ...] = ()  # the packages that its xacro names
    warnings: tuple[Problem, ...] = ()  # those that the file itself gives
    is_mjcf: bool = False  # whether it is one that stands for a URDF


_OLD_TAGS = frozenset({"include", "macro", "property", "insert_block"})
"""Tags of xacro before 2014, without its prefix; those that are properties of the whole file are read all the same."""


def named_robot(path: Path, arguments: Mapping[str, str], hoped: str = "") -> tuple[str, Mapping[str, str]]:
    """The name of the robot in a URDF or SRDF, which is not expanded for it, and the arguments that give it that name.

    hoped: a name. Where an argument alone is the robot's name, launch files state it: then it gets this one, unless
    `arguments` has it. Raises InputError as `read_xml`.
    """
    root = parse_xml(path, read_input(path, MAX_BYTES), ROOT)
    stated = [one.attributes for one in root.inside() if one.tag == "xacro:arg" and "default" in one.attributes]
    defaults = {one.get("name", ""): one["default"] for one in stated}
    written = name = root.attributes.get("name", "").strip()
    used = {one: defaults[one] for one in _ARGUMENT.findall(written) if one in defaults and one != "name"}
    values = {**defaults, **arguments}
    for _ in range(MAX_DEPTH if "$(" in name else 0):
        name = _ARGUMENT.sub(lambda match: values.get(match[1], path.name.split(".")[0]), name)
    alone = _ARGUMENT.fullmatch(written)
    if alone and hoped not in ("", name) and alone[1] not in arguments:
        return hoped, {**arguments, alone[1]: hoped}
    return name, {**used, **arguments}  # xacro itself reads the name before the defaults below it


def read_robot_xml(path: Path, source: RobotSource | None = None, *, mjcf: bool = False) -> RobotXml:
    """A URDF or SRDF. A file with xacro elements is expanded, whatever its name.

    mjcf: whether an MJCF will do, too: as the URDF that it stands for. Raises InputError as `read_xml`, `_expanded` and
    `mjcf_as_urdf`, and for arguments of a file that is no xacro.
    """
    source = source or RobotSource()
    content = read_input(path, MAX_BYTES)
    root = parse_xml(path, content, None if mjcf and b"<mujoco" in content else ROOT)
    if any("${" in value or "$(" in value or one.tag.startswith("xacro:")
           for one in (root, *root.inside()) for value in ("", *one.attributes.values())):  # fmt: skip
        return _expanded(path, source)
    if source.arguments:
        message = f"this file has no xacro elements, so it takes no arguments; found {first_names(source.arguments)}"
        mend = "leave the arguments out, or name the .xacro file"
        raise bad_input("xacro-argument", message, root.place, mend=mend)
    if root.tag == ROOT:
        return RobotXml(root, None, content)
    told, warnings = mjcf_as_urdf(path, root)
    robot, text = _described(told, path)
    return RobotXml(robot, text, text.encode(), warnings=warnings, is_mjcf=True)


def _expanded(path: Path, source: RobotSource) -> RobotXml:
    """The `<robot>` that a xacro file stands for.

    Every element has the place where it is written, in this file or an included one. Raises InputError, with that
    place, for whatever prevents it: a wrong expression, an unknown macro or argument, a file that is missing or outside
    the known folders, too much work or memory. Also if the library is not installed.
    """
    if find_spec("xacro") is None:
        message = "this is a xacro file, which needs the extra `xacro`"
        raise bad_input("missing-extra", message, Place(path), mend="pip install 'sqrp[xacro]'")
    asked = {"path": str(path), "arguments": dict(source.arguments),
             "roots": list(map(str, source.roots)), "search": list(map(str, source.search)),
             "seconds": MAX_SECONDS, "memory": MAX_MEMORY}  # fmt: skip
    code = f"import sys; sys.path[:] = {[entry for entry in sys.path if entry]!r}; "
    code += "from sqrp_cli.robot.xacro_child import main; main()"
    command = [sys.executable, "-I", "-B", "-c", code]
    try:
        done = subprocess.run(  # noqa: S603 - no shell, and of this program alone
            command, input=json.dumps(asked).encode(), capture_output=True, env={}, timeout=MAX_WAIT, check=False
        )
        found = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError) as error:
        message = "expanding this file takes too much time or memory: a macro or an expression may lead back to itself"
        raise bad_input("xacro", message, Place(path)) from error
    known: dict[str, str | None] = found.get("asked", {})
    *warnings, problem = (
        one
        and Problem(**{**one, "place": one["place"] and Place(**{**one["place"], "file": Path(one["place"]["file"])})})
        for one in (*found.get("warnings", ()), found.get("problem"))
    )
    if problem is not None:
        if problem.mend is None and known:  # a missing file often follows from an argument
            given = [f"{name} ({source.arguments.get(name, default)})" if default is not None else name
                     for name, default in [*known.items()][:12]]  # fmt: skip
            problem = replace(problem, mend=f"the file's arguments, with their values: {', '.join(given)}")
        raise InputError(problem)
    for name in source.arguments:
        if name not in known:
            message = f"the file takes no argument `{name}`; {expected_names(name, known)}"
            raise bad_input("xacro-argument", message, Place(path))
    root, text = _described(found["root"], path)
    if root.tag != ROOT:
        raise root.error("wrong-root", f"the file begins with <{root.tag}>, expected <{ROOT}>")
    old = next((child for child in root.children if child.tag in _OLD_TAGS), None)
    if old is not None:
        message = f"{old} is of xacro before 2014 and has no meaning in a URDF, expected <xacro:{old.tag}>"
        raise bad_input("xacro", message, old.place, mend=f"write `xacro:{old.tag}`")
    return RobotXml(root, text, text.encode(), (*found["packages"],), (*warnings,))


def _described(told: list[Any], path: Path) -> tuple[Element, str]:
    """A description as `_element` takes it, and as XML; path: of what has no place of its own."""
    lines = list[str]()
    return _element(told, 0, lines, path), "\n".join(lines) + "\n"


def _element(told: list[Any], depth: int, lines: list[str], path: Path) -> Element:
    """An element as the other process tells it; lines: gets it as XML, with attributes in alphabetical order."""
    from xml.sax.saxutils import quoteattr  # loads much of the network's library, and few descriptions are expanded

    tag, attributes, file, line, column, children = told
    place, indent = Place(Path(file or path), line, column), "  " * depth
    if depth > MAX_DEPTH:
        raise bad_input("nesting-too-deep", f"elements are nested deeper than {MAX_DEPTH} levels", place)
    shown = "".join(f" {name}={quoteattr(value)}" for name, value in sorted(attributes.items()))
    lines.append(f"{indent}<{tag}{shown}{'' if children else '/'}>")
    element = Element(tag, attributes, place, [_element(child, depth + 1, lines, path) for child in children])
    lines += [f"{indent}</{tag}>"] if children else []
    return element
