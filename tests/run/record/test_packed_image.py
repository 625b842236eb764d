"""Images in files and messages: whole ones are read as they were, damage is found, none is larger than bearable.

Damage of PNG files is found in whatever byte it is, without unpacking bombs.
"""

from __future__ import annotations

import re
import resource
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sqrp_cli.camera.camera import Camera, PixelSize
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError, Place
from sqrp_cli.ros.messages import message_types
from sqrp_cli.run.image import check_image_sizes
from sqrp_cli.run.record.packed_image import decoded, image_of, read_png
from sqrp_cli.run.record.packed_image import encoded as as_file
from tests.damage.record_bombs import chunk

WATCH = Path(__file__).parents[2] / "cases" / "watch"
CAMERA = Camera(
    width=64, height=48, matrix=np.eye(3), distortion_model="none", distortion=np.zeros(0), rate=10.0, name="cam",
    frame="world", X_FC=np.eye(4),
)  # fmt: skip
y, x = np.mgrid[0:48, 0:64]
IMAGE = np.stack([4 * x, 5 * y, 128 + 0 * x], axis=-1).astype(np.uint8)
SIZE = PixelSize(64, 48)
PLACE = Place(Path("run.mcap"))
SIGNATURE = b"\x89PNG\r\n\x1a\n"
SMALL = as_file(np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3), "png")


def png(width: int, height: int, rows: bytes, *, color: int = 2, extra: bytes = b"") -> bytes:
    """A PNG of packed rows whose bytes say nothing more than its size."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 0))
    return SIGNATURE + header + extra + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def black(width: int, height: int, extra: bytes = b"") -> bytes:
    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(width + 1)) for _ in range(height)) + packer.flush()
    return png(width, height, rows, color=0, extra=extra)


def encoded(ending: str, image: np.ndarray) -> bytes:
    return cv2.imencode(ending, image)[1].tobytes()


def damage(content: bytes) -> str | None:
    found = decoded(content)
    return found if isinstance(found, str) else None


def test_texts_and_profiles_that_the_decoder_finds_fault_with_are_no_damage_of_an_image(capfd: Any) -> None:
    head = len(SIGNATURE) + 25
    image = decoded(SMALL[:head] + chunk(b"iCCP", b"a\0\0") + chunk(b"zTXt", b"a") + SMALL[head:])
    assert (image.ravel() == np.arange(5 * 7 * 3)).all()  # type: ignore[union-attr]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("change", [0x01, 0x41, 0xFF])
def test_damage_is_found_in_whichever_byte_it_is_and_wherever_a_file_is_cut_off(change: int) -> None:
    assert all(damage(SMALL[:at] + bytes([SMALL[at] ^ change]) + SMALL[at + 1 :]) for at in range(len(SMALL)))
    assert all(damage(SMALL[:length]) for length in range(1, len(SMALL)))


@pytest.mark.parametrize(
    ("rows", "color", "says"),
    [(b"", 2, "Not enough"), (bytes(2 * 7), 2, "Not enough"), (bytes(4 * 7), 2, "Too much"),
     (bytes(7) + b"\x05" + bytes(13), 2, "filter"), (bytes(3 * 3), 3, "Missing PLTE")],
)  # fmt: skip
def test_rows_that_are_missing_or_wrong_are_told_in_the_words_of_the_decoder(
    rows: bytes, color: int, says: str
) -> None:
    assert says in (damage(png(2, 3, zlib.compress(rows), color=color)) or "")


def test_nothing_is_unpacked_where_the_header_says_too_much(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(black(10_000, 10_000))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"a\.png: this image is 10000x10000, eye has 64x48"):
        read_png(path, SIZE, "eye")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # [kB]
    assert damage(png(2, 3, zlib.compress(bytes(50_000_000))))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no PNG file"),
        (encoded(".jpg", IMAGE), "no PNG file"),
        (encoded(".png", IMAGE)[:20], "damaged in its header"),
        (encoded(".png", IMAGE).replace(b"\0\0\0\x40", b"\0\0\0\x41", 1), "damaged in its header"),
        (black(64, 48, chunk(b"acTL", bytes(8))), "animated"),
        (black(65, 48), "is 65x48, eye has 64x48"),
        (encoded(".png", IMAGE) + bytes(11_000_000), "bytes, the limit is 10,024,576"),
    ],
    ids=["empty", "jpeg", "cut", "header", "animated", "size", "bytes"],
)
def test_what_is_no_image_of_the_camera_is_refused(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_png(tmp_path / "a.png", SIZE, "eye")


def test_every_kind_of_png_gives_eight_bits_in_three_colours(tmp_path: Path) -> None:
    grey = IMAGE[:, :, 0]
    clear, expected = np.dstack([IMAGE, np.full(grey.shape, 128, np.uint8)]), np.repeat(grey[:, :, None], 3, axis=2)
    fine = grey.astype(np.uint16) * 257
    for image, shown in ((grey, expected), (fine, expected), (IMAGE, IMAGE[:, :, ::-1]), (clear, IMAGE[:, :, ::-1])):
        (tmp_path / "a.png").write_bytes(encoded(".png", image))
        assert np.array_equal(read_png(tmp_path / "a.png", SIZE, "eye"), shown)
    rows = zlib.compress(b"".join(b"\0" + bytes([row]) * 64 for row in range(48)))
    (tmp_path / "a.png").write_bytes(png(64, 48, rows, color=3, extra=chunk(b"PLTE", bytes(range(144)))))
    assert read_png(tmp_path / "a.png", SIZE, "eye")[7, 0].tolist() == [21, 22, 23]


def test_images_that_are_too_large_to_simulate_or_look_at_are_refused_before_the_work() -> None:
    workspace = load_workspace(WATCH)

    def of_size(width: int, height: int, count: int = 1) -> Any:
        eye = replace(workspace.cameras["eye"], width=width, height=height)
        return replace(workspace, cameras={"eye": eye, **{str(number): eye for number in range(1, count)}})

    check_image_sizes(of_size(4000, 4000))
    with pytest.raises(InputError, match="`eye` have 4,001 x 4,000 pixels; images of at most 16,000,000 pixels"):
        check_image_sizes(of_size(4001, 4000))
    check_image_sizes(of_size(8000, 8000), ["eye"])
    with pytest.raises(InputError, match="at most 64,000,000 pixels are looked at"):
        check_image_sizes(of_size(8001, 8000), ["eye"])
    with pytest.raises(InputError, match="all cameras have 80,000,000 pixels"):
        check_image_sizes(of_size(4000, 4000, 5))


def packed(data: bytes, kind: str = "jpeg") -> Any:
    data = np.frombuffer(data, np.uint8)
    return message_types(2).make("sensor_msgs/msg/CompressedImage", format=kind, data=data)


def bare(encoding: str, pixels: Any, step: int, **fields: int) -> Any:
    size = {"width": 64, "height": 48, **fields}
    data = np.ascontiguousarray(pixels).ravel()
    return message_types(2).make("sensor_msgs/msg/Image", encoding=encoding, data=data, step=step, **size)


def shown(message: Any, camera: Camera = CAMERA) -> np.ndarray:
    """The image of a message, as numbers that can be subtracted."""
    return image_of(message, camera, PLACE, "here").astype(int)


def test_packed_images_are_what_was_packed_also_where_a_camera_fills_up_to_a_marker() -> None:
    np.testing.assert_array_equal(shown(packed(as_file(IMAGE, "png"), "png")), IMAGE)
    whole = as_file(IMAGE, "jpeg")
    assert np.abs(shown(packed(whole)) - IMAGE).max() < 12
    np.testing.assert_array_equal(shown(packed(whole[:-2] + b"\0" + whole[-2:])), shown(packed(whole)))


def mosaic() -> Any:
    """Red, green / green, blue."""
    pixels = np.empty((48, 64, 1), np.uint8)
    for (down, right), color in {(0, 0): 0, (0, 1): 1, (1, 0): 1, (1, 1): 2}.items():
        pixels[down::2, right::2, 0] = IMAGE[down::2, right::2, color]
    return pixels


def luma_at(luma: int) -> Any:
    """Brightness and colour by ITU-R BT.601, limited range."""
    r, g, b = (IMAGE[..., i].astype(float) for i in range(3))
    u, v = 128 - 0.148 * r - 0.291 * g + 0.439 * b, 128 + 0.439 * r - 0.368 * g - 0.071 * b
    pixels = np.empty((48, 64, 2))
    pixels[..., luma] = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    pixels[:, ::2, 1 - luma], pixels[:, 1::2, 1 - luma] = u[:, ::2], v[:, ::2]
    return pixels.round().astype(np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels", "tolerance"),
    [
        ("rgb8", IMAGE, 0), ("bgr8", IMAGE[..., ::-1], 0), ("rgba8", cv2.cvtColor(IMAGE, cv2.COLOR_RGB2RGBA), 0),
        ("bgra8", cv2.cvtColor(IMAGE, cv2.COLOR_RGB2BGRA), 0), ("bayer_rggb8", mosaic(), 6),
        ("yuv422_yuy2", luma_at(0), 8), ("yuyv", luma_at(0), 8), ("yuv422", luma_at(1), 8), ("uyvy", luma_at(1), 8),
    ],
)  # fmt: skip
def test_bare_images_are_read_in_every_encoding(encoding: str, pixels: Any, tolerance: int) -> None:
    width, within = 64 * pixels.shape[2], slice(2, -2) if encoding.startswith("bayer") else slice(None)
    longer = np.pad(pixels.reshape(48, width), ((0, 0), (0, 8)))  # rows that are longer than their pixels
    for message in (bare(encoding, pixels, width), bare(encoding, longer, width + 8)):
        assert np.abs(shown(message) - IMAGE)[within, within].max() <= tolerance


def test_a_jpeg_that_is_damaged_inside_is_told_in_the_words_of_its_decoder(capfd: pytest.CaptureFixture[str]) -> None:
    whole = as_file(IMAGE, "jpeg")
    damage = image_of(packed(whole[: 3 * len(whole) // 4] + b"\xff\xd9"), CAMERA, PLACE, "here")
    assert re.match("the image of here is damaged: .*JPEG", damage)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (packed(as_file(IMAGE, "jpeg")[:200]), "packed as `jpeg`, is no whole JPEG or PNG"),
        (packed(b"", ""), "packed in a way that is not said, is no whole"),
        (packed(b"RIFF" * 50, "webp"), "packed as `webp`, is no whole"),
        (packed(as_file(IMAGE, "png")[:-30], "png"), "is damaged: it does not end"),
        (packed(as_file(IMAGE[:40], "jpeg")), "is 64x40, the workspace says 64x48"),
        (bare("rgb8", IMAGE, 192, width=32, height=24), "is 32x24, the workspace says 64x48"),
        (bare("rgb8", IMAGE[:20], 192), "has fewer bytes than its 64x48 pixels need"),
        (bare("rgb8", IMAGE, 10), "has fewer bytes than its 64x48 pixels need"),
        (bare("mono16", IMAGE, 192), "has the encoding `mono16`; read are rgb8"),
        (bare("yuyv", IMAGE[:, :63, :2], 126, width=63), "has the encoding `yuyv`, but an odd width"),
    ],
)
def test_an_image_that_cannot_be_read_is_told_with_its_message(message: Any, says: str) -> None:
    try:
        told = image_of(message, replace(CAMERA, width=63) if "odd" in says else CAMERA, PLACE, "here")
    except InputError as error:
        told = error.problems[0].message
    assert "the image of here" in told
    assert says in told
