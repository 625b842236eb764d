"""Windows: when a camera has all that must be seen in free view for as long as it needs, and what would open one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sqrp_cli.document import Record
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import sees_all
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.verdict import stretches


@dataclass(frozen=True, kw_only=True)
class FreeView(Record):
    """A stretch of time in which cameras see all that must be seen."""

    start: float
    """From the start of the motion [s]."""
    end: float
    """From the start of the motion [s]."""
    cameras: tuple[str, ...]
    """Each sees all of it, by itself."""


@dataclass(frozen=True, kw_only=True)
class FreeViews(Record):
    """Where the free views of a motion are long enough for an image and its transfer, and what would make one so."""

    needed: float
    """How long one has to be [s]."""
    found: tuple[FreeView, ...]
    """Those that are as long, in order of time."""
    longest: Mapping[str, float]
    """Of each camera, how long its longest one is, whether that is enough or not [s]."""
    wait: FreeView | None
    """Where none is long enough: the free view that comes nearest; null where there is none at any instant."""

    @property
    def words(self) -> str:
        """What is to be done, in a sentence."""
        need = f"{1000 * self.needed:.0f} ms"
        if self.found:
            return f"{len(self.found)} times all that must be seen is in free view of a camera for {need}."
        if self.wait is None:
            return f"Never for {need}: at no instant does one camera see all at once, so no wait helps; see advise."
        missing, middle = self.needed - (self.wait.end - self.wait.start), 0.5 * (self.wait.start + self.wait.end)
        wait = f"wait {1000 * missing:.0f} ms at {middle:.2f} s"
        return f"Never for {need}; to open a window, {wait}, in view of camera `{self.wait.cameras[0]}`."


def free_views(cell: Cell, analysis: Analysis, needed: float) -> FreeViews:
    """The free views of a motion whose verdicts of every camera are known; needed: how long they have to be [s].

    One begins with the first and ends with the last of neighbouring samples in which the camera sees all that the state
    requires; changes between samples are located as the sampling says.
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
    longest = {camera.name: 0.0 for camera in cell.observer.cameras}
    for one, length in lasts.items():
        longest[one.cameras[0]] = max(longest[one.cameras[0]], length)
    nearest = None if enough else max(each, key=lambda one: (lasts[one], -one.start), default=None)
    return FreeViews(needed=needed, found=tuple(enough), longest=longest, wait=nearest)
