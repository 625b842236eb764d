"""Changes of a workspace since its baseline: files, and fields in them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.text.source import LeafValue
from sqrp_cli.knowledge.text.units import read_quantity
from sqrp_cli.knowledge.text.xml_file import Element, parse_xml, read_xml
from sqrp_cli.knowledge.text.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.scoring.work.identity import says_something

_SECTION = re.compile(r":(requirements|types|constants|predicates|functions|action|parameters|precondition|effect)\b")

_FOR_ALL_JOINTS = re.compile(r"robot\.limits\.\w+")
"""A limit; its unit says whether it is for turning or sliding joints; without a unit it is for all."""

WORKSPACE = "workspace"
"""The role of the workspace file itself."""


@dataclass(frozen=True)
class Change:
    """A difference between two versions of a workspace."""

    file: str
    """The role of the file that changed, such as `workspace`, `robot.urdf` or `skills.pickup.yaml`."""
    field: str | None
    """The field in it; None if only the whole content can be compared."""
    before: LeafValue
    """The value, or for a whole file the first digits of its digest; None if there is no such field or file."""
    now: LeafValue
    """See `before`."""

    def __str__(self) -> str:
        what = "content" if self.field is None else self.field
        where = what if self.file == WORKSPACE else f"{self.file} {what}"
        if self.before is None:
            return f"{where} = {self.now} is new"
        if self.now is None:
            return f"{where} = {self.before} is gone"
        return f"{where}: {self.before} -> {self.now}"


def workspace_changes(
    digest: str, before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> tuple[Change, ...]:
    """The differences that may matter; none if `digest`, of what was understood before, is the same.

    before: the digest of each file by its role. known: fields of files by digest. Tasks and their thresholds are not
    compared.
    """
    return () if digest == now.digest else tuple(_changes(before, known, now))


def _changes(
    before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> Iterator[Change]:
    digests = {role: file.digest for role, file in now.files.items()}
    for role in sorted({*before, *digests}, key=lambda role: (role != WORKSPACE, role)):
        old, new = before.get(role), digests.get(role)
        if old == new:
            continue
        fields = fields_of(now, role) if new is not None else {}
        if old is None or new is None or not (known.get(old) and fields):
            yield Change(file=role, field=None, before=old and old[:12], now=new and new[:12])
        else:
            yield from _changed_fields(role, known[old], fields)


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


def _changed_fields(role: str, before: Mapping[str, LeafValue], now: Mapping[str, LeafValue]) -> Iterator[Change]:
    """The fields of a file that differ in meaning.

    Two spellings of a quantity, such as `5 cm` and `50 mm` or 0.05, do not differ, nor do `0 0 1` and `0 0 1.0`.
    """
    for field in dict.fromkeys((*before, *now)):
        old, new = before.get(field), now.get(field)
        same = old == new or _same_quantity(field, old, new) or _same_numbers(old, new)
        if not same and (role != WORKSPACE or says_something(field)):
            yield Change(file=role, field=field, before=old, now=new)


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
