"""How large images may be that are drawn and looked at, and how large those of a file are, before any is decoded."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.knowledge.workspace.workspace import Workspace

MOST_SIMULATED = 16_000_000
"""Most pixels of an image that is simulated; each drawing process needs some 100 bytes for each of them."""

MOST_SIMULATED_TOGETHER = 64_000_000
"""Most pixels of one image of every camera."""

MOST_RECORDED = 64_000_000
"""Most pixels of a recorded image that is looked at."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER_CHUNK = 25
"""Bytes of the first chunk: its length, its name, 13 of content, its checksum."""

_BYTES_PER_PIXEL, _SPARE_BYTES = 8, 10_000_000
"""Largest size of an image file: so much for each pixel (four values of 16 bits), and so much for the rest."""


@dataclass(frozen=True)
class ImageSize:
    """Width and height [pixels]."""

    width: int
    height: int

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"


def check_simulated(workspace: Workspace) -> None:
    """Raises InputError for cameras whose images are too large to be simulated."""
    cameras = workspace.cameras.values()
    for camera in cameras:
        _check(workspace, camera, MOST_SIMULATED, "simulated")
    together = sum(camera.width * camera.height for camera in cameras)
    if together > MOST_SIMULATED_TOGETHER:
        message = (
            f"the images of all cameras have {together:,} pixels; simulated are at most {MOST_SIMULATED_TOGETHER:,}"
        )
        raise InputError(Problem("image-too-large", message, workspace.places.get("cameras")))


def check_recorded(workspace: Workspace, names: Iterable[str]) -> None:
    """Raises InputError for cameras, of those named, whose images are too large to be looked at."""
    for name in names:
        _check(workspace, workspace.cameras[name], MOST_RECORDED, "looked at")


def _check(workspace: Workspace, camera: Camera, most: int, done: str) -> None:
    if camera.width * camera.height > most:
        message = f"the images of `{camera.name}` have {camera.width:,} x {camera.height:,} pixels"
        message += f"; images of at most {most:,} pixels are {done}"
        mend = "give the camera a smaller image, with the same field of view"
        place = workspace.places.get(f"cameras.{camera.name}")
        raise InputError(Problem("image-too-large", message, place, mend=mend))


def read_png(path: Path, expected: ImageSize, camera: str) -> bytes:
    """The content of a PNG file, still packed, whose header says that it has the expected size.

    Raises InputError for what is no PNG file, one that is animated or much larger than its pixels, and another size.
    """
    content = read_input(path, _BYTES_PER_PIXEL * expected.width * expected.height + _SPARE_BYTES)
    found = _stated_size(path, content)
    if found != expected:
        raise InputError(Problem("wrong-size", f"this image is {found}, {camera} has {expected}", Place(path)))
    return content


def _stated_size(path: Path, content: bytes) -> ImageSize:
    """The size that the first chunk of a PNG says."""
    if not content.startswith(_SIGNATURE):
        mend = "convert it to PNG"
        raise InputError(Problem("unreadable", "this image is no PNG file", Place(path), mend=mend))
    chunk = content[len(_SIGNATURE) : len(_SIGNATURE) + _HEADER_CHUNK]
    whole = len(chunk) == _HEADER_CHUNK and chunk[:8] == b"\0\0\0\x0dIHDR"
    if not whole or zlib.crc32(chunk[4:21]) != int.from_bytes(chunk[21:], "big"):
        raise InputError(Problem("unreadable", "this PNG file is damaged in its header", Place(path)))
    if b"acTL" in content[: content.find(b"IDAT")]:
        mend = "write each of its images into a file of its own"
        raise InputError(Problem("unreadable", "this PNG file is animated, expected one image", Place(path), mend=mend))
    return ImageSize(int.from_bytes(chunk[8:12], "big"), int.from_bytes(chunk[12:16], "big"))
