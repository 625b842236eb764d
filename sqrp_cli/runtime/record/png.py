"""PNG files: writing them, and a look at them before they are decoded, whether they are whole and of the right size.

The decoder writes of what is damaged past our messages, and does not say where it is. The format: https://www.w3.org/TR/png-3/.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.knowledge.camera.camera import PixelSize
from sqrp_cli.knowledge.text.input_file import read_input
from sqrp_cli.runtime.image import ImageArray

_HEADER = struct.Struct(">IIBBBBB")
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Numbers for each pixel, by the type of colour."""
_PALETTE = 3
"""The type of colour whose numbers are those of a palette."""
_PIXELS = ("IHDR", "PLTE", "IDAT", "IEND")
_DEPTHS, _FILTERS = (1, 2, 4, 8, 16), 5
_SAMPLED_444 = int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER_CHUNK = 25
"""Bytes of the first chunk: its length, its name, 13 of content, its checksum."""

_BYTES_PER_PIXEL, _SPARE_BYTES = 8, 10_000_000
"""Largest size of an image file: so much for each pixel (four values of 16 bits), and so much for the rest."""


def png_of(image: ImageArray) -> bytes:
    """An image as a PNG file."""
    _, content = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return bytes(content)


JPEG_QUALITY = 95
"""Of recorded images, of 100."""


def jpeg_of(image: ImageArray) -> bytes:
    """An image as a JPEG file with all of its colours: none of their channels is made smaller."""
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, _SAMPLED_444]
    _, content = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    return bytes(content)


def decoded(content: bytes) -> ImageArray | None:
    """The image of an image file's content, in eight bits and without transparency; None if it is damaged."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    return None if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def read_png(path: Path, expected: PixelSize, camera: str) -> bytes:
    """The content of a PNG file, still packed, whose header says that it has the expected size.

    Raises InputError for what is no PNG file, one that is animated or much larger than its pixels, and another size.
    """
    content = read_input(path, _BYTES_PER_PIXEL * expected.width * expected.height + _SPARE_BYTES)
    found = _stated_size(path, content)
    if found != expected:
        raise bad_input("wrong-size", f"this image is {found.short}, {camera} has {expected.short}", Place(path))
    return content


class _DamagedError(Exception):
    """What is wrong with a PNG file, and where in it."""


def png_damage(content: bytes) -> str | None:
    """What is wrong with a PNG file: a damaged chunk, or other rows than its header promises; None where nothing is."""
    try:
        _check(content)
    except _DamagedError as error:
        return str(error)
    return None


def bare_png(content: bytes) -> bytes:
    """A PNG file that is whole with nothing but its pixels: of what else there may be, the decoder has much to say."""
    kept = (_packed(kind, data) for kind, data in _chunks(content) if kind in _PIXELS)
    return _SIGNATURE + b"".join(kept)


def _packed(kind: str, data: bytes) -> bytes:
    named = kind.encode() + data
    return struct.pack(">I", len(data)) + named + struct.pack(">I", zlib.crc32(named))


def _check(content: bytes) -> None:
    if not content.startswith(_SIGNATURE):
        raise _DamagedError("it does not begin as PNG files do")
    chunks = list(_chunks(content)) or [("", b"")]
    width, height, depth, color, interlaced = _header(*chunks[0])
    if chunks[-1][0] != "IEND":
        raise _DamagedError("it ends without the chunk `IEND`")
    if color == _PALETTE and all(kind != "PLTE" for kind, _ in chunks):
        raise _DamagedError("its colours are numbers of a palette (`PLTE`), which it does not have")
    row = 1 + (width * _CHANNELS[color] * depth + 7) // 8
    data = _inflated(b"".join(data for kind, data in chunks if kind == "IDAT"), row * height + 1)
    if interlaced:
        return
    if len(data) < row * height:
        raise _DamagedError(f"it has {len(data) // row:,} rows, its header promises {height:,}")
    if len(data) > row * height:
        raise _DamagedError(f"it has more rows than the {height:,} that its header promises")
    wrong = next((number for number, law in enumerate(data[::row]) if law >= _FILTERS), None)
    if wrong is not None:
        raise _DamagedError(f"row {wrong + 1:,} is packed in a way that PNG does not have")


def _header(kind: str, data: bytes) -> tuple[int, int, int, int, int]:
    """Width, height, bits per number, type of colour, and whether the rows are interlaced."""
    if kind != "IHDR" or len(data) != _HEADER.size:
        raise _DamagedError(f"its first chunk is `{kind}`, expected `IHDR` with {_HEADER.size} bytes")
    width, height, depth, color, _, _, interlaced = _HEADER.unpack(data)
    if color not in _CHANNELS or depth not in _DEPTHS:
        raise _DamagedError(f"its header asks for colours of type {color} with {depth} bits, which PNG does not have")
    return width, height, depth, color, interlaced


def _chunks(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Name and data of each chunk."""
    at = len(_SIGNATURE)
    while at < len(content):
        length, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        kind, end = name.decode("ascii", errors="replace"), at + 12 + length
        if not (name.isalpha() and end <= len(content)):
            raise _DamagedError(f"the chunk at byte {at:,} is cut off or damaged")
        data = content[at + 8 : end - 4]
        if zlib.crc32(name + data) != int.from_bytes(content[end - 4 : end], "big"):
            raise _DamagedError(f"the chunk `{kind}` at byte {at:,} does not fit its checksum")
        yield kind, data
        at = end


def _inflated(data: bytes, most: int) -> bytes:
    try:
        return zlib.decompressobj().decompress(data, most)
    except zlib.error as error:
        raise _DamagedError(f"its image data (`IDAT`) cannot be unpacked: {error}") from error


def png_size(content: bytes) -> PixelSize | None:
    """The size that the first chunk of a PNG says; None for a damaged one."""
    chunk = content[len(_SIGNATURE) : len(_SIGNATURE) + _HEADER_CHUNK]
    whole = len(chunk) == _HEADER_CHUNK and chunk[:8] == b"\0\0\0\x0dIHDR"
    if not whole or zlib.crc32(chunk[4:21]) != int.from_bytes(chunk[21:], "big"):
        return None
    return PixelSize(int.from_bytes(chunk[8:12], "big"), int.from_bytes(chunk[12:16], "big"))


def _stated_size(path: Path, content: bytes) -> PixelSize:
    """The size that a PNG file says."""
    if not content.startswith(_SIGNATURE):
        raise bad_input("unreadable", "this image is no PNG file", Place(path), mend="convert it to PNG")
    found = png_size(content)
    if found is None:
        raise bad_input("unreadable", "this PNG file is damaged in its header", Place(path))
    if b"acTL" in content[: content.find(b"IDAT")]:
        mend = "write each of its images into a file of its own"
        raise bad_input("unreadable", "this PNG file is animated, expected one image", Place(path), mend=mend)
    return found
