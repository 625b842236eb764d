"""PNG files are looked at before they are decoded: damage is found in whatever byte it is, without unpacking bombs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.runtime.perception.vision import decoded_png, write_png
from sqrp_cli.runtime.png_file import DamagedPngError, check_png, png_size


@pytest.fixture(scope="module")
def png(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("images") / "image.png"
    write_png(path, np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3))
    return path.read_bytes()


def packed(width: int, height: int, rows: bytes) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def test_what_was_written_is_whole_and_reads_as_it_was(png: bytes) -> None:
    check_png(png)
    image = decoded_png(png)
    assert image is not None
    assert png_size(png) == (7, 5)
    assert (image.ravel() == np.arange(5 * 7 * 3)).all()


def test_an_image_is_refused_whichever_byte_of_it_is_changed(png: bytes) -> None:
    for at in range(len(png)):
        changed = png[:at] + bytes([png[at] ^ 0x41]) + png[at + 1 :]
        with pytest.raises(DamagedPngError):
            png_size(changed)
            check_png(changed)


def test_an_image_is_refused_wherever_it_is_cut_off(png: bytes) -> None:
    for length in range(len(png)):
        with pytest.raises(DamagedPngError):
            png_size(png[:length])
            check_png(png[:length])


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (b"", "it has 0 rows, its header promises 3"),
        (bytes(2 * 7), "it has 2 rows, its header promises 3"),
        (bytes(7) + b"\x05" + bytes(13), "row 2 is packed in a way that PNG does not have"),
    ],
)
def test_rows_that_are_missing_or_wrong_are_named(rows: bytes, says: str) -> None:
    with pytest.raises(DamagedPngError, match=says):
        check_png(packed(2, 3, rows))


def test_only_as_much_is_unpacked_as_the_image_needs() -> None:
    check_png(packed(2, 3, bytes(500_000_000)))
