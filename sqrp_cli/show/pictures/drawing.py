"""Outlines, captions and contact sheets. The only module that knows Pillow."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

from sqrp_cli.camera.projection import Projection
from sqrp_cli.errors import needed
from sqrp_cli.geometry import BOX_SIGNS, Array
from sqrp_cli.show.pages.assembly import Color, visible
from sqrp_cli.show.pictures.camera_image import Image

LINE = 19  # height of a line of text [pixels]
_MARGIN = 8
_THUMB = 320  # width of a picture in a contact sheet [pixels]
_TALLEST = 4 * _THUMB  # greatest height of such a picture; an image may be a single column
_INK, _FAINT, _PAPER = (23, 33, 43), (91, 104, 117), (255, 255, 255)
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(BOX_SIGNS[a] - BOX_SIGNS[b]).sum() == 2]
_LEAST_Z = 0.01  # edges are drawn from this distance to the camera on [m]
_FARTHEST = 1e4  # edges are drawn up to this distance outside the image [pixels]
Caption = tuple[str, Color | None]
"""A line under a picture, after a spot of a colour if there is one."""
BoxOutline = tuple[Array, Color]
"""A box to draw around: its corners in the optical frame, (8, 3) [m], in the order of `BOX_SIGNS`."""
Picture = tuple[Any, Sequence[Caption]]
"""A camera's image with outlined boxes, as Pillow's image, and the lines under it."""


def outlined(
    image: Image, projection: Projection, outlines: Sequence[BoxOutline], captions: Sequence[Caption]
) -> Picture:
    """An image with boxes outlined."""
    photo = pillow("Image").fromarray(image)
    draw = pillow("ImageDraw").Draw(photo)
    for corners, outer in outlines:
        edge = _silhouette(corners, projection)
        for color, width in ((_PAPER, 6), (outer, 3)):
            if edge:
                draw.line([*edge, *edge[:2]], fill=color, width=width, joint="curve")
    return photo, captions


def contact_sheet(title: str, rows: Sequence[tuple[str, Sequence[Picture]]]) -> Any:  # noqa: ANN401
    """Rows of small pictures, each row with a heading, as Pillow's image."""
    resampling = pillow("Image").Resampling.LANCZOS

    thumbs: list[tuple[str, list[Any]]] = []
    for heading, row in rows:
        thumbs.append((heading, []))
        for photo, captions in row:
            height = min(max(1, round(photo.height * _THUMB / photo.width)), _TALLEST)
            thumbs[-1][1].append(framed(photo.resize((_THUMB, height), resampling), captions, 13))
    columns = max(len(pictures) for _, pictures in thumbs)
    heights = [max(entry.height for entry in pictures) + LINE + _MARGIN for _, pictures in thumbs]
    top = LINE + 3 * _MARGIN
    size = (columns * (_THUMB + _MARGIN) + _MARGIN, top + sum(heights))
    sheet = pillow("Image").new("RGB", size, _PAPER)
    draw, font = pillow("ImageDraw").Draw(sheet), pillow("ImageFont").load_default
    draw.text((_MARGIN, _MARGIN), visible(title), fill=_INK, font=font(20))
    for (heading, pictures), height in zip(thumbs, heights, strict=True):
        draw.text((_MARGIN, top), visible(heading), fill=_FAINT, font=font(15))
        for column, entry in enumerate(pictures):
            sheet.paste(entry, (_MARGIN + column * (_THUMB + _MARGIN), top + LINE + _MARGIN // 2))
        top += height
    return sheet


def _silhouette(corners: Array, projection: Projection) -> list[tuple[float, float]]:
    """The outline of a box in the image, its edges bent by the lens, as far as it lies before the camera.

    The convex hull of points on the edges, by Andrew's monotone chain.
    """
    points = np.concatenate([np.linspace(corners[a], corners[b], 17) for a, b in _EDGES])
    pixels, inside = projection.pixels(points[points[:, 2] > _LEAST_Z])
    pixels = pixels[inside]
    if len(pixels) < 3 or np.abs(pixels).max() >= _FARTHEST:
        return []
    ordered = sorted(map(tuple, pixels.tolist()))
    hull: list[tuple[float, float]] = []
    for chain in (ordered, ordered[::-1]):
        start = len(hull)
        for x, y in chain:
            while len(hull) - start >= 2:
                (x0, y0), (x1, y1) = hull[-2:]
                if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                    break
                hull.pop()
            hull.append((x, y))
        hull.pop()
    return hull


def framed(photo: Any, captions: Sequence[Caption], size: int = 14) -> Any:  # noqa: ANN401
    """A photo with lines of text under it; long lines are cut. Both are Pillow's images."""
    frame = pillow("Image").new("RGB", (photo.width, photo.height + len(captions) * LINE + 2 * _MARGIN), _PAPER)
    frame.paste(photo, (0, 0))
    draw, font = pillow("ImageDraw").Draw(frame), pillow("ImageFont").load_default(size)
    for index, (said, color) in enumerate(captions):
        x, y = _MARGIN, photo.height + _MARGIN + index * LINE
        if color is not None:
            draw.rounded_rectangle((x, y + 4, x + 9, y + 13), radius=3, fill=color)
            x += 16
        text = visible(said)
        while draw.textlength(text, font=font) > photo.width - _MARGIN - x and len(text) > 1:
            text = text[:-2] + "…"
        draw.text((x, y), text, fill=_FAINT if index else _INK, font=font)
    return frame


def pillow(module: str) -> ModuleType:
    """A module of Pillow. Raises InputError, with the command that installs it, where it is missing."""
    from importlib import import_module

    with needed("pictures need the Python package `pillow`, which is not installed", "pip install pillow"):
        return import_module(f"PIL.{module}")
