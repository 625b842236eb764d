"""The XML of robot descriptions, URDF and SRDF: plain, or expanded from xacro."""

from __future__ import annotations

from pathlib import Path

from sqrp_cli.errors import bad_input
from sqrp_cli.knowledge.robot.robot_source import ROOT, RobotSource, RobotXml
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.text.xml_file import MAX_BYTES, Element, parse_xml

_OLD_TAGS = frozenset({"include", "macro", "property", "insert_block"})
"""Tags of xacro before 2014, without its prefix; those that are properties of the whole file are read all the same."""


def read_robot_xml(path: Path, source: RobotSource | None = None) -> RobotXml:
    """A URDF or SRDF. A file with xacro elements is expanded, whatever its name.

    Raises InputError as `read_xml` and `expand`, and for arguments of a file that is no xacro.
    """
    source = source or RobotSource()
    content = read_input(path, MAX_BYTES)
    root = parse_xml(path, content, ROOT)
    if not has_xacro(root):
        if source.arguments:
            named = ", ".join(f"`{name}`" for name in source.arguments)
            message = f"this file has no xacro elements, so it takes no arguments; found {named}"
            mend = "leave the arguments out, or name the .xacro file"
            raise bad_input("xacro-argument", message, root.place, mend=mend)
        return RobotXml(root, None, content)
    from sqrp_cli.knowledge.robot.xacro_file import expand

    expanded = expand(path, source)
    _refuse_old(expanded.root)
    return expanded


def has_xacro(element: Element) -> bool:
    """Whether an element or one within it is of xacro, or has an attribute that xacro replaces."""
    return (
        element.tag.startswith("xacro:")
        or any("${" in value or "$(" in value for value in element.attributes.values())
        or any(has_xacro(child) for child in element.children)
    )


def _refuse_old(root: Element) -> None:
    old = next((child for child in root.children if child.tag in _OLD_TAGS), None)
    if old is not None:
        message = f"{old} is of xacro before 2014 and has no meaning in a URDF, expected <xacro:{old.tag}>"
        raise bad_input("xacro", message, old.place, mend=f"write `xacro:{old.tag}`")
