from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sqrp_cli.camera.camera import Camera
from sqrp_cli.errors import InputError, Place
from sqrp_cli.ros.messages import message_types
from sqrp_cli.run.record.packed_image import DamagedImageError, image_of, jpeg_of, png_of

CAMERA = Camera(
    width=64, height=48, matrix=np.eye(3), distortion_model="none", distortion=np.zeros(0), rate=10.0, name="cam",
    frame="world", X_FC=np.eye(4),
)  # fmt: skip
y, x = np.mgrid[0:48, 0:64]
IMAGE = np.stack([4 * x, 5 * y, 128 + 0 * x], axis=-1).astype(np.uint8)
PLACE = Place(Path("run.mcap"))


def packed(data: bytes, kind: str = "jpeg") -> Any:
    data = np.frombuffer(data, np.uint8)
    return message_types(2).make("sensor_msgs/msg/CompressedImage", format=kind, data=data)


def bare(encoding: str, pixels: Any, step: int, **fields: int) -> Any:
    size = {"width": 64, "height": 48, **fields}
    data = np.ascontiguousarray(pixels).ravel()
    return message_types(2).make("sensor_msgs/msg/Image", encoding=encoding, data=data, step=step, **size)


def test_packed_images_are_what_was_packed() -> None:
    np.testing.assert_array_equal(image_of(packed(png_of(IMAGE), "png"), CAMERA, PLACE, "here"), IMAGE)
    error = image_of(packed(jpeg_of(IMAGE)), CAMERA, PLACE, "here").astype(int) - IMAGE
    assert np.abs(error).max() < 12


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", IMAGE),
        ("bgr8", IMAGE[..., ::-1]),
        ("rgba8", cv2.cvtColor(IMAGE, cv2.COLOR_RGB2RGBA)),
        ("bgra8", cv2.cvtColor(IMAGE, cv2.COLOR_RGB2BGRA)),
    ],
)
def test_bare_images_are_read_in_every_order_of_colours(encoding: str, pixels: Any) -> None:
    width = 64 * pixels.shape[2]
    np.testing.assert_array_equal(image_of(bare(encoding, pixels, width), CAMERA, PLACE, "here"), IMAGE)
    rows = np.pad(pixels.reshape(48, width), ((0, 0), (0, 8)))  # rows that are longer than their pixels
    np.testing.assert_array_equal(image_of(bare(encoding, rows, width + 8), CAMERA, PLACE, "here"), IMAGE)


def test_a_mosaic_of_colours_becomes_an_image() -> None:
    mosaic = np.empty((48, 64), np.uint8)  # red, green / green, blue
    mosaic[::2, ::2], mosaic[1::2, 1::2] = IMAGE[::2, ::2, 0], IMAGE[1::2, 1::2, 2]
    mosaic[::2, 1::2], mosaic[1::2, ::2] = IMAGE[::2, 1::2, 1], IMAGE[1::2, ::2, 1]
    found = image_of(bare("bayer_rggb8", mosaic, 64), CAMERA, PLACE, "here").astype(int)
    assert np.abs(found - IMAGE)[2:-2, 2:-2].max() <= 6


@pytest.mark.parametrize(("encoding", "luma"), [("yuv422_yuy2", 0), ("yuyv", 0), ("yuv422", 1), ("uyvy", 1)])
def test_images_of_brightness_and_colour_are_read(encoding: str, luma: int) -> None:
    r, g, b = (IMAGE[..., i].astype(float) for i in range(3))
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b  # ITU-R BT.601, limited range
    u, v = 128 - 0.148 * r - 0.291 * g + 0.439 * b, 128 + 0.439 * r - 0.368 * g - 0.071 * b
    pixels = np.empty((48, 64, 2))
    pixels[..., luma], pixels[:, ::2, 1 - luma], pixels[:, 1::2, 1 - luma] = y, u[:, ::2], v[:, ::2]
    found = image_of(bare(encoding, pixels.round().astype(np.uint8), 128), CAMERA, PLACE, "here")
    assert np.abs(found.astype(int) - IMAGE).max() <= 8


def test_a_jpeg_that_is_damaged_inside_is_told_in_the_words_of_its_decoder(capfd: pytest.CaptureFixture[str]) -> None:
    whole = jpeg_of(IMAGE)
    with pytest.raises(DamagedImageError, match=r"here is damaged: .*JPEG"):
        image_of(packed(whole[: 3 * len(whole) // 4] + b"\xff\xd9"), CAMERA, PLACE, "here")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (packed(jpeg_of(IMAGE)[:200]), "packed as `jpeg`, is no whole JPEG or PNG"),
        (packed(b"", ""), "packed in a way that is not said, is no whole"),
        (packed(b"RIFF" * 50, "webp"), "packed as `webp`, is no whole"),
        (packed(png_of(IMAGE)[:-30], "png"), "is damaged: the chunk at byte"),
        (packed(jpeg_of(IMAGE[:40])), "is 64x40, the workspace says 64x48"),
        (bare("rgb8", IMAGE, 192, width=32, height=24), "is 32x24, the workspace says 64x48"),
        (bare("rgb8", IMAGE[:20], 192), "has fewer bytes than its 64x48 pixels need"),
        (bare("rgb8", IMAGE, 10), "has fewer bytes than its 64x48 pixels need"),
        (bare("mono16", IMAGE, 192), "has the encoding `mono16`; read are rgb8"),
    ],
)
def test_an_image_that_cannot_be_read_is_told_with_its_message(message: Any, says: str) -> None:
    with pytest.raises(InputError, match="here") as caught:
        image_of(message, CAMERA, PLACE, "/cam/image_raw at 1.000 s, here")
    assert says in caught.value.problems[0].message


def test_a_camera_that_fills_up_to_a_marker_sends_whole_images() -> None:
    whole = jpeg_of(IMAGE)
    padded = image_of(packed(whole[:-2] + b"\0" + whole[-2:]), CAMERA, PLACE, "here")
    np.testing.assert_array_equal(padded, image_of(packed(whole), CAMERA, PLACE, "here"))


def test_colours_that_two_pixels_share_need_an_even_width() -> None:
    odd = replace(CAMERA, width=63)
    with pytest.raises(InputError, match="has the encoding `yuyv`, but an odd width"):
        image_of(bare("yuyv", IMAGE[:, :63, :2], 126, width=63), odd, PLACE, "here")
