"""Usual ranges of numbers in files, which `usual_values.yaml` lists: a number outside gets a warning, and is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import radians
from pathlib import Path

from sqrp_cli.errors import Problem
from sqrp_cli.files.source import Data, KeyPath, SourceDocument
from sqrp_cli.files.units import ANGLE, Dimension, in_unit, meant_instead, read_quantity
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.records import dataclass

ROWS = Path(__file__).with_name("usual_values.yaml")


@dataclass(frozen=True)
class Usual:
    """The usual range of a field."""

    at: str  # Its dotted path, with `*` and `*{key}` as that file says
    least: float
    most: float  # In SI units
    dimension: Dimension | None
    why: str  # Why a value beyond them is doubtful

    def __str__(self) -> str:
        return f"{in_unit(self.least, self.dimension)} to {in_unit(self.most, self.dimension)}"


def _rows(entries: Sequence[Mapping[str, str]]) -> tuple[Usual, ...]:
    """The rows of a kind of file."""
    rows = []
    for entry in entries:
        least, most = (found for key in ("least", "most") if (found := read_quantity(entry[key])) is not None)
        row = Usual("", least.value, most.value, least.dimension, entry["why"])
        rows += [replace(row, at=at) for at in entry["at"].split()]
    return tuple(rows)


WORKSPACE, SKILL, CALIBRATION, HAND_EYE = map(_rows, read_yaml(ROWS).data.values())
FIELD_OF_VIEW = next(row for row in WORKSPACE if row.at == "cameras.*.image.horizontal_fov")
"""Also applies to the angle that follows from `fx` or a calibration."""
FISHEYE_VIEW = Usual("", radians(1.0), radians(360), ANGLE, "an equidistant lens shows all around at most")
"""The angle that follows from `fx` of an equidistant lens, without its distortion; in no file."""
MOST_STRETCHED = 2.0  # largest usual ratio of a camera's two focal lengths


def unusual_values(document: SourceDocument, usual: Sequence[Usual]) -> Iterator[Problem]:
    """Warnings about numbers outside the usual ranges, one for each list."""
    warned: set[KeyPath] = set()
    for path, (value, row) in rows_that_apply(document, usual).items():
        owner = path[:-1] if isinstance(path[-1], int) else path
        read = read_quantity(value)
        if read is None or row.least <= read.value <= row.most or owner in warned:
            continue
        warned.add(owner)
        code, mend = "unusual-value", "check the number and its unit"
        message = f"found `{value}`, usual is {row}: {row.why}"
        if (meant := meant_instead(value, row.dimension, row.least, row.most)) is not None:
            code, message, mend = "doubtful-unit", f"{message}; {meant[0]}", f"write {meant[1]}"
        yield replace(document.problem(code, path, message, mend), severity="warning")


def rows_that_apply(document: SourceDocument, usual: Sequence[Usual]) -> dict[KeyPath, tuple[object, Usual]]:
    """The values that a row applies to, by their paths, each with the first row that does."""
    tree: Data = {}  # of the steps of paths, in order; the row itself has no step
    for row in usual:
        node = tree
        for step in row.at.split("."):
            node = node.setdefault(step, {})
        node[""] = row

    def walk(value: object, rows: Data, path: KeyPath) -> Iterator[tuple[KeyPath, object, Usual]]:
        if not isinstance(value, Mapping | list):
            if "" in rows:
                yield path, value, rows[""]
            return
        for key, child in value.items() if isinstance(value, Mapping) else enumerate(value):
            for step, inner in rows.items():
                wanted = step[2:-1] if step.startswith("*") else ""
                meant = not wanted or (isinstance(child, Mapping) and child.get(wanted) not in (None, False, "world"))
                if (step == key) if not step.startswith("*") else meant:
                    yield from walk(child, inner, (*path, key))

    found: dict[KeyPath, tuple[object, Usual]] = {}
    for path, value, row in walk(document.data, tree, ()):
        used: list[tuple[KeyPath, object]] = [(path, value)]
        if isinstance(value, str) and value.startswith("$"):  # the values of the motion parameter that it names
            motion: KeyPath = ("motion", value[1:])
            entry = document.data["motion"][value[1:]]
            if not isinstance(entry, Mapping):
                used = [(motion, entry)]
            elif "values" in entry:
                used = [((*motion, "values", index), listed) for index, listed in enumerate(entry["values"])]
            else:
                used = [((*motion, key), entry[key]) for key in ("from", "to")]
        for one, stated in used:
            found.setdefault(one, (stated, row))
    return found
