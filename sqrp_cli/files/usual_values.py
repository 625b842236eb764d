"""Usual ranges of numbers in files, which `usual_values.yaml` lists: a number outside gets a warning, and is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import radians
from pathlib import Path
from typing import NamedTuple

from sqrp_cli.errors import Problem
from sqrp_cli.files.source import KeyPath, SourceDocument
from sqrp_cli.files.units import ANGLE, Dimension, in_unit, meant_instead, read_quantity
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.records import dataclass

ROWS = Path(__file__).with_name("usual_values.yaml")


@dataclass(frozen=True)
class Usual:
    """The usual range of a field."""

    at: str
    """Its dotted path, with `*` and `*{key}` as that file says."""
    least: float
    most: float
    """In SI units."""
    dimension: Dimension | None
    why: str
    """Why a value beyond them is doubtful."""

    def __str__(self) -> str:
        return f"{in_unit(self.least, self.dimension)} to {in_unit(self.most, self.dimension)}"


def _read_rows() -> Iterator[tuple[Usual, ...]]:
    """The rows of each kind of file."""
    for entries in read_yaml(ROWS).data.values():
        rows = []
        for entry in entries:
            bounds = [found for key in ("least", "most") if (found := read_quantity(entry[key])) is not None]
            least, most = bounds
            row = Usual("", least.value, most.value, least.dimension, entry["why"])
            rows += [replace(row, at=at) for at in entry["at"].split()]
        yield tuple(rows)


WORKSPACE, SKILL, CALIBRATION, HAND_EYE = _read_rows()

FIELD_OF_VIEW = next(row for row in WORKSPACE if row.at == "cameras.*.image.horizontal_fov")
"""Also applies to the angle that follows from `fx` or a calibration."""

FISHEYE_VIEW = Usual("", radians(1.0), radians(360), ANGLE, "an equidistant lens shows all around at most")
"""The angle that follows from `fx` of an equidistant lens, without its distortion; in no file."""

MOST_STRETCHED = 2.0  # largest usual ratio of a camera's two focal lengths


def unusual_values(document: SourceDocument, usual: Sequence[Usual]) -> Iterator[Problem]:
    """Warnings about numbers outside the usual ranges, one for each list."""
    warned: set[KeyPath] = set()
    for path, value, row in rows_that_apply(document, usual):
        owner = path[:-1] if isinstance(path[-1], int) else path
        read = read_quantity(value)
        if read is None or row.least <= read.value <= row.most or owner in warned:
            continue
        warned.add(owner)
        code, message, mend = (
            "unusual-value",
            f"found `{value}`, usual is {row}: {row.why}",
            "check the number and its unit",
        )
        if (meant := meant_instead(value, row.dimension, row.least, row.most)) is not None:
            code, message, mend = "doubtful-unit", f"{message}; {meant}", f"write `{meant.stated}` or {meant.value:.4g}"
        yield replace(document.problem(code, path, message, mend), severity="warning")


class RatedValue(NamedTuple):
    """A value of a document, with the first row that applies to it."""

    path: KeyPath
    value: object
    usual: Usual


def rows_that_apply(document: SourceDocument, usual: Sequence[Usual]) -> Iterator[RatedValue]:
    """The values that a row applies to."""

    def walk(value: object, rows: _Rows, path: KeyPath) -> Iterator[RatedValue]:
        if not isinstance(value, Mapping | list):
            if rows.row is not None:
                yield RatedValue(path, value, rows.row)
            return
        for key, child in value.items() if isinstance(value, Mapping) else enumerate(value):
            for step, inner in rows.items():
                wanted = step[2:-1] if step.startswith("*") else ""
                meant = not wanted or (isinstance(child, Mapping) and child.get(wanted) not in (None, False, "world"))
                if (step == key) if not step.startswith("*") else meant:
                    yield from walk(child, inner, (*path, key))

    found: dict[KeyPath, RatedValue] = {}
    for path, value, row in walk(document.data, _tree(tuple(usual)), ()):
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
            found.setdefault(one, RatedValue(one, stated, row))
    yield from found.values()


class _Rows(dict[str, "_Rows"]):
    """Rows by the steps of their paths, in order."""

    row: Usual | None = None


@cache
def _tree(usual: tuple[Usual, ...]) -> _Rows:
    root = _Rows()
    for row in usual:
        node = root
        for step in row.at.split("."):
            node = node.setdefault(step, _Rows())
        node.row = row
    return root
