"""Frames with a file of labels: what stands where in each image, measured by whoever took it.

`labels.csv` has a row for each object in each image: `camera`, `file` (a PNG beside it), `object`, its pose in the
world (`x`, `y`, `z` in metres, `qx`, `qy`, `qz`, `qw`), and if wanted `detector` (which looks for it; empty: it only
stands there), `there` (`no`: it was taken away, and the pose is where it would be), `vx`, `vy`, `vz` (its velocity in
m/s).
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from sqrp_cli.errors import Place, bad_input, expected_names
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import LARGEST
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.runtime.record.frame_folder import LONGEST_NAME, file_in, table_text

LABELS = "labels.csv"
"""The file of labels in a folder of frames."""

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_REQUIRED = ("camera", "file", "object", *_POSE)
_VELOCITY = ("vx", "vy", "vz")
_COLUMNS = (*_REQUIRED, "detector", "there", *_VELOCITY)


@dataclass(frozen=True, eq=False, kw_only=True)
class Label:
    """A row of the file: an object in an image."""

    camera: str
    file: Path
    object: str
    X_WO: Array
    """Where it is, or would be, shape (4, 4)."""
    velocity: Array
    """Shape (3,) [m/s]."""
    detector: str | None
    """That looks for it; None if it only stands there."""
    there: bool
    """Whether it really is there."""


def read_labels(folder: Path, workspace: Workspace) -> Iterator[Label]:
    """The rows of a folder's labels. Raises InputError for a file that is wrong, with its line."""
    path = folder / LABELS
    rows = csv.DictReader(io.StringIO(table_text(path), newline=""), strict=True)
    try:
        columns = rows.fieldnames or ()
        for name in (*columns, *_REQUIRED):
            if name not in _COLUMNS:
                message = f"there is a column {describe(name)}; {expected_names(name[:LONGEST_NAME], _COLUMNS)}"
                raise bad_input("wrong-columns", message, Place(path, 1))
            if name not in columns:
                message = f"there is no column `{name}`; expected {', '.join(_REQUIRED)}"
                raise bad_input("wrong-columns", message, Place(path, 1))
        for row in rows:
            yield _LabelRow(row, Place(path, rows.reader.line_num)).label(folder, workspace)
    except csv.Error as error:
        raise bad_input("wrong-value", f"this is no CSV: {error}", Place(path, rows.reader.line_num)) from error


@dataclass(frozen=True, eq=False)
class _LabelRow:
    values: Mapping[str | None, str | None]
    place: Place

    def label(self, folder: Path, workspace: Workspace) -> Label:
        if None in self.values or None in self.values.values():
            self._refuse("wrong-columns", "this row does not have one value for each column")
        numbers = np.array([self._number(name) for name in _POSE])
        if abs(math.hypot(*numbers[3:]) - 1.0) > 0.01:
            length = math.hypot(*numbers[3:])
            self._refuse("not-a-rotation", f"`qx` to `qw` have length {length:.3g}, expected 1 (order x, y, z, w)")
        detector, there = self._text("detector") or None, self._text("there") or "yes"
        if there not in ("yes", "no"):
            self._refuse("wrong-value", f"`there` is {describe(there)}, expected `yes` or `no`")
        if detector is not None:
            self._known("detector", workspace.detectors)
        self._known("camera", workspace.cameras)
        self._known("object", {n: o for n, o in workspace.objects.items() if o.X_WO is not None})
        return Label(
            camera=self._text("camera"),
            file=file_in(folder, self._text("file"), self.place),
            object=self._text("object"),
            X_WO=pose(quaternion_to_matrix(numbers[3:] / math.hypot(*numbers[3:])), numbers[:3]),
            velocity=np.array([self._number(name) if self._text(name) else 0.0 for name in _VELOCITY]),
            detector=detector,
            there=there == "yes",
        )

    def _text(self, name: str) -> str:
        return (self.values.get(name) or "").strip()

    def _known(self, column: str, names: Mapping[str, object]) -> None:
        found = self._text(column)
        if found not in names:
            message = f"there is no {column} {describe(found)}; {expected_names(found[:LONGEST_NAME], names)}"
            self._refuse(f"unknown-{column}", message)

    def _number(self, name: str) -> float:
        text = self._text(name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= LARGEST:
            self._refuse(
                "wrong-value", f"`{name}` is {describe(text)}, expected a number of at most {LARGEST:g} in size"
            )
        return value

    def _refuse(self, code: str, message: str) -> NoReturn:
        raise bad_input(code, message, self.place)
