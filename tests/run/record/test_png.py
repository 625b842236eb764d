"""PNG files are looked at before they are decoded: damage is found in whatever byte it is, without unpacking bombs."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from sqrp_cli.run.record.packed_image import bare_png, decoded, png_of
from tests.damage.record_bombs import chunk

PNG = png_of(np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3))


def damage(content: bytes) -> str | None:
    return bare_png(content)[0] or None


def packed(width: int, height: int, rows: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def test_what_was_written_is_whole_and_reads_as_it_was() -> None:
    assert damage(PNG) is None
    image = decoded(PNG)
    assert image is not None
    assert (image.ravel() == np.arange(5 * 7 * 3)).all()


def test_text_and_profiles_do_not_reach_the_decoder(capfd: pytest.CaptureFixture[str]) -> None:
    head = len(b"\x89PNG\r\n\x1a\n") + 25
    content = PNG[:head] + chunk(b"iCCP", b"a\0\0") + chunk(b"zTXt", b"a") + PNG[head:]
    assert damage(content) is None
    assert bare_png(content) == ("", PNG)
    decoded(content)
    assert "libpng" in capfd.readouterr().err
    decoded(bare_png(content)[1])
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("change", [0x01, 0x41, 0xFF])
def test_damage_is_found_in_whichever_byte_it_is(change: int) -> None:
    assert all(damage(PNG[:at] + bytes([PNG[at] ^ change]) + PNG[at + 1 :]) for at in range(len(PNG)))


def test_damage_is_found_wherever_a_file_is_cut_off() -> None:
    assert all(damage(PNG[:length]) for length in range(len(PNG)))


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (b"", "it has 0 rows, its header promises 3"),
        (bytes(2 * 7), "it has 2 rows, its header promises 3"),
        (bytes(4 * 7), "it has more rows than the 3 that its header promises"),
        (bytes(7) + b"\x05" + bytes(13), "row 2 is packed in a way that PNG does not have"),
    ],
)
def test_rows_that_are_missing_or_wrong_are_named(rows: bytes, says: str) -> None:
    assert damage(packed(2, 3, rows)) == says


def test_only_as_much_is_unpacked_as_the_image_needs() -> None:
    content = packed(2, 3, bytes(500_000_000))
    tracemalloc.start()
    assert damage(content) == "it has more rows than the 3 that its header promises"
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * len(content)


def test_colours_of_a_palette_that_is_missing_are_refused() -> None:
    header = struct.pack(">IIBBBBB", 2, 3, 8, 3, 0, 0, 0)
    rows = zlib.compress(bytes(3 * 3))
    content = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    assert damage(content) == "its colours are numbers of a palette (`PLTE`), which it does not have"
