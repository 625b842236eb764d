"""What every camera that may be chosen sees of every target in every sample, by the exact definitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Protocol

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.workspace.mounts import LensChoice, Spot
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.placing.scenes import Installation, JudgedWay, View
from sqrp_cli.programming.sensing.moved_camera import MovedCamera
from sqrp_cli.programming.sensing.observer import Observer

TOGETHER = 24
"""Poses judged as one piece of work."""


@dataclass(frozen=True, eq=False)
class ViewBatch:
    """A piece of the work: what some poses, with all lenses, see in a way."""

    way: JudgedWay
    spots: tuple[Spot, ...]
    """Those of the poses."""
    views: tuple[View, ...]
    """Their places are indices into `spots`."""
    lenses: tuple[LensChoice, ...]

    def seen(self, cell: Cell) -> Mask:
        """Whether each pose with each lens sees each item of the way, shape (lenses, views, items)."""
        return seen_by(cell, self.way, self.spots, self.views, self.lenses)


def view_batches(
    way: JudgedWay, spots: Sequence[Spot], views: Sequence[View], lenses: Sequence[LensChoice]
) -> list[ViewBatch]:
    """All of the work for a way."""
    found = []
    for first in range(0, len(views), TOGETHER):
        some = views[first : first + TOGETHER]
        own = sorted({view.spot for view in some})
        renamed = tuple(replace(view, spot=own.index(view.spot)) for view in some)
        found.append(ViewBatch(way, tuple(spots[place] for place in own), renamed, tuple(lenses)))
    return found


class Verdicts(Protocol):
    """Where verdicts come from: processes, a cluster, or a run before this one."""

    def of(self, parts: Sequence[ViewBatch], done: Callable[[int, Mask], None]) -> None:
        """Call `done` with the number of every portion, in any order, and what it sees."""


@dataclass(frozen=True, eq=False)
class LocalVerdicts:
    """Processes of this machine."""

    cell: Cell
    jobs: int = 1

    def of(self, parts: Sequence[ViewBatch], done: Callable[[int, Mask], None]) -> None:
        """See `Verdicts`."""

        def work(part: ViewBatch) -> Mask:
            return part.seen(self.cell)

        for number, sees in enumerate(in_processes(work, parts, min(self.jobs, len(parts)))):
            done(number, sees)


def seen_by(
    cell: Cell, way: JudgedWay, spots: Sequence[Spot], views: Sequence[View], lenses: Sequence[LensChoice]
) -> Mask:
    """Whether each pose with each lens sees each item of a way, shape (lenses, views, items)."""
    count = len(way.items.sample)
    sees = np.zeros((len(lenses), len(views), count), dtype=bool)
    if not count:
        return sees
    for _, group in groupby(range(len(views)), key=lambda index: spots[views[index].spot].frame):
        rows = list(group)
        at = [spots[views[row].spot] for row in rows]
        sees[:, rows] = _in_frame(cell.observer, way, at, [views[row] for row in rows], lenses)
    return sees


def _in_frame(
    observer: Observer, way: JudgedWay, spots: Sequence[Spot], views: Sequence[View], lenses: Sequence[LensChoice]
) -> Mask:
    """The same for poses that one frame carries."""
    boxes = [box for target in way.scene.targets for box in target.boxes]
    state, box, item = _looks(way)
    X_FC = np.stack([view.X_FC for view in views])
    moved = [
        MovedCamera(
            Projection.of(Installation(spots[0], views[0], lens).camera(lens.name)),
            boxes,
            observer.solids,
            way.states,
            box=box,
            state=state,
            lights=tuple(observer.lights.values()),
        )
        for lens in lenses
    ]
    within = np.stack([one.within(X_FC) for one in moved])
    for number, lens in enumerate(lenses):
        fits = np.array([any(one.name == lens.name for one in spot.lenses) for spot in spots], dtype=bool)
        within[number] &= fits[:, None]
    # What hides a box does not depend on the lens, what light shows of it on the gain alone. Where another box of its
    # target is outside, it need not be tested.
    begins = np.flatnonzero(np.diff(item, prepend=-1))
    whole = np.asarray(np.logical_and.reduceat(within, begins, axis=2))
    gains = np.array([lens.brightness if observer.lights else 1.0 for lens in lenses])
    sees = np.zeros_like(whole)
    for gain in np.unique(gains):
        alike = np.flatnonzero(gains == gain)
        asked: Mask = np.any(whole[alike], axis=0)[:, item]
        unhidden = _unhidden(moved[alike[0]], X_FC, asked)
        sees[alike] = whole[alike] & np.logical_and.reduceat(unhidden, begins, axis=1)
    return sees


def _unhidden(camera: MovedCamera, X_FC: Array, asked: Mask) -> Mask:
    """Which of the looks (v, n) that are asked for show enough of their boxes from poses (v, 4, 4), shape (v, n)."""
    found = np.zeros(asked.shape, dtype=bool)
    pose, look = np.nonzero(asked)
    for start in range(0, len(pose), _LOOKS_TOGETHER):
        chunk = slice(start, start + _LOOKS_TOGETHER)
        found[pose[chunk], look[chunk]] = camera.unhidden(X_FC[pose[chunk]], look[chunk])
    return found


def _looks(way: JudgedWay) -> tuple[Indices, Indices, Indices]:
    """The sample, the box and the item of every look: one for each box of each item, in the order of the items."""
    sample, target = way.items
    counts = np.array([len(one.boxes) for one in way.scene.targets], dtype=np.int64)
    first = np.cumsum(counts) - counts
    item = np.repeat(np.arange(len(sample)), counts[target])
    within = np.arange(len(item)) - np.repeat(np.cumsum(counts[target]) - counts[target], counts[target])
    return sample[item], first[target[item]] + within, item


_LOOKS_TOGETHER = 20_000
"""To bound the memory."""


def joined_items(before: JudgedWay, sees: Mask, more: JudgedWay, added: Mask, after: JudgedWay) -> Mask:
    """What is seen of a way with further samples, (..., items); sees: before, added: of the further samples alone."""
    order = before.samples.merge_order(more.samples)
    count = len(before.samples)
    columns = {(int(s), int(t)): n for n, (s, t) in enumerate(zip(*before.items, strict=True))}
    columns |= {(count + int(s), int(t)): sees.shape[-1] + n for n, (s, t) in enumerate(zip(*more.items, strict=True))}
    chosen = [columns[int(order[s]), int(t)] for s, t in zip(*after.items, strict=True)]
    return np.concatenate([sees, added], axis=-1)[..., chosen]
