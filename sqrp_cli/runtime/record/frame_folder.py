"""A folder of frames: the images of a run, or of a real cell, that can be audited.

It has a file `frames.csv` with the columns `camera`, `file` (a PNG beside it), `step` (from 1) and `t`
(seconds since the step's motion began; empty where the step did not go as planned), one row per image, in order.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import InputError, Place, bad_input, expected_names
from sqrp_cli.knowledge.text.input_file import NOT_THERE, missing_file, read_text
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import LONGEST, as_number
from sqrp_cli.platform.files import make_folder, naming
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.record.png import png_of

INDEX = "frames.csv"
"""The file that lists the frames of a folder."""

_FILE = f"this file is no recording; expected an MCAP file, a bag of ROS, or a folder with {INDEX}"

_COLUMNS = ("camera", "file", "step", "t")

MAX_INDEX = 100_000_000
"""Largest index of a folder of frames that is read [bytes]."""

LONGEST_NAME = 60
"""Most characters of a name, or of a number, that is compared with others."""


@dataclass(frozen=True)
class FrameEntry:
    """A row of a folder's index."""

    camera: str
    file: Path
    step: int
    t: float | None
    """Of the step [s], None where it did not go as planned."""


class FrameFolder:
    """Writes the images of a run into a folder."""

    def __init__(self, folder: Path) -> None:
        """folder: is made if it does not exist. Raises InputError if it cannot be, or is not empty."""
        make_folder(folder)
        if any(folder.iterdir()):
            message = "this folder is not empty, and nothing is ever overwritten; expected the name of a new folder"
            raise bad_input("not-empty", message, Place(folder))
        self._folder, self._index = folder, folder / INDEX
        with naming(self._index):
            self._file = self._index.open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file)
        self._rows.writerow(_COLUMNS)
        self._count = 0

    def add(self, frame: CameraImage, step: int, t: float | None) -> None:
        """Keep an image that was taken at time t [s] of a step."""
        name = f"{frame.camera}-{self._count:06d}.png"
        self._count += 1
        with naming(self._folder / name):
            (self._folder / name).write_bytes(png_of(frame.image))
        with naming(self._index):
            self._rows.writerow([frame.camera, name, step, "" if t is None else f"{t:.6f}"])

    def close(self) -> None:
        """Finish the index."""
        with naming(self._index):
            self._file.close()


def read_frames(folder: Path, cameras: Sequence[str], steps: int) -> Iterator[FrameEntry]:
    """The rows of a folder's index. Raises InputError for one that is missing or wrong, with its line."""
    path = folder / INDEX
    if folder.is_file():
        raise bad_input("no-frames", _FILE, Place(folder))
    if not folder.exists():
        raise InputError(missing_file(folder))
    if not path.is_file():
        message = f"there is no {INDEX} in this folder, and no metadata.yaml of a rosbag2; expected one of them"
        raise bad_input("no-frames", message, Place(folder))
    rows = csv.reader(io.StringIO(table_text(path), newline=""))
    try:
        _check_header(next(rows, []), Place(path, 1))
        for row in rows:
            if row:
                yield _entry(row, folder, cameras, steps, Place(path, rows.line_num))
    except csv.Error as error:
        raise bad_input("wrong-value", f"this is no CSV: {error}", Place(path, rows.line_num)) from error


def table_text(path: Path) -> str:
    """The text of a CSV file beside frames. Raises InputError where it is none."""
    text = read_text(path, MAX_INDEX)
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise bad_input("wrong-value", "this is no CSV: it has a NUL character", Place(path, line))
    return text


def _check_header(header: Sequence[str], place: Place) -> None:
    if not header:
        message = f"this file is empty: the run was stopped before it kept an image; expected `{', '.join(_COLUMNS)}`"
        raise bad_input("wrong-columns", message, place, mend="record again: sqrp run PROGRAM --sim --frames DIR")
    if tuple(header) != _COLUMNS:
        # What has none of them may be another file, linked here to see what it says.
        found = f"`{', '.join(header)}`" if {*header} & {*_COLUMNS} else "others"
        raise bad_input("wrong-columns", f"the columns are {found}, expected `{', '.join(_COLUMNS)}`", place)


def _entry(row: Sequence[str], folder: Path, cameras: Sequence[str], steps: int, place: Place) -> FrameEntry:
    if len(row) != len(_COLUMNS):
        message = f"this row has {len(row)} columns, expected {len(_COLUMNS)}: {', '.join(_COLUMNS)}"
        raise bad_input("wrong-columns", message, place)
    camera, name, step, t = row
    if camera not in cameras:
        message = f"there is no camera {describe(camera)}; {expected_names(camera[:LONGEST_NAME], cameras)}"
        raise bad_input("unknown-camera", message, place)
    return FrameEntry(camera, file_in(folder, name, place), _step(step, steps, place), _seconds(t, place))


def file_in(folder: Path, name: str, place: Place) -> Path:
    """A file of the folder, also after following all links. Raises InputError, at the place of its name, for others."""
    path = folder / name
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        message = f"the file {describe(name)} is not in this folder; expected a path that does not leave it"
        raise bad_input("outside-folder", message, place)
    if not os.path.isfile(path):  # noqa: PTH113 - Path.is_file raises for a name that is too long
        raise bad_input("missing-file", f"{describe(name)}: {NOT_THERE}", place)
    return path


def _step(text: str, steps: int, place: Place) -> int:
    number = int(text) if text.isdecimal() and len(text) < LONGEST_NAME else 0
    if not 1 <= number <= steps:
        message = f"`step` is {describe(text)}, expected a whole number from 1 to {steps}, the steps of the program"
        raise bad_input("wrong-value", message, place)
    return number


def _seconds(text: str, place: Place) -> float | None:
    t = as_number(text) if text else 0.0
    if not 0.0 <= t <= LONGEST:
        message = f"`t` is {describe(text)}, expected seconds from 0 to {LONGEST:g}, or nothing"
        raise bad_input("wrong-value", message, place)
    return t if text else None
