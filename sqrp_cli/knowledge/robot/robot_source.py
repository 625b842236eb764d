"""Records about the XML of robot descriptions: what it is made of, and what it is once expanded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.text.xml_file import Element

ROOT = "robot"
"""The root element of URDF and SRDF."""


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


def as_text(root: Element) -> str:
    """An element as XML, each within it on a line of its own, with attributes in alphabetical order."""
    return "\n".join(_lines(root, 0)) + "\n"


def _lines(element: Element, depth: int) -> Iterator[str]:
    from xml.sax.saxutils import quoteattr  # loads much of the network's library, and few descriptions are expanded

    attributes = "".join(f" {name}={quoteattr(value)}" for name, value in sorted(element.attributes.items()))
    start = f"{'  ' * depth}<{element.tag}{attributes}"
    if not element.children:
        yield f"{start}/>"
        return
    yield f"{start}>"
    for child in element.children:
        yield from _lines(child, depth + 1)
    yield f"{'  ' * depth}</{element.tag}>"
