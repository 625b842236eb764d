"""What every camera sees in the middle of every blind interval, as picture files. The only module that knows Pillow."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from io import BytesIO
from math import ceil, sqrt
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.workspace_file import check_no_workspace
from sqrp_cli.errors import Place, bad_input, needed
from sqrp_cli.geometry import BOX_SIGNS, Array, box_corners, inverse, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import make_folder, write_atomically
from sqrp_cli.show.documents.analysis_shown import verdict_shown
from sqrp_cli.show.pages.assembly import COVERED, CULPRIT, HIDDEN, Color, solid_colors, visible
from sqrp_cli.show.pictures.camera_image import RayScene, check_rays
from sqrp_cli.show.sentences import part_shares_in_words
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.in_the_way import HiddenViews, hidden_views
from sqrp_cli.study.verdict import stretches

LINE = 19  # height of a line of text [pixels]
_MARGIN = 8
_THUMB = 320  # width of a picture in a contact sheet [pixels]
_TALLEST = 4 * _THUMB  # greatest height of such a picture; an image may be a single column
_INK, _FAINT, _PAPER = (23, 33, 43), (91, 104, 117), (255, 255, 255)
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(BOX_SIGNS[a] - BOX_SIGNS[b]).sum() == 2]
_LEAST_Z = 0.01  # edges are drawn from this distance to the camera on [m]
_FARTHEST = 1e4  # edges are drawn up to this distance outside the image [pixels]
Caption = tuple[str, Color | None]  # A line under a picture, after a spot of a colour if there is one
Picture = tuple[Any, Sequence[Caption]]
"""A camera's image with outlined boxes, as Pillow's image, and the lines under it."""
SHEET = "contact-sheet.png"
MOST_PIXELS = 1_000_000  # most pixels of a picture; a camera with more gets a smaller picture
BlindInterval = tuple[float, float, int]
"""A stretch in which a state is not covered, from when to when [s], and the sample nearest to its middle."""


def check_pictures(folder: Path) -> None:
    """Raises InputError, before anything is computed, where a library is missing or `folder` cannot be one."""
    check_rays()
    pillow("Image")
    check_no_workspace(folder)
    if folder.exists() and not folder.is_dir():
        raise bad_input("cannot-write", "this is a file; expected the name of a folder", Place(folder))


def blind_intervals(analysis: Analysis) -> Iterator[BlindInterval]:
    """The stretches of a candidate's motion in which a state is not covered."""
    timeline = analysis.timeline
    t = timeline.samples.t
    for rows in stretches(timeline.observation.blind):
        start, end = float(t[rows[0]]), float(t[rows[-1]])
        yield start, end, int(rows[np.abs(t[rows] - 0.5 * (start + end)).argmin()])


def write_pictures(cell: Cell, analysis: Analysis, folder: Path, advance: Callable[[], object] = lambda: None) -> int:
    """Write a picture per blind interval and camera, and a sheet of all; returns how many intervals there are."""

    def write(name: str, image: Any) -> None:  # noqa: ANN401 - Pillow's
        make_folder(folder)
        buffer = BytesIO()
        image.save(buffer, format="PNG", optimize=True)
        write_atomically(folder / name, buffer.getvalue())

    sheet, intervals = [], list(blind_intervals(analysis))
    views = hidden_views(cell, analysis, np.array([row for _, _, row in intervals], dtype=np.int64))
    for number, (start, end, row) in enumerate(intervals, 1):
        samples = analysis.timeline.samples.some([row])
        states = analysis.planned.stage.states(samples)
        scene, pictures = RayScene.of(cell, states), []
        for index, camera in enumerate(cell.observer.cameras):
            made = _picture(cell, analysis, row, states, scene, index, views)
            name = file_name(f"{number:02d}_{start:.1f}s-{end:.1f}s_{camera.name}")
            write(f"{name}.png", framed(*made))
            pictures.append(made)
            advance()
        if pictures:
            sheet.append((f"blind from {start:.1f} s to {end:.1f} s; pictures of {samples.t[0]:.1f} s", pictures))
    if sheet:
        write(SHEET, contact_sheet(f"{analysis.planned.candidate.name} in {cell.workspace.name}", sheet))
    return len(sheet)


def _picture(
    cell: Cell,
    analysis: Analysis,
    row: int,
    states: SceneStates,
    scene: RayScene,
    index: int,
    views: HiddenViews,
) -> Picture:
    """The picture of a camera, by index, in a sample: each target to be seen, its first failure, and what hides it."""
    camera = cell.observer.cameras[index]
    step = ceil(sqrt(camera.width * camera.height / MOST_PIXELS))
    if step > 1:  # the same view in fewer pixels
        matrix = np.diag([1 / step, 1 / step, 1.0]) @ camera.matrix
        matrix[:2, 2] -= 0.5 - 0.5 / step  # the centre of the first pixel is (0, 0)
        width, height = max(1, camera.width // step), max(1, camera.height // step)
        camera = replace(camera, width=width, height=height, matrix=matrix)
    colors, observation = solid_colors(cell), analysis.timeline.observation
    smaller = f", 1/{step} of its size" if step > 1 else ""
    captions: list[Caption] = [(f"{camera.name} at {analysis.timeline.samples.t[row]:.2f} s{smaller}", None)]
    outlines = []
    X_WC = states.camera_poses(camera)[0]
    for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
        if not observation.required[row, column]:
            continue
        first, box_of = first_failing(boxes, [row])
        number = int(box_of[0, index])
        failing = verdict_shown(cell.observer, first, 0, index, target.boxes[number].name)
        which = f"box {failing.box} is " if failing.box is not None and len(target.boxes) > 1 else ""
        why, color = ("covered", COVERED) if failing.covered else (f"{which}{failing.words}", HIDDEN)
        captions.append((f"{target.atom}: {why}", color))
        if parts := views.get((column, number, row, index)):
            hidden = sum(part.share for part in parts)
            captions.append((f"hidden {100 * hidden:.1f} %: {part_shares_in_words(parts)}", None))
        for box, verdicts in zip(target.boxes, boxes, strict=True):
            corners = transform(inverse(X_WC) @ states.box_poses(box)[0], box_corners(box.size))
            covered = verdicts.cause[row, index] == Cause.NONE
            outlines.append((corners, COVERED if covered else HIDDEN))
        if failing.limit in (Cause.HIDDEN, Cause.SAME_COLOUR):
            solids = zip(cell.observer.solids, colors, strict=True)
            colors = [CULPRIT if solid.name == failing.by else color for solid, color in solids]
    photo = pillow("Image").fromarray(scene.image(camera, X_WC, colors))
    draw = pillow("ImageDraw").Draw(photo)
    for corners, outer in outlines:
        edge = _silhouette(corners, Projection(camera))
        for color, width in ((_PAPER, 6), (outer, 3)):
            if edge:
                draw.line([*edge, *edge[:2]], fill=color, width=width, joint="curve")
    return photo, captions


def file_name(name: str) -> str:
    """A name that every file system accepts."""
    return re.sub(r"[^\w.=+-]+", "_", name).strip("_.") or "unnamed"


# Outlines, captions and contact sheets


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
    """The outline of a box in the image, bent by the lens: the convex hull of its edges (Andrew's monotone chain)."""
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
    with needed("pictures need the Python package `pillow`, which is not installed", "pip install pillow"):
        return import_module(f"PIL.{module}")
