"""The XML of robot descriptions, URDF and SRDF: plain, or expanded from xacro."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.text.xml_file import MAX_BYTES, Element, parse_xml

ROOT = "robot"

_OLD_TAGS = frozenset({"include", "macro", "property", "insert_block"})
"""Tags of xacro before 2014, without its prefix."""


@dataclass(frozen=True)
class RobotSource:
    """What a robot description is made of besides its own file."""

    roots: Sequence[Path] = ()
    """Folders in which packages are looked up."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Values of xacro arguments by name."""
    search: Sequence[Path] = ()
    """Further folders in which packages may be found; of these folders, nothing but those packages is read."""


@dataclass(frozen=True, eq=False)
class RobotXml:
    """A robot description as XML."""

    root: Element
    """Its `<robot>`, without xacro."""
    expanded: str | None
    """The same as text, if it was expanded from xacro."""
    content: bytes
    """What its digest is of: the file, or what its xacro stands for."""
    packages: tuple[str, ...] = ()
    """The packages that its xacro names."""
    warnings: tuple[Problem, ...] = ()
    """Those that the file itself gives."""


def read_robot_xml(path: Path, source: RobotSource | None = None) -> RobotXml:
    """A URDF or SRDF. A file with xacro elements is expanded, whatever its name.

    Raises InputError as `read_xml` and `expand`, and for arguments of a file that is no xacro.
    """
    source = source or RobotSource()
    content = read_input(path, MAX_BYTES)
    root = parse_xml(path, content, ROOT)
    if not has_xacro(root):
        if source.arguments:
            raise InputError(_takes_none(root.place, source.arguments))
        return RobotXml(root, None, content)
    from sqrp_cli.knowledge.robot.xacro_file import expand

    expanded = expand(path, content, source)
    _refuse_old(expanded.root)
    return expanded


def has_xacro(element: Element) -> bool:
    """Whether an element or one within it is of xacro, or has an attribute that xacro replaces."""
    return (
        element.tag.startswith("xacro:")
        or any("${" in value or "$(" in value for value in element.attributes.values())
        or any(has_xacro(child) for child in element.children)
    )


def as_text(root: Element) -> str:
    """An element as XML, each within it on a line of its own, with attributes in alphabetical order."""
    return "\n".join(_lines(root, 0)) + "\n"


def _lines(element: Element, depth: int) -> Iterator[str]:
    attributes = "".join(f" {name}={quoteattr(value)}" for name, value in sorted(element.attributes.items()))
    start = f"{'  ' * depth}<{element.tag}{attributes}"
    if not element.children:
        yield f"{start}/>"
        return
    yield f"{start}>"
    for child in element.children:
        yield from _lines(child, depth + 1)
    yield f"{'  ' * depth}</{element.tag}>"


def _takes_none(place: Place, arguments: Mapping[str, str]) -> Problem:
    named = ", ".join(f"`{name}`" for name in arguments)
    message = f"this file has no xacro elements, so it takes no arguments; found {named}"
    return Problem("xacro-argument", message, place, mend="leave the arguments out, or name the .xacro file")


def _refuse_old(root: Element) -> None:
    old = next((child for child in root.children if child.tag in _OLD_TAGS), None)
    if old is not None:
        message = f"{old} is of xacro before 2014 and has no meaning in a URDF, expected <xacro:{old.tag}>"
        raise InputError(Problem("xacro", message, old.place, mend=f"write `xacro:{old.tag}`"))
