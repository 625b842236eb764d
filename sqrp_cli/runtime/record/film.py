"""Keeps the images of a run: in a folder, in a recording, and as a film of all cameras with what was seen in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.image import CameraImage, ImageArray
from sqrp_cli.runtime.record.bag_recorder import BagRecorder
from sqrp_cli.runtime.record.frame_folder import FrameFolder
from sqrp_cli.shown import is_utf8

_TILE = (320, 240)
"""Width and height of a camera in a film [pixels]."""

_PAINT = {Truth.TRUE: (60, 220, 60), Truth.FALSE: (90, 160, 255), Truth.UNKNOWN: (240, 60, 60)}

_SUBPIXEL = 4
"""Fractional bits of the corners of what is drawn."""

Outlines = Iterable[tuple[Array, Truth]]
"""Outlines of boxes in an image (n, 2) [pixels], each with what the image shows of the box."""


class Screen(Protocol):
    """Shows images with what was seen in them: a film, or somebody who looks on."""

    def add(self, frame: CameraImage, outlines: Outlines, caption: str) -> None:
        """Show an image with what was seen in it."""

    def close(self) -> None:
        """There are no more."""


class Film:
    """A film of all cameras side by side, boxes drawn in: green the object is seen, blue background, red neither."""

    def __init__(self, path: Path, cameras: Sequence[str], rate: float) -> None:
        """rate: images per second of the fastest camera. Raises InputError for a path that is not UTF-8."""
        if not is_utf8(path):
            raise bad_input("cannot-write", "OpenCV can write a film only to a path that is UTF-8", Place(path))
        self._path = path
        self._video = _Video(path, rate)
        self._tiles: dict[str, ImageArray] = {name: np.zeros((_TILE[1], _TILE[0], 3), np.uint8) for name in cameras}
        self._time: float | None = None

    def add(self, frame: CameraImage, outlines: Outlines, caption: str) -> None:
        """Show an image with what was seen in it."""
        if self._time is not None and frame.t > self._time:
            self._video.add(self._mosaic())
        self._time = frame.t if self._time is None else max(self._time, frame.t)
        picture = drawn(frame.image, outlines, f"{frame.camera}  {frame.t:.1f} s  {caption}")
        self._tiles[frame.camera] = cv2.resize(picture, _TILE, interpolation=cv2.INTER_AREA)

    def close(self) -> None:
        """Finish the film. Raises InputError where it could not be written."""
        self._video.add(self._mosaic())
        if not self._video.close():
            message = "this film could not be written, or not as a whole; is the disk full?"
            raise bad_input("cannot-write", message, Place(self._path))

    def _mosaic(self) -> ImageArray:
        tiles = list(self._tiles.values())
        columns = int(np.ceil(len(tiles) ** 0.5))
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
        rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
        return np.vstack(rows)


class ImageRecorder:
    """Passes the images of a run to a folder, a film and a recording."""

    def __init__(self, folder: FrameFolder | None, film: Screen | None, bag: BagRecorder | None = None) -> None:
        self._folder, self._film, self._bag = folder, film, bag
        self._waiting: dict[tuple[str, float], tuple[CameraImage, str]] = {}

    def add(self, frame: CameraImage, step: int, t: float | None, caption: str) -> None:
        """An image was taken at time t [s] of a step, while the robot did what the caption says."""
        if self._folder is not None:
            self._folder.add(frame, step, t)
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
            for sink in (self._folder, self._film, self._bag):
                if sink is not None:
                    closing.callback(sink.close)


def drawn(image: ImageArray, outlines: Outlines, text: str) -> ImageArray:
    """A copy of an image with outlines in their colours, and a line of text."""
    canvas = image.copy()
    for polygon, truth in outlines:
        if len(polygon):
            corners = np.round(polygon * 2**_SUBPIXEL).clip(-(2**24), 2**24).astype(np.int32)
            cv2.polylines(canvas, [corners], True, _PAINT[truth], 2, cv2.LINE_AA, _SUBPIXEL)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


class _Video:
    """An MPEG-4 file that images are appended to."""

    def __init__(self, path: Path, rate: float) -> None:
        """rate: images per second."""
        self._path, self._rate = path, rate
        self._writer: Any = None
        self._count = 0

    def add(self, image: ImageArray) -> None:
        """Append an image; all have the same size."""
        if self._writer is None:
            size = (image.shape[1], image.shape[0])
            self._writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), self._rate, size)
        self._count += 1
        self._writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))

    def close(self) -> bool:
        """Finish the file; returns whether all images are in it, which the writer does not say."""
        if self._writer is not None:
            self._writer.release()
        return round(cv2.VideoCapture(str(self._path)).get(cv2.CAP_PROP_FRAME_COUNT)) == self._count
