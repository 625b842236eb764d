"""Keeps the images of a run: in a folder that can be audited, in a recording, and as a film with what was seen in them.

A folder of frames, of a run or of a real cell, has a file `frames.csv` with the columns `camera`, `file` (a PNG beside
it), `step` (from 1) and `t` (seconds since the step's motion began; empty where the step did not go as planned), one
row per image, in order.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sqrp_cli.errors import InputError, Place, bad_input, expected_names
from sqrp_cli.files.input_file import NOT_THERE, missing_file, read_text
from sqrp_cli.files.source import describe
from sqrp_cli.files.units import LONGEST, as_number
from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.platform.files import make_folder, naming
from sqrp_cli.run.image import SUBPIXEL, CameraImage, ImageArray, corners_of
from sqrp_cli.run.record.bag_recorder import BagRecorder
from sqrp_cli.run.record.packed_image import encoded

INDEX = "frames.csv"  # The file that lists the frames of a folder
_FILE = f"this file is no recording; expected an MCAP file, a bag of ROS, or a folder with {INDEX}"
_COLUMNS = ("camera", "file", "step", "t")
MAX_INDEX = 100_000_000  # Largest index of a folder of frames that is read [bytes]
LONGEST_NAME = 60  # Most characters of a name, or of a number, that is compared with others
_TILE = (320, 240)  # Width and height of a camera in a film [pixels]
_PAINT = {Truth.TRUE: (60, 220, 60), Truth.FALSE: (90, 160, 255), Truth.UNKNOWN: (240, 60, 60)}
Outlines = Iterable[tuple[Array, Truth]]
"""Outlines of boxes in an image (n, 2) [pixels], each with what the image shows of the box."""


class Film:
    """A film of all cameras side by side, boxes drawn in: green the object is seen, blue background, red neither."""

    def __init__(self, path: Path, cameras: Sequence[str], rate: float) -> None:
        """rate: images per second of the fastest camera. Raises InputError for a path that is not UTF-8."""
        if any("\ud800" <= character <= "\udfff" for character in str(path)):  # bytes that are not UTF-8
            raise bad_input("cannot-write", "OpenCV can write a film only to a path that is UTF-8", Place(path))
        self._path, self._rate = path, rate
        self._writer: Any = None
        self._count = 0
        self._tiles: dict[str, ImageArray] = {name: np.zeros((_TILE[1], _TILE[0], 3), np.uint8) for name in cameras}
        self._time: float | None = None

    def add(self, frame: CameraImage, outlines: Outlines, caption: str) -> None:
        """Show an image with what was seen in it."""
        if self._time is not None and frame.t > self._time:
            self._write()
        self._time = frame.t if self._time is None else max(self._time, frame.t)
        picture = drawn(frame.image, outlines, f"{frame.camera}  {frame.t:.1f} s  {caption}")
        self._tiles[frame.camera] = cv2.resize(picture, _TILE, interpolation=cv2.INTER_AREA)

    def close(self) -> None:
        """Finish the film. Raises InputError where it could not be written, which OpenCV's writer does not say."""
        self._write()
        self._writer.release()
        if round(cv2.VideoCapture(str(self._path)).get(cv2.CAP_PROP_FRAME_COUNT)) != self._count:
            message = "this film could not be written, or not as a whole; is the disk full?"
            raise bad_input("cannot-write", message, Place(self._path))

    def _write(self) -> None:
        """Append what the cameras show now."""
        tiles = list(self._tiles.values())
        columns = int(np.ceil(len(tiles) ** 0.5))
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
        mosaic = np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])
        if self._writer is None:
            size = (mosaic.shape[1], mosaic.shape[0])
            self._writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), self._rate, size)
        self._count += 1
        self._writer.write(cv2.cvtColor(mosaic, cv2.COLOR_RGB2BGR))


def drawn(image: ImageArray, outlines: Outlines, text: str) -> ImageArray:
    """A copy of an image with outlines in their colours, and a line of text."""
    canvas = image.copy()
    for polygon, truth in outlines:
        if len(polygon):
            cv2.polylines(canvas, [corners_of(polygon)], True, _PAINT[truth], 2, cv2.LINE_AA, SUBPIXEL)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


class ImageRecorder:
    """Passes the images of a run to a folder, a film and a recording."""

    def __init__(self, folder: Path | None, film: Any, bag: BagRecorder | None = None) -> None:  # noqa: ANN401
        """folder: is made if it does not exist. Raises InputError if it cannot be, or is not empty.

        film: a `Film`, or somebody who looks on, with `add` and `close` as it has them; None if nobody does.
        """
        self._folder, self._film, self._bag, self._count = folder, film, bag, 0
        self._waiting: dict[tuple[str, float], tuple[CameraImage, str]] = {}
        if folder is not None:
            make_folder(folder)
            if any(folder.iterdir()):
                message = "this folder is not empty, and nothing is ever overwritten; expected the name of a new folder"
                raise bad_input("not-empty", message, Place(folder))
            with naming(folder / INDEX):
                self._file = (folder / INDEX).open("w", newline="", encoding="utf-8")
            self._rows = csv.writer(self._file)
            self._rows.writerow(_COLUMNS)

    def add(self, frame: CameraImage, step: int, t: float | None, caption: str) -> None:
        """An image was taken at time t [s] of a step, while the robot did what the caption says."""
        if self._folder is not None:
            file = self._folder / f"{frame.camera}-{self._count:06d}.png"
            self._count += 1
            with naming(file):
                file.write_bytes(encoded(frame.image, "png"))
            with naming(self._folder / INDEX):
                self._rows.writerow([frame.camera, file.name, step, "" if t is None else f"{t:.6f}"])
        if self._bag is not None:
            self._bag.add(frame, planned=t is not None)
        if self._film is not None:
            self._waiting[frame.camera, frame.t] = (frame, caption)

    def seen(self, camera: str, t: float, outlines: Outlines) -> None:
        """The image of a camera of time t [s] was looked at."""
        if self._film is not None:
            frame, caption = self._waiting.pop((camera, t))
            self._film.add(frame, outlines, caption)

    def close(self) -> None:
        """Finish all files."""
        with ExitStack() as closing:  # finish the others even if one fails
            for sink in (self._film, self._bag):
                if sink is not None:
                    closing.callback(sink.close)
            if self._folder is not None:
                with naming(self._folder / INDEX):
                    self._file.close()


def read_frames(folder: Path, cameras: Sequence[str], steps: int) -> Iterator[tuple[str, Path, int, float | None]]:
    """The rows of a folder's index: camera, file, number of the step, and time in it [s], None if it is not as planned.

    Raises InputError for one that is missing or wrong, with its line.
    """
    path = folder / INDEX
    if folder.is_file():
        raise bad_input("no-frames", _FILE, Place(folder))
    if not folder.exists():
        raise InputError(missing_file(folder))
    if not path.is_file():
        message = f"there is no {INDEX} in this folder, and no metadata.yaml of a rosbag2; expected one of them"
        raise bad_input("no-frames", message, Place(folder))
    rows, columns = table_rows(path), ", ".join(_COLUMNS)
    place, header = next(rows, (Place(path, 1), []))
    if not header:
        message = f"this file is empty: the run was stopped before it kept an image; expected `{columns}`"
        mend = "record again: sqrp run PROGRAM --sim --frames DIR"
        raise bad_input("wrong-columns", message, place, mend=mend)
    if tuple(header) != _COLUMNS:
        # What has none of them may be another file, linked here to see what it says.
        found = f"`{', '.join(header)}`" if {*header} & {*_COLUMNS} else "others"
        raise bad_input("wrong-columns", f"the columns are {found}, expected `{columns}`", place)
    for place, row in rows:
        if len(row) != len(_COLUMNS):
            message = f"this row has {len(row)} columns, expected {len(_COLUMNS)}: {columns}"
            raise bad_input("wrong-columns", message, place)
        camera, name, step, t = row
        if camera not in cameras:
            message = f"there is no camera {describe(camera)}; {expected_names(camera[:LONGEST_NAME], cameras)}"
            raise bad_input("unknown-camera", message, place)
        file, number = file_in(folder, name, place), int(step) if step.isdecimal() and len(step) < LONGEST_NAME else 0
        if not 1 <= number <= steps:
            message = f"`step` is {describe(step)}, expected a whole number from 1 to {steps}, the steps of the program"
            raise bad_input("wrong-value", message, place)
        seconds = as_number(t) if t else 0.0
        if not 0.0 <= seconds <= LONGEST:
            message = f"`t` is {describe(t)}, expected seconds from 0 to {LONGEST:g}, or nothing"
            raise bad_input("wrong-value", message, place)
        yield camera, file, number, seconds if t else None


def table_rows(path: Path) -> Iterator[tuple[Place, list[str]]]:
    """The rows of a CSV file beside frames with their places, but for empty ones. Raises InputError for others."""
    text = read_text(path, MAX_INDEX)
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise bad_input("wrong-value", "this is no CSV: it has a NUL character", Place(path, line))
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for row in rows:
            if row:
                yield Place(path, rows.line_num), row
    except csv.Error as error:
        raise bad_input("wrong-value", f"this is no CSV: {error}", Place(path, rows.line_num)) from error


def file_in(folder: Path, name: str, place: Place) -> Path:
    """A file of the folder, also after following all links. Raises InputError, at the place of its name, for others."""
    path = folder / name
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        message = f"the file {describe(name)} is not in this folder; expected a path that does not leave it"
        raise bad_input("outside-folder", message, place)
    if not os.path.isfile(path):  # noqa: PTH113 - Path.is_file raises for a name that is too long
        raise bad_input("missing-file", f"{describe(name)}: {NOT_THERE}", place)
    return path
