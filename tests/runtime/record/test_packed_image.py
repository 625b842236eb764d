from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sqrp_cli.errors import InputError, Place
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.ros.messages import message_types
from sqrp_cli.runtime.record.packed_image import image_of
from sqrp_cli.runtime.record.png import jpeg_of, png_of

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
        (bare("yuv422", IMAGE, 192), "has the encoding `yuv422`; read are rgb8"),
    ],
)
def test_an_image_that_cannot_be_read_is_told_with_its_message(message: Any, says: str) -> None:
    with pytest.raises(InputError, match="here") as caught:
        image_of(message, CAMERA, PLACE, "/cam/image_raw at 1.000 s, here")
    assert says in caught.value.problems[0].message
