"""Slits before a camera: `python -m tests.slits [CELLS [FIRST]]`, a hundred by default; part of `make trials`.

The truth is computed every millisecond with rays of its own. Prints a line for each cell with an event: its length, and
whether the default sampling found it. Exit code 1 if one of `MAX_STEP` or more was missed.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Mask
from sqrp_cli.study.quality import average_quality
from sqrp_cli.study.sampling import MAX_STEP
from sqrp_cli.study.stage import Samples
from tests.slits.events import Event, events_of
from tests.slits.rays import Rays, seen
from tests.slits.slits import SlitCell, every_step, slit_cell, watched_box


class Judged(NamedTuple):
    """The events of a cell, with what is said of the whole."""

    events: list[Event]
    quality: float
    """Q_avg as stated."""
    truth: float
    """Q_avg by the rays."""


def judged(cell: SlitCell) -> Judged:
    """All gains and losses of sight of a cell by rays, each with whether the default sampling found it."""
    study, samples = cell.study, every_step(cell.study.stage)
    covered = covered_by_rays(cell, samples)
    events = events_of(study.timeline, samples, covered)
    steps = np.diff(samples.t) * (np.diff(samples.piece) == 0)
    truth = float(steps[covered[1:] & covered[:-1]].sum()) / study.timeline.T
    return Judged(events, average_quality(study.timeline) or 0.0, truth)


def covered_by_rays(cell: SlitCell, samples: Samples) -> Mask:
    """Whether the only camera sees the only box in each sample, shape (m,)."""
    study, box = cell.study, watched_box(cell.study)
    states = study.stage.states(samples)
    X_WB = np.broadcast_to(states.box_poses(box), (len(samples), 4, 4))
    (camera,), solids = cell.observer.cameras, cell.observer.solids
    rays = Rays([solid for solid in solids if solid.name not in study.targets[0].boxes[0].encloses], states.X_WF)
    least = study.targets[0].boxes[0].limits.min_visible
    return seen(camera, states.camera_poses(camera)[0], box, X_WB, rays, least=least)


def main(arguments: Sequence[str]) -> int:
    """Print a line for each cell, and the summary."""
    count, first = (int(arguments[0]) if arguments else 100), (int(arguments[1]) if len(arguments) > 1 else 0)
    events, errors = list[Event](), list[float]()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            cell = slit_cell(seed, Path(folder) / f"{seed}")
            if cell is None:
                print(f"{seed:4}  cannot be done", flush=True)
                continue
            found = judged(cell)
            events += found.events
            errors.append(100 * abs(found.quality - found.truth))
            said = ", ".join(
                f"{'gain' if event.gained else 'loss'} {1000 * event.length:.0f} ms{'' if event.found else ' MISSED'}"
                for event in sorted(found.events, key=lambda event: event.length)[:4]
            )
            print(f"{seed:4}  {cell.kind:5} error of Q {errors[-1]:5.2f} points  {said}", flush=True)
    return _summary(events, errors)


def _summary(events: Sequence[Event], errors: Sequence[float]) -> int:
    edges = [0.0, 0.02, MAX_STEP, 0.1, 0.2, np.inf]
    for low, high in pairwise(edges):
        those = [event for event in events if low <= event.length < high]
        if those:
            below = f" to {1000 * high:.0f}" if np.isfinite(high) else " or more"
            print(f"{1000 * low:.0f}{below} ms: {sum(one.found for one in those)} of {len(those)} found")
    missed = [event for event in events if event.length >= MAX_STEP and not event.found]
    print(f"error of Q: median {np.median(errors):.3f}, most {max(errors):.3f} points in {len(errors)} cells")
    print(f"{len(missed)} of {MAX_STEP * 1000:.0f} ms or more missed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
