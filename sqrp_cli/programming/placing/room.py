"""Which places for a camera are in the way: of the robot, of anything solid, of another camera, of its sight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from sqrp_cli.geometry import Mask, inverse
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.workspace.mounts import Spot
from sqrp_cli.programming.advice.room import touched
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.sampling import Adaptive, first_samples
from sqrp_cli.programming.placing.scenes import JudgedWay
from sqrp_cli.programming.sensing.observer import Observer

_TOGETHER = 400_000
"""Places to compare with a solid at once, counted in every state, to bound the memory."""


def blocked(cell: Cell, way: JudgedWay, spots: Sequence[Spot]) -> Mask:
    """Whether the body of a camera at each place touches anything during a motion, shape (spots,).

    What is fixed to the same link as a place is not looked at.
    """
    found = np.zeros(len(spots), dtype=bool)
    samples = first_samples(Adaptive(), way.scene.stage, Observer((), cell.observer.solids), way.scene.targets)
    states = way.scene.stage.states(samples)
    order = sorted(range(len(spots)), key=lambda index: (spots[index].frame, spots[index].entry.body))
    for (frame, body), group in groupby(order, key=lambda index: (spots[index].frame, spots[index].entry.body)):
        rows = np.array(list(group))
        places = np.stack([spots[row].position for row in rows])
        X_FW = inverse(states.X_WF[frame])
        for solid in cell.observer.solids:
            X_FP = X_FW @ states.X_WF[solid.part.parent]
            if frame != WORLD and float(np.ptp(X_FP, axis=0).max()) < 1e-9:
                continue
            step = max(1, _TOGETHER // len(X_FP))
            for start in range(0, len(rows), step):
                here = np.flatnonzero(~found[rows[start : start + step]]) + start
                if len(here):
                    found[rows[here]] = touched(solid, X_FP, places[here], 0.5 * body)
    return found


def pairs_apart(spots: Sequence[Spot]) -> Iterator[tuple[int, int]]:
    """The pairs of places in one frame at which the bodies of two cameras would touch each other."""
    places, radii = np.stack([spot.position for spot in spots]), np.array([0.5 * spot.entry.body for spot in spots])
    frames = np.unique([spot.frame for spot in spots], return_inverse=True)[1]
    for first in range(len(spots) - 1):
        gap = np.linalg.norm(places[first + 1 :] - places[first], axis=1) - radii[first + 1 :] - radii[first]
        for other in np.flatnonzero((gap < -1e-9) & (frames[first + 1 :] == frames[first])).tolist():
            yield first, first + 1 + other
