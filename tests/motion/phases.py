"""Instants in every phase of a trajectory."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, ranges
from sqrp_cli.trajectory import Trajectory


def phase_samples(trajectory: Trajectory, least: int, whole: int = 0) -> Array:
    """Instants [s] in each phase of a trajectory, both its ends included as seen from within, shape (m,).

    A phase lasts from one break of law or path to the next. Each gets `least` of them, 2 or more, and its share of
    another `whole`, by how much of the path it covers.
    """
    law, breaks = trajectory.law, trajectory.law.breaks
    if joints := [law.time_at(s) for s in trajectory.path.breaks[1:-1]]:
        breaks = np.unique(np.concatenate([breaks, joints]))
    counts = least + np.ceil(whole * np.diff(law.positions(breaks))).astype(int)
    starts, ends = breaks[:-1], np.nextafter(breaks[1:], 0.0)
    phase, number = ranges(np.zeros(len(counts)), counts)
    instants: Array = number * ((ends - starts) / (counts - 1))[phase] + starts[phase]
    instants[np.cumsum(counts) - 1] = ends
    return instants
