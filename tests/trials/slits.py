"""Random cells in which a slit before the only camera shows what the tool carries for a moment.

The default sampling must find all that lasts long of what cameras see every millisecond. What they see at an instant
is judged in tests/sight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask, box_corners, look_at, matrix_to_quaternion, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.observer import Observer
from sqrp_cli.skill.target_box import TargetBox
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.find import WantedWay, find_way
from sqrp_cli.study.sampling import MAX_STEP, Adaptive
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import Timeline
from sqrp_cli.study.timeline import look_at as look_at_samples
from sqrp_cli.task.task import read_task
from tests.cells import read_cell, write_cell
from tests.random_cell import Crowd, random_cell

SHORTEST, LONGEST = 0.013, 0.144
"""Range of the durations that slits are made for [s]."""

SLOWEST = 0.02
"""Least speed of the box across the view at the event [m/s]."""

PLATE = 0.7
"""Extent of a plate along the slit and away from it [m]."""

STEP = 1e-3
"""Time between the states in which the truth is computed [s]."""

TASK = "pickup green"
CAMERA = {
    "image": {"width": 1280, "height": 960, "horizontal_fov": "60 deg"},
    "near": "20 cm", "far": "6 m", "rate": "10 Hz", "latency": "50 ms",
}  # fmt: skip


def _study_of(cell: Cell) -> Analysis | None:
    """The fastest way of the first candidate of the task that can be done; None if there is none."""
    for candidate in read_task(TASK, cell.workspace).candidates:
        found = find_way(cell, candidate, cell.initial_world, Adaptive(), WantedWay(fastest=True))
        if not isinstance(found, Infeasible):
            return found.analysis
    return None


def every_step(stage: Stage) -> Samples:
    """A sample at every `STEP` of every piece in which something must be seen."""
    t, piece = [], []
    for number, one in enumerate(stage.pieces):
        if one.literals and one.length > 0:
            times = np.linspace(one.start, one.end, max(2, int(np.ceil(one.length / STEP)) + 1))
            t.append(times)
            piece.append(np.full(len(times), number))
    return Samples(np.concatenate(piece), np.concatenate(t))


def _slit_cell(seed: int, folder: Path) -> tuple[Observer, Analysis, str] | None:
    """The cell of a seed, the way in which its task is done, if it can be, and what its detector needs of the box."""
    rng = np.random.default_rng([seed, 27])
    random_cell(folder, Crowd(seed, objects=3, cameras=1))
    skill = folder / "skills" / "pickup" / "skill.yaml"
    said = skill.read_text().replace(" and not obj_on_table)", ")").replace(" and obj_on_table)", ")")
    skill.write_text(said.replace("encloses: [object]", "encloses: [object, suction_cup, suction_tube]"))
    document, whole = read_cell(folder), rng.random() < 0.75
    for detector in document["detectors"].values():
        detector["min_visible"] = 1 if whole else detector["min_visible"]
    document["cameras"] = {"far": {**CAMERA, "pose": {"position": [2.0, 0.0, 1.0], "look_at": [0.0, 0.0, 0.2]}}}
    write_cell(document, folder)
    open_study = _study_of(open_cell(folder).cell)
    if open_study is None:
        return None
    samples, box = every_step(open_study.planned.stage), open_study.planned.targets[0].boxes[0]
    X_WB = open_study.planned.stage.states(samples).box_poses(box)
    eye, aim, plates = slit_before(rng, samples, X_WB, box)
    document["cameras"]["far"]["pose"] = {"position": eye.round(9).tolist(), "look_at": aim.round(9).tolist()}
    for number, (X, size) in enumerate(plates, 1):
        turned = {"position": X[:3, 3].round(9).tolist(), "quaternion": matrix_to_quaternion(X[:3, :3]).tolist()}
        plate = {"type": "plate", "size": size.round(9).tolist(), "fixed": True, "pose": turned}
        document["objects"][f"plate{number}"] = plate
    write_cell(document, folder)
    cell = open_cell(folder).cell
    analysis = _study_of(cell)
    return None if analysis is None else (cell.observer, analysis, "whole" if whole else "half")


def slit_before(
    rng: np.random.Generator, samples: Samples, X_WB: Array, box: TargetBox
) -> tuple[Array, Array, list[tuple[Array, Array]]]:
    """A camera behind a slit that shows a box for a moment, if nothing else hides it.

    samples: `STEP` apart; X_WB: poses of the box in them, shape (m, 4, 4). The instant and about how long it lasts are
    random. Returns where the camera is, the point that it looks at, and poses and sizes of the plates.
    """
    corners = transform(X_WB, box_corners(np.array(box.size) - 0.002))
    middle = corners.mean(axis=1)
    while True:  # until something moves then, and no plate stands in the table
        row = int(rng.integers(1, len(samples) - 1))
        angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.2)
        eye = middle[row] + rng.uniform(1.8, 2.6) * np.array([np.cos(angle), np.sin(angle), height])
        X_WC = look_at(eye, middle[row])
        plane = (corners - eye) @ X_WC[:3, :3]
        spots = plane[..., :2] / plane[..., 2:]
        moved = spots[row + 1].mean(axis=0) - spots[row - 1].mean(axis=0)
        if samples.piece[row - 1] != samples.piece[row + 1] or np.linalg.norm(moved) < STEP * SLOWEST:
            continue
        away = float(rng.uniform(0.3, 0.45))
        across = moved / np.linalg.norm(moved)
        along = spots @ across
        width = 2 * away * _half_width(along - along[row].mean(), row, samples, rng.uniform(SHORTEST, LONGEST))
        side, normal = X_WC[:3, :2] @ across, X_WC[:3, 2]
        X_WP = np.eye(4)
        X_WP[:3, :3] = np.stack([side, np.cross(normal, side), normal], axis=1)
        center = eye + away * (normal + X_WC[:3, :2] @ across * along[row].mean())
        plates = []
        for offset in (-(PLATE + width) / 2, (PLATE + width) / 2):
            X = X_WP.copy()
            X[:3, 3] = center + offset * side
            plates.append((X, np.array([PLATE, PLATE, 1e-3])))
        lowest = min(float(transform(X, box_corners(size))[:, 2].min()) for X, size in plates)
        if lowest > 0.0:
            return eye, middle[row], plates


def _half_width(along: Array, row: int, samples: Samples, duration: float) -> float:
    """Half the width, at unit distance, of a slit at 0 through which a box is seen around a row for a duration [s].

    along: the box's corners across it, shape (m, 8).
    """
    low, high = along.min(axis=1), along.max(axis=1)
    smallest, largest = 0.5 * float((high - low)[row]), 1.0
    for _ in range(50):
        half = 0.5 * (smallest + largest)
        hidden = np.flatnonzero((low < -half) | (high > half))
        first, last = hidden[hidden < row].max(initial=0), hidden[hidden > row].min(initial=len(along) - 1)
        lasts = 0.0 if row in hidden else samples.t[last] - samples.t[first] - STEP
        smallest, largest = (half, largest) if lasts < duration else (smallest, half)
    return largest


def events_of(timeline: Timeline, samples: Samples, covered: Mask) -> Iterator[tuple[bool, float, bool]]:
    """The times in which a box is seen between two in which it is not, or the other way round.

    covered: the truth in dense samples; no event goes on where nothing is asked. Yields of each event whether it is
    seen then, how long it lasts [s], and whether a sample of the time line says so.
    """
    edges = np.flatnonzero(covered[1:] != covered[:-1])
    for first, last in pairwise(edges.tolist()):
        start, end = float(samples.t[first + 1]), float(samples.t[last])
        if np.diff(samples.t[first + 1 : last + 1]).max(initial=0.0) < 0.01:
            own = timeline.samples.t
            within = (own >= start) & (own <= end) & timeline.monitored
            known = bool((timeline.covered[within] == covered[first + 1]).any())
            yield bool(covered[first + 1]), end - start, known


def slits(number: int, folder: Path) -> dict[str, Any] | None:
    """The events of a cell, each [gained, length, found], and the error of its Q_avg [points]."""
    made = _slit_cell(number, folder / "cell")
    if made is None:
        return None
    observer, analysis, kind = made
    samples = every_step(analysis.planned.stage)
    covered = ~look_at_samples(observer, analysis.planned, samples).blind
    steps = np.diff(samples.t) * (np.diff(samples.piece) == 0)
    truth = float(steps[covered[1:] & covered[:-1]].sum()) / analysis.planned.T
    error = 100 * abs((analysis.timeline.qualities.q_avg or 0.0) - truth)
    events = sorted(events_of(analysis.timeline, samples, covered), key=lambda event: event[1])
    said = ", ".join(
        f"{'gain' if gained else 'loss'} {1000 * length:.0f} ms{'' if found else ' MISSED'}"
        for gained, length, found in events[:4]
    )
    return {"said": f"{kind:5} error of Q {error:5.2f} points  {said}", "error": error, "events": events}


def slits_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    events, errors = [event for one in found for event in one["events"]], [one["error"] for one in found]
    yield f"error of Q: median {np.median(errors):.3f}, most {max(errors):.3f} points", True
    for low, high in pairwise([0.0, 0.02, MAX_STEP, 0.1, 0.2, np.inf]):
        those = [known for _, length, known in events if low <= length < high]
        said = f"from {1000 * low:.0f} to {1000 * high:.0f} ms: {sum(those)} of {len(those)} found"
        yield said, low < MAX_STEP or all(those)
