"""A look at PNG files before they are decoded: how large the image is, and whether the file is whole.

The decoder reserves whatever a header asks for, shows what is there of a damaged image, and writes of it past our
messages. The format: https://www.w3.org/TR/png-3/.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">IIBBBBB")
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Numbers for each pixel, by the type of colour."""
_FILTERS = 5


class DamagedPngError(Exception):
    """What is wrong with a PNG file, and where in it."""


def png_size(content: bytes) -> tuple[int, int]:
    """Width and height of a PNG file's image [pixels]. Raises DamagedPngError for what is no PNG file."""
    if not content.startswith(_SIGNATURE):
        raise DamagedPngError("it does not begin as a PNG file does")
    kind, data = next(_chunks(content), ("", b""))
    if kind != "IHDR" or len(data) != _HEADER.size:
        raise DamagedPngError(f"its first chunk is `{kind}`, expected a header `IHDR` of {_HEADER.size} bytes")
    width, height, *_ = _HEADER.unpack(data)
    return width, height


def check_png(content: bytes) -> None:
    """Raises DamagedPngError for a PNG file that has a damaged chunk, or fewer rows than its header promises."""
    chunks = list(_chunks(content))
    width, height, depth, color, _, _, interlaced = _HEADER.unpack(chunks[0][1])
    if color not in _CHANNELS or depth not in (1, 2, 4, 8, 16):
        raise DamagedPngError(f"its header asks for colours of type {color} with {depth} bits, which PNG does not have")
    if chunks[-1][0] != "IEND":
        raise DamagedPngError("it ends without the chunk `IEND`")
    row = 1 + (width * _CHANNELS[color] * depth + 7) // 8
    data = _inflated(b"".join(data for kind, data in chunks if kind == "IDAT"), row * height)
    if interlaced:
        return
    if len(data) < row * height:
        raise DamagedPngError(f"it has {len(data) // row:,} rows, its header promises {height:,}")
    wrong = next((number for number, law in enumerate(data[::row]) if law >= _FILTERS), None)
    if wrong is not None:
        raise DamagedPngError(f"row {wrong + 1:,} is packed in a way that PNG does not have")


def _chunks(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Name and data of each chunk."""
    at = len(_SIGNATURE)
    while at < len(content):
        length, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        kind, end = name.decode("ascii", errors="replace"), at + 12 + length
        if not (name.isalpha() and end <= len(content)):
            raise DamagedPngError(f"the chunk at byte {at:,} is cut off or damaged")
        data = content[at + 8 : end - 4]
        if zlib.crc32(name + data) != int.from_bytes(content[end - 4 : end], "big"):
            raise DamagedPngError(f"the chunk `{kind}` at byte {at:,} does not fit its checksum")
        yield kind, data
        at = end


def _inflated(data: bytes, most: int) -> bytes:
    try:
        return zlib.decompressobj().decompress(data, most)
    except zlib.error as error:
        raise DamagedPngError(f"its image data (`IDAT`) cannot be unpacked: {error}") from error
