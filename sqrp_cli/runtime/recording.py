"""Keeps the images of a run: as a folder of frames that can be audited, and as a film of all cameras.

A folder of frames has a file `frames.csv` with the columns `camera`, `file` (a PNG beside it), `step` (from 1) and `t`
(seconds since the step's motion began; empty where the step did not go as planned), one row per image, in order.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, expected_names
from sqrp_cli.files import make_folder
from sqrp_cli.runtime.frame import Frame
from sqrp_cli.runtime.perception.sighting import Evidence, Sighting
from sqrp_cli.runtime.perception.vision import Image, Video, drawn, resized, write_png

INDEX = "frames.csv"
"""The file that lists the frames of a folder."""

_COLUMNS = ("camera", "file", "step", "t")

_TILE = (320, 240)
"""Width and height of a camera in a film [pixels]."""

_PAINT = {Evidence.SEEN: (60, 220, 60), Evidence.ABSENT: (90, 160, 255), Evidence.BLIND: (240, 60, 60)}


@dataclass(frozen=True)
class FrameEntry:
    """A row of a folder's index; t: of the step [s], None where it did not go as planned."""

    camera: str
    file: Path
    step: int
    t: float | None


class FrameFolder:
    """Writes the images of a run into a folder."""

    def __init__(self, folder: Path) -> None:
        """folder: is made if it does not exist. Raises InputError if it cannot be, or is not empty."""
        make_folder(folder)
        if any(folder.iterdir()):
            message = "this folder is not empty, and nothing is ever overwritten; expected the name of a new folder"
            raise InputError(Problem("not-empty", message, Place(folder)))
        self._folder = folder
        self._file = (folder / INDEX).open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file)
        self._rows.writerow(_COLUMNS)
        self._count = 0

    def add(self, frame: Frame, step: int, t: float | None) -> None:
        """Keep an image that was taken at time t [s] of a step."""
        name = f"{frame.camera}-{self._count:06d}.png"
        self._count += 1
        write_png(self._folder / name, frame.image)
        self._rows.writerow([frame.camera, name, step, "" if t is None else f"{t:.6f}"])

    def close(self) -> None:
        """Finish the index."""
        self._file.close()


def read_frames(folder: Path, cameras: Sequence[str], steps: int) -> Iterator[FrameEntry]:
    """The rows of a folder's index. Raises InputError for one that is missing or wrong, with its line."""
    path = folder / INDEX
    if folder.is_file():
        raise InputError(Problem("no-frames", f"this is a file; expected a folder with {INDEX} in it", Place(folder)))
    if not path.is_file():
        message = f"there is no {INDEX} in this folder; expected one with the columns {', '.join(_COLUMNS)}"
        raise InputError(Problem("no-frames", message, Place(folder)))
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"this is no {INDEX}: it is not UTF-8 text"
        raise InputError(Problem("not-utf-8", message, Place(path))) from error
    rows = csv.DictReader(io.StringIO(text, newline=""))
    try:
        if tuple(rows.fieldnames or ()) != _COLUMNS:
            message = f"the columns are `{', '.join(rows.fieldnames or ())}`, expected `{', '.join(_COLUMNS)}`"
            raise InputError(Problem("wrong-columns", message, Place(path, 1)))
        for row in rows:
            yield _entry(row, folder, cameras, steps, Place(path, rows.line_num))
    except csv.Error as error:
        raise InputError(Problem("wrong-value", f"this is no CSV: {error}", Place(path, rows.line_num))) from error


def _entry(row: Mapping[str, str], folder: Path, cameras: Sequence[str], steps: int, place: Place) -> FrameEntry:
    if row["camera"] not in cameras:
        message = f"there is no camera `{row['camera']}`; {expected_names(row['camera'], cameras)}"
        raise InputError(Problem("unknown-camera", message, place))
    try:
        step, t = int(row["step"]), float(row["t"]) if row["t"] else None
        if not math.isfinite(t or 0.0):
            raise ValueError
    except (TypeError, ValueError):
        message = "`step` and `t` must be a number each (`t` may be empty)"
        raise InputError(Problem("wrong-value", message, place)) from None
    if not 1 <= step <= steps:
        raise InputError(Problem("wrong-value", f"`step` is {step}, the program has {steps}", place))
    file_path = folder / (row["file"] or "")
    if not os.path.isfile(file_path):  # noqa: PTH113 # of names that no file can have `Path` raises errors
        raise InputError(Problem("missing-file", f"there is no file `{row['file']}`", place))
    return FrameEntry(row["camera"], file_path, step, t)


class Film:
    """A film of all cameras side by side, boxes drawn in: green the thing is seen, blue background, red neither."""

    def __init__(self, path: Path, cameras: Sequence[str], rate: float) -> None:
        """rate: images per second of the fastest camera."""
        self._video = Video(path, rate)
        self._tiles: dict[str, Image] = {name: np.zeros((_TILE[1], _TILE[0], 3), np.uint8) for name in cameras}
        self._time: float | None = None

    def add(self, frame: Frame, sighting: Sighting, caption: str) -> None:
        """Show an image with what was seen in it."""
        if self._time is not None and frame.t > self._time:
            self._video.add(self._mosaic())
        self._time = frame.t if self._time is None else max(self._time, frame.t)
        outlines = [(box.outline, _PAINT[box.evidence]) for boxes in sighting.boxes.values() for box in boxes]
        picture = drawn(frame.image, outlines, f"{frame.camera}  {frame.t:.1f} s  {caption}")
        self._tiles[frame.camera] = resized(picture, *_TILE)

    def close(self) -> None:
        """Finish the film."""
        self._video.add(self._mosaic())
        self._video.close()

    def _mosaic(self) -> Image:
        tiles = list(self._tiles.values())
        columns = int(np.ceil(len(tiles) ** 0.5))
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
        rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
        return np.vstack(rows)


class Gallery:
    """Hands the images of a run to a folder, a film, or both."""

    def __init__(self, folder: FrameFolder | None, film: Film | None) -> None:
        self._folder, self._film = folder, film
        self._waiting: dict[tuple[str, float], tuple[Frame, str]] = {}

    def add(self, frame: Frame, step: int, t: float | None, caption: str) -> None:
        """An image was taken at time t [s] of a step, while the robot did what the caption says."""
        if self._folder is not None:
            self._folder.add(frame, step, t)
        if self._film is not None:
            self._waiting[frame.camera, frame.t] = (frame, caption)

    def seen(self, sighting: Sighting) -> None:
        """An image was looked at."""
        if self._film is not None:
            frame, caption = self._waiting.pop((sighting.camera, sighting.t))
            self._film.add(frame, sighting, caption)

    def close(self) -> None:
        """Finish all files."""
        for sink in (self._folder, self._film):
            if sink is not None:
                sink.close()
