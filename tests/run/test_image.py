"""Images are as large as their camera's, and no larger than a machine can bear, before they are decoded or drawn."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sqrp_cli.camera.camera import PixelSize
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.run.image import check_recorded, check_simulated
from sqrp_cli.run.record.packed_image import decoded, read_png

WATCH = Path(__file__).parents[1] / "cases" / "watch"
SIZE = PixelSize(40, 30)
PIXELS = np.random.default_rng(0).integers(0, 255, (30, 40, 3), dtype=np.uint8)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(width: int, height: int, extra: bytes = b"") -> bytes:
    """A black image whose bytes say nothing more than its size."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(width + 1)) for _ in range(height)) + packer.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def encoded(ending: str, image: np.ndarray) -> bytes:
    return cv2.imencode(ending, image)[1].tobytes()


def of_size(width: int, height: int) -> Workspace:
    workspace = load_workspace(WATCH)
    return replace(workspace, cameras={"eye": replace(workspace.cameras["eye"], width=width, height=height)})


@pytest.mark.slow
def test_a_png_of_a_gigapixel_is_refused_from_its_header(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png(32_000, 32_000))
    assert path.stat().st_size < 5_000_000
    tracemalloc.start()
    with pytest.raises(InputError, match=r"a\.png: this image is 32000x32000, eye has 40x30"):
        read_png(path, SIZE, "eye")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no PNG file"),
        (encoded(".jpg", PIXELS), "no PNG file"),
        (encoded(".png", PIXELS)[:20], "damaged in its header"),
        (encoded(".png", PIXELS).replace(b"\0\0\0\x28", b"\0\0\0\x29", 1), "damaged in its header"),
        (png(40, 30, chunk(b"acTL", bytes(8))), "animated"),
        (png(41, 30), "is 41x30, eye has 40x30"),
        (encoded(".png", PIXELS) + bytes(11_000_000), "bytes, the limit is 10,009,600"),
    ],
    ids=["empty", "jpeg", "cut", "header", "animated", "size", "bytes"],
)
def test_what_is_no_image_of_the_camera_is_refused(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_png(tmp_path / "a.png", SIZE, "eye")


def test_an_image_that_is_cut_off_is_not_taken_for_a_whole_one() -> None:
    whole = encoded(".png", PIXELS)
    assert decoded(whole) is not None
    assert decoded(whole[: len(whole) // 2]) is None


def test_every_kind_of_png_gives_eight_bits_in_three_colours(tmp_path: Path) -> None:
    grey = PIXELS[:, :, 0]
    fine = grey.astype(np.uint16) * 257
    clear = np.dstack([PIXELS, np.full(grey.shape, 128, np.uint8)])
    expected = np.repeat(grey[:, :, None], 3, axis=2)
    for image, shown in ((grey, expected), (fine, expected), (PIXELS, PIXELS[:, :, ::-1]), (clear, PIXELS[:, :, ::-1])):
        (tmp_path / "a.png").write_bytes(encoded(".png", image))
        assert np.array_equal(read_png(tmp_path / "a.png", SIZE, "eye"), shown)
    palette = chunk(b"PLTE", bytes(range(90)))
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 40, 30, 8, 3, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(b"".join(b"\0" + bytes([row]) * 40 for row in range(30))))
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + palette + rows + chunk(b"IEND", b""))
    image = read_png(tmp_path / "a.png", SIZE, "eye")
    assert image is not None
    assert image[7, 0].tolist() == [21, 22, 23]


def test_images_that_are_too_large_to_simulate_or_look_at_are_refused_before_the_work() -> None:
    check_simulated(of_size(4000, 4000))
    with pytest.raises(InputError, match="`eye` have 4,001 x 4,000 pixels; images of at most 16,000,000 pixels"):
        check_simulated(of_size(4001, 4000))
    check_recorded(of_size(8000, 8000), ["eye"])
    with pytest.raises(InputError, match="at most 64,000,000 pixels are looked at"):
        check_recorded(of_size(8001, 8000), ["eye"])
    eye = of_size(4000, 4000).cameras["eye"]
    many = replace(of_size(1, 1), cameras={str(number): eye for number in range(5)})
    with pytest.raises(InputError, match="all cameras have 80,000,000 pixels"):
        check_simulated(many)
