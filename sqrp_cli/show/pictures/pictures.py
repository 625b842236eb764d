"""What every camera sees in the middle of every blind interval, as picture files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import BytesIO
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.workspace_file import check_no_workspace
from sqrp_cli.errors import Place, bad_input
from sqrp_cli.geometry import box_corners, inverse, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import make_folder, write_atomically
from sqrp_cli.show.documents.analysis_shown import verdict_shown
from sqrp_cli.show.pages.assembly import COVERED, CULPRIT, HIDDEN, solid_colors
from sqrp_cli.show.pictures import drawing
from sqrp_cli.show.pictures.camera_image import RayScene, check_rays
from sqrp_cli.show.sentences import part_shares_in_words
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.in_the_way import HiddenViews, hidden_views
from sqrp_cli.study.verdict import stretches

SHEET = "contact-sheet.png"
MOST_PIXELS = 1_000_000  # most pixels of a picture; a camera with more gets a smaller picture
BlindInterval = tuple[float, float, int]
"""A stretch in which a state is not covered, from when to when [s], and the sample nearest to its middle."""


def check_pictures(folder: Path) -> None:
    """Raises InputError, before anything is computed, where a library is missing or `folder` cannot be one."""
    check_rays()
    drawing.pillow("Image")
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
    """Write a picture per blind interval and camera, and all of them on one sheet; returns the number of intervals.

    advance: called after each picture. Raises InputError where a file cannot be written or a library is missing.
    """

    def write(name: str, image: Any) -> None:  # noqa: ANN401 - Pillow's
        make_folder(folder)
        buffer = BytesIO()
        image.save(buffer, format="PNG", optimize=True)
        write_atomically(folder / name, buffer.getvalue())

    sheet, intervals = [], list(blind_intervals(analysis))
    views = hidden_views(cell, analysis, np.array([row for _, _, row in intervals], dtype=np.int64))
    for number, (start, end, row) in enumerate(intervals, 1):
        t, states = (
            analysis.timeline.samples.t[row],
            analysis.planned.stage.states(analysis.timeline.samples.some([row])),
        )
        scene, pictures = RayScene.of(cell, states), []
        for index, camera in enumerate(cell.observer.cameras):
            made = _picture(cell, analysis, row, states, scene, index, views)
            name = file_name(f"{number:02d}_{start:.1f}s-{end:.1f}s_{camera.name}")
            write(f"{name}.png", drawing.framed(*made))
            pictures.append(made)
            advance()
        if pictures:
            sheet.append((f"blind from {start:.1f} s to {end:.1f} s; pictures of {t:.1f} s", pictures))
    if sheet:
        write(SHEET, drawing.contact_sheet(f"{analysis.planned.candidate.name} in {cell.workspace.name}", sheet))
    return len(sheet)


def _picture(
    cell: Cell,
    analysis: Analysis,
    row: int,
    states: SceneStates,
    scene: RayScene,
    index: int,
    views: HiddenViews,
) -> drawing.Picture:
    """The picture of one camera, by index, with each target that must be seen then and the first failure of its boxes.

    row: of the sample that is shown, with its states. views: what hides the boxes that it does not see.
    """
    camera = cell.observer.cameras[index]
    step = ceil(sqrt(camera.width * camera.height / MOST_PIXELS))
    if step > 1:  # the same view in fewer pixels
        matrix = np.diag([1 / step, 1 / step, 1.0]) @ camera.matrix
        matrix[:2, 2] -= 0.5 - 0.5 / step  # the centre of the first pixel is (0, 0)
        width, height = max(1, camera.width // step), max(1, camera.height // step)
        camera = replace(camera, width=width, height=height, matrix=matrix)
    colors, observation = solid_colors(cell), analysis.timeline.observation
    smaller = f", 1/{step} of its size" if step > 1 else ""
    captions: list[drawing.Caption] = [(f"{camera.name} at {analysis.timeline.samples.t[row]:.2f} s{smaller}", None)]
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
    return drawing.outlined(scene.image(camera, X_WC, colors), Projection(camera), outlines, captions)


def file_name(name: str) -> str:
    """A name that every file system accepts."""
    return re.sub(r"[^\w.=+-]+", "_", name).strip("_.") or "unnamed"
