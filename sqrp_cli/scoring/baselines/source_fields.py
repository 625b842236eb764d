"""What the files of a workspace say, field by field, so that two versions of them can be compared."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.text.source import LeafValue
from sqrp_cli.knowledge.text.units import read_quantity
from sqrp_cli.knowledge.text.xml_file import Element, read_xml
from sqrp_cli.knowledge.text.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.knowledge.workspace.workspace import Workspace

Fields = dict[str, LeafValue]

_SECTION = re.compile(r":(requirements|types|constants|predicates|functions|action|parameters|precondition|effect)\b")

_FOR_ALL_JOINTS = re.compile(r"robot\.limits\.\w+")
"""A limit whose unit says which joints it is for: those that turn, or those that slide; without one it is for all."""

WORKSPACE = "workspace"
"""The role of the workspace file itself."""


def fields_of(workspace: Workspace, role: str) -> Fields:
    """The fields of the file that plays a role; none for a file that has no fields to name, such as a mesh."""
    if role == WORKSPACE:
        return dict(workspace.values)
    path = workspace.files[role].path
    try:
        match path.suffix.lower():
            case ".yaml" | ".yml":
                return dict(read_yaml(path, frozenset({"!!opencv-matrix"})).leaves)
            case ".urdf" | ".srdf":
                return dict(_attributes(read_xml(path, "robot"), ""))
            case ".pddl":
                return dict(_statements(path))
            case _:
                return {}
    except InputError:  # changed since it was read
        return {}


def _attributes(element: Element, path: str) -> Iterator[tuple[str, LeafValue]]:
    """Attributes by where they stand: elements by name where they have one, else by number where there are several."""
    for attribute, value in element.attributes.items():
        yield f"{path}{attribute}", value
    numbers: Counter[str] = Counter()
    counts = Counter(child.tag for child in element.children)
    for child in element.children:
        numbers[child.tag] += 1
        number = f".{numbers[child.tag]}" if counts[child.tag] > 1 else ""
        label = f".{child.attributes['name']}" if child.attributes.get("name") else number
        yield from _attributes(child, f"{path}{child.tag}{label}.")


def _statements(path: Path) -> Iterator[tuple[str, LeafValue]]:
    """The sections of a PDDL file, those of an action by its name; without comments and layout."""
    lines = (line.split(";")[0] for line in read_input(path, MAX_BYTES).decode(errors="replace").splitlines())
    words = " ".join(" ".join(lines).replace("(", " (").replace(")", ") ").split())
    action = ""
    for keyword, content in zip(*[iter(_SECTION.split(words)[1:])] * 2, strict=True):
        text = content.replace(" )", ")").rstrip(" (").lstrip()
        while text.count(")") > text.count("("):
            text = text[:-1].rstrip()  # what closes the sections around
        if keyword == "action":
            action = f"{text}."
        else:
            yield f"{action}{keyword}", text


def changed_fields(
    before: Mapping[str, LeafValue], now: Mapping[str, LeafValue]
) -> Iterator[tuple[str, LeafValue, LeafValue]]:
    """The fields that differ, with both values; None where a field is not there.

    Two spellings of a quantity, such as `5 cm` and `50 mm` or 0.05, do not differ, nor do `0 0 1` and `0 0 1.0`.
    """
    for field in dict.fromkeys((*before, *now)):
        old, new = before.get(field), now.get(field)
        if old != new and not _same_quantity(field, old, new) and not _same_numbers(old, new):
            yield field, old, new


def _same_numbers(before: LeafValue, now: LeafValue) -> bool:
    """Whether two attributes of an XML file are the same row of numbers."""
    try:
        old, new = ([float(word) for word in str(value).split()] for value in (before, now))
    except ValueError:
        return False
    return old == new


def _same_quantity(field: str, before: LeafValue, now: LeafValue) -> bool:
    old, new = read_quantity(before), read_quantity(now)
    if old is None or new is None or not math.isclose(old.value, new.value, rel_tol=1e-12):
        return False
    if None in (old.dimension, new.dimension) and not _FOR_ALL_JOINTS.fullmatch(field):
        return True
    return old.dimension is new.dimension
