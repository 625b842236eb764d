"""What changed in a workspace since a baseline: its files, and the fields in them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import LeafValue
from sqrp_cli.files.units import read_quantity
from sqrp_cli.files.xml_file import Element, parse_xml, read_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.score.result import WORKSPACE, Change

_SECTION = re.compile(r":(requirements|types|constants|predicates|functions|action|parameters|precondition|effect)\b")

_FOR_ALL_JOINTS = re.compile(r"robot\.limits\.\w+")
"""A limit; its unit says whether it is for turning or sliding joints; without a unit it is for all."""

_FILE_KEYS = frozenset({"urdf", "srdf", "mesh", "calibration", "hand_eye"})
"""Keys of a workspace file that name other files; the content of those counts, not their place."""


def workspace_changes(
    digest: str, before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> tuple[Change, ...]:
    """The differences that may matter; none if `digest`, of what was understood before, is the same.

    before: the digest of each file by its role. known: fields of files by digest. Tasks and their thresholds are not
    compared.
    """
    if digest == now.digest:
        return ()
    changes: list[Change] = []
    digests = {role: file.digest for role, file in now.files.items()}
    for role in sorted({*before, *digests}, key=lambda role: (role != WORKSPACE, role)):
        old, new = before.get(role), digests.get(role)
        if old == new:
            continue
        fields, said = fields_of(now, role) if new is not None else {}, known.get(old or "", {})
        if fields and said:
            pairs = ((field, said.get(field), fields.get(field)) for field in dict.fromkeys((*said, *fields)))
            changes += (Change(role, *pair) for pair in pairs if _differs(role, *pair))
        else:
            changes.append(Change(file=role, field=None, before=old and old[:12], now=new and new[:12]))
    return tuple(changes)


def fields_of(workspace: Workspace, role: str) -> dict[str, LeafValue]:
    """The fields of the file with a role; none for a file without fields, such as a mesh."""
    if role == WORKSPACE:
        return dict(workspace.values)
    path = workspace.files[role].path
    try:
        match path.suffix.lower():
            case ".yaml" | ".yml":
                return dict(read_yaml(path, frozenset({"!!opencv-matrix"})).leaves)
            case _ if role == "robot.urdf" and (expanded := workspace.robot.urdf.expanded) is not None:
                return dict(_attributes(parse_xml(path, expanded.encode(), "robot"), ""))
            case ".urdf" | ".srdf":
                return dict(_attributes(read_xml(path, "robot"), ""))
            case ".pddl":
                return dict(_statements(path))
            case _:
                return {}
    except InputError:  # changed since it was read
        return {}


def _attributes(element: Element, path: str) -> Iterator[tuple[str, LeafValue]]:
    """Attributes by path; elements go by name if they have one, else by number if there are several."""
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


def _differs(role: str, field: str, before: LeafValue, now: LeafValue) -> bool:
    """Whether a field of a file differs in meaning.

    Two spellings of a quantity, such as `5 cm` and `50 mm` or 0.05, do not differ, nor do `0 0 1` and `0 0 1.0`. In a
    workspace file nothing matters that belongs to a task, or names a file: the content of that does.
    """
    named = field.startswith(("tasks.", "skills.", "robot.package_roots.")) or field.rpartition(".")[-1] in _FILE_KEYS
    if before == now or (role == WORKSPACE and named):
        return False
    old, new = read_quantity(before), read_quantity(now)
    if old is not None and new is not None and math.isclose(old.value, new.value, rel_tol=1e-12):
        any_joint = None in (old.dimension, new.dimension) and not _FOR_ALL_JOINTS.fullmatch(field)
        if any_joint or old.dimension is new.dimension:
            return False
    try:  # attributes of an XML file may be rows of numbers
        rows = [[float(word) for word in str(value).split()] for value in (before, now)]
    except ValueError:
        return True
    return rows[0] != rows[1]
