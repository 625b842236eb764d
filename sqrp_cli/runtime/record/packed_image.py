"""Images in messages of ROS, packed or pixel by pixel, checked before they are decoded."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from tempfile import TemporaryFile

import cv2
import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.knowledge.camera.camera import Camera, PixelSize
from sqrp_cli.ros.messages import Message
from sqrp_cli.runtime.image import ImageArray
from sqrp_cli.runtime.record.png import bare_png, decoded, png_damage, png_size

_JPEG, _JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"

_CONVERSIONS = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
    "bayer_rggb8": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2RGB,
}
"""How each encoding of `sensor_msgs/Image` becomes red, green and blue."""

_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}
_CHANNELS |= dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), 2)
"""Bytes of a pixel; of other encodings one."""


_PADDING = re.compile(r"Corrupt JPEG data: ([1-9]|1[0-6]) extraneous bytes before marker 0xd[0-79]")
"""What is said where a camera fills up to a marker with a few bytes, as many do: nothing of the image is lost."""


class DamagedImageError(InputError):
    """An image of a recording that is damaged, as one in thousands may be."""


def image_of(message: Message, camera: Camera, place: Place, where: str) -> ImageArray:
    """The image of a `sensor_msgs/CompressedImage` or `Image`.

    place, where: the file, and the message in it. Raises DamagedImageError for one that is damaged, and InputError for
    one that has another size than the camera, or is packed in a way that is not read.
    """
    expected = PixelSize(camera.width, camera.height)
    if hasattr(message, "encoding"):
        return _unpacked(message, expected, place, where)
    content = bytes(message.data)
    found = png_size(content) if content.startswith(b"\x89PNG") else _jpeg_size(content)
    if found is None:
        what = f"as `{message.format}`" if message.format else "in a way that is not said"
        raise _damaged(f"the image of {where}, packed {what}, is no whole JPEG or PNG", place)
    _check_size(found, expected, place, where)
    if content.startswith(b"\x89PNG"):
        damage = png_damage(content)
        image = None if damage else decoded(bare_png(content))
    else:
        with _complaints() as said:
            image = decoded(content)
        damage = next((line for line in said if "JPEG" in line and not _PADDING.match(line)), None)
    if damage or image is None or image.shape[:2] != (camera.height, camera.width):
        raise _damaged(f"the image of {where} is damaged: {damage or 'it cannot be decoded'}", place)
    return image


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """The lines that a library writes to the standard error meanwhile: it has no other way to tell of damage."""
    said: list[str] = []
    with TemporaryFile() as file, ExitStack() as back:
        kept = os.dup(2)
        back.callback(os.close, kept)
        back.callback(os.dup2, kept, 2)
        os.dup2(file.fileno(), 2)
        yield said
        said += os.pread(file.fileno(), 10_000, 0).decode(errors="replace").splitlines()


def _unpacked(message: Message, expected: PixelSize, place: Place, where: str) -> ImageArray:
    encoding = message.encoding
    if encoding not in _CONVERSIONS:
        known = ", ".join(_CONVERSIONS)
        raise bad_input("unreadable", f"the image of {where} has the encoding `{encoding}`; read are {known}", place)
    found, channels = PixelSize(message.width, message.height), _CHANNELS.get(encoding, 1)
    _check_size(found, expected, place, where)
    if channels == 2 and found.width % 2:
        raise bad_input("unreadable", f"the image of {where} has the encoding `{encoding}`, but an odd width", place)
    row = found.width * channels
    if message.step < row or len(message.data) < message.step * found.height:
        raise _damaged(f"the image of {where} has fewer bytes than its {found.short} pixels need", place)
    rows = np.asarray(message.data, np.uint8)[: message.step * found.height].reshape(found.height, message.step)
    pixels = np.ascontiguousarray(rows[:, :row]).reshape(found.height, found.width, -1).squeeze()
    conversion = _CONVERSIONS[encoding]
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


def _jpeg_size(content: bytes) -> PixelSize | None:
    """The size in the frame header of a JPEG; None for what is no JPEG, or one that is cut off."""
    at = 2
    if not content.startswith(_JPEG) or _JPEG_END not in content[-1024:]:
        return None
    while at + 9 <= len(content) and content[at] == 0xFF:
        kind = content[at + 1]
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            return PixelSize(
                int.from_bytes(content[at + 7 : at + 9], "big"), int.from_bytes(content[at + 5 : at + 7], "big")
            )
        at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return None


def _check_size(found: PixelSize, expected: PixelSize, place: Place, where: str) -> None:
    if found != expected:
        message = f"the image of {where} is {found.short}, the workspace says {expected.short}"
        raise bad_input("wrong-size", message, place)


def _damaged(message: str, place: Place) -> DamagedImageError:
    return DamagedImageError(Problem("unreadable", message, place))
