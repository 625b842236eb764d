"""Images in files and in messages of ROS, packed or pixel by pixel: written, and checked before they are decoded.

Decoders say on the standard error what is damaged, and return what they can: what they say is caught. PNG:
https://www.w3.org/TR/png-3/.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Literal

import cv2
import numpy as np

from sqrp_cli.camera.camera import Camera, PixelSize
from sqrp_cli.errors import Place, bad_input
from sqrp_cli.files.input_file import read_input
from sqrp_cli.ros.messages import Message
from sqrp_cli.run.image import ImageArray

JPEG_QUALITY = 95  # Of recorded images, of 100
_SIGNATURE, _END = b"\x89PNG\r\n\x1a\n", b"\0\0\0\0IEND\xae\x42\x60\x82"  # How PNG files begin and end
_HEADER_CHUNK = 25  # Bytes of the first chunk: its length, its name, 13 of content, its checksum
_BYTES_PER_PIXEL, _SPARE_BYTES = 8, 10_000_000
"""Largest size of an image file: so much for each pixel (four values of 16 bits), and so much for the rest."""
_JPEG, _JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"
_DAMAGE = re.compile(
    r"(?:libpng error: |libpng warning: (?=.*CRC error|IHDR|PLTE|IDAT|IEND)|grfmt_png\.cpp:\d+ \w+ )(.+)"
    r"|^((?!Corrupt JPEG data: (?:[1-9]|1[0-6]) extraneous bytes before marker 0xd[0-79]).*JPEG.*)"
)
"""What decoders say of damage: of PNG all but warnings of what has no pixels, such as a profile that is too short.

Many cameras fill JPEG up to a marker with a few bytes: nothing of the image is lost.
"""
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


def encoded(image: ImageArray, kind: Literal["png", "jpeg"]) -> bytes:
    """An image as a file; a JPEG has all of its colours: none of their channels is made smaller."""
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if kind == "jpeg":
        sampled = int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampled]
    _, content = cv2.imencode(f".{kind}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    return bytes(content)


def decoded(content: bytes) -> ImageArray | str:
    """The image of a PNG or JPEG file in eight bits and without transparency; what is wrong with a damaged one."""
    if content.startswith(_SIGNATURE) and not content.endswith(_END):
        return "it does not end as PNG files do"
    with _complaints() as said:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    for found in filter(None, map(_DAMAGE.search, said)):
        return found[found.lastindex or 0]
    return "it cannot be decoded" if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def read_png(path: Path, expected: PixelSize, camera: str) -> ImageArray:
    """The image of a PNG file, which must have the expected size.

    Raises InputError for what is no PNG file, one that is animated, damaged or much larger than its pixels, and another
    size: that its header says, before anything is decoded.
    """
    content = read_input(path, _BYTES_PER_PIXEL * expected.width * expected.height + _SPARE_BYTES)
    if not content.startswith(_SIGNATURE):
        raise bad_input("unreadable", "this image is no PNG file", Place(path), mend="convert it to PNG")
    found = png_size(content)
    if found is None:
        raise bad_input("unreadable", "this PNG file is damaged in its header", Place(path))
    if b"acTL" in content[: content.find(b"IDAT")]:
        mend = "write each of its images into a file of its own"
        raise bad_input("unreadable", "this PNG file is animated, expected one image", Place(path), mend=mend)
    if found != expected:
        raise bad_input("wrong-size", f"this image is {found.short}, {camera} has {expected.short}", Place(path))
    image = decoded(content)
    if isinstance(image, str):
        raise bad_input("unreadable", f"this PNG file is damaged: {image}", Place(path))
    return image


def png_size(content: bytes) -> PixelSize | None:
    """The size that the first chunk of a PNG says; None for a damaged one."""
    chunk = content[len(_SIGNATURE) : len(_SIGNATURE) + _HEADER_CHUNK]
    whole = len(chunk) == _HEADER_CHUNK and chunk[:8] == b"\0\0\0\x0dIHDR"
    if not whole or zlib.crc32(chunk[4:21]) != int.from_bytes(chunk[21:], "big"):
        return None
    return PixelSize(int.from_bytes(chunk[8:12], "big"), int.from_bytes(chunk[12:16], "big"))


def image_of(message: Message, camera: Camera, place: Place, where: str) -> ImageArray | str:
    """The image of a `sensor_msgs/CompressedImage` or `Image`; what is wrong if it is damaged, as one in thousands may.

    place, where: the file, and the message in it. Raises InputError for an image that has another size than the camera,
    or is packed in a way that is not read.
    """
    named, expected = f"the image of {where}", PixelSize(camera.width, camera.height)
    wrong_size = f"{named} is {{}}, the workspace says {expected.short}"
    if not hasattr(message, "encoding"):
        content = bytes(message.data)
        size = png_size(content) if content.startswith(_SIGNATURE) else _jpeg_size(content)
        if size is None:
            what = f"as `{message.format}`" if message.format else "in a way that is not said"
            return f"{named}, packed {what}, is no whole JPEG or PNG"
        if size != expected:
            raise bad_input("wrong-size", wrong_size.format(size.short), place)
        image = decoded(content)
        if isinstance(image, str):
            return f"{named} is damaged: {image}"
        return image if image.shape[:2] == (camera.height, camera.width) else f"{named} is damaged: it is not whole"
    encoding = message.encoding
    if encoding not in _CONVERSIONS:
        known = ", ".join(_CONVERSIONS)
        raise bad_input("unreadable", f"{named} has the encoding `{encoding}`; read are {known}", place)
    found, channels = PixelSize(message.width, message.height), _CHANNELS.get(encoding, 1)
    if found != expected:
        raise bad_input("wrong-size", wrong_size.format(found.short), place)
    if channels == 2 and found.width % 2:
        raise bad_input("unreadable", f"{named} has the encoding `{encoding}`, but an odd width", place)
    row = found.width * channels
    if message.step < row or len(message.data) < message.step * found.height:
        return f"{named} has fewer bytes than its {found.short} pixels need"
    rows = np.asarray(message.data, np.uint8)[: message.step * found.height].reshape(found.height, message.step)
    pixels = np.ascontiguousarray(rows[:, :row]).reshape(found.height, found.width, -1).squeeze()
    conversion = _CONVERSIONS[encoding]
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


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


def _jpeg_size(content: bytes) -> PixelSize | None:
    """The size in the frame header of a JPEG; None for what is no JPEG, or one that is cut off."""
    at = 2
    if not content.startswith(_JPEG) or _JPEG_END not in content[-1024:]:
        return None
    while at + 9 <= len(content) and content[at] == 0xFF:
        kind = content[at + 1]
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(content[at + k : at + k + 2], "big") for k in (5, 7))
            return PixelSize(width, height)
        at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return None
