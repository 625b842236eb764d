"""Windows: when a camera has all that must be seen in free view for as long as it needs, and what would open one."""

from __future__ import annotations

from math import ceil

import numpy as np

from sqrp_cli.logic.formula_time import TimeInterval, merge
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.observer import sees_all
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.result import FreeView, FreeViews
from sqrp_cli.study.verdict import stretches


def free_views(cell: Cell, analysis: Analysis, needed: float) -> tuple[tuple[FreeView, ...], FreeViews]:
    """The free views of a motion that are long enough, in order of time, and what is to be said of all.

    The verdicts of every camera are known; needed: how long one has to be [s]. A free view begins with the first and
    ends with the last of neighbouring samples in which the camera sees all that the state requires; changes between
    samples are located as the sampling says.
    """
    timeline = analysis.timeline
    t, observation = timeline.samples.t, timeline.observation
    sees = np.array([sees_all(boxes) for boxes in observation.full_matrix])  # (targets, m, cameras)
    free = (sees | ~observation.required.T[:, :, None]).all(axis=0) & timeline.monitored[:, None]
    each = [
        FreeView(start=float(t[rows[0]]), end=float(t[rows[-1]]), cameras=(camera.name,))
        for index, camera in enumerate(cell.observer.cameras)
        for rows in stretches(free[:, index])
    ]
    lasts = {one: one.end - one.start for one in each}
    enough = sorted((one for one in each if lasts[one] >= needed - 1e-9), key=lambda one: (one.start, one.cameras))
    longest = dict.fromkeys((camera.name for camera in cell.observer.cameras), 0.0)
    longest |= {one.cameras[0]: lasts[one] for one in sorted(each, key=lasts.__getitem__)}
    nearest = None if enough else max(each, key=lambda one: (lasts[one], -one.start), default=None)
    need = f"{1000 * needed:.0f} ms"
    times = len(merge(TimeInterval(one.start, one.end) for one in enough))  # of one camera after the other or several
    words = f"{times} time{'s' * (times != 1)} all that must be seen is in free view of a camera for {need}."
    if nearest is not None:
        missing = ceil(1000 * (needed - lasts[nearest]) - 1e-6)  # rounded, it might be too short
        wait = f"wait {missing} ms at {0.5 * (nearest.start + nearest.end):.3f} s"
        words = f"Never for {need}; to open a window, {wait}, in view of camera `{nearest.cameras[0]}`."
    elif not enough:
        words = f"Never for {need}: at no instant does one camera see all at once, so no wait helps; see advise."
    return tuple(enough), FreeViews(needed=needed, longest=longest, wait=nearest, words=words)
