"""What every camera that may be chosen sees of every target in every sample, by the exact definitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Protocol

import numpy as np

from sqrp_cli.geometry import Mask
from sqrp_cli.knowledge.workspace.mounts import LensChoice, Spot
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.placing.scenes import Installation, JudgedWay, View

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
        first = views[rows[0]]
        cameras = [Installation(spots[first.spot], first, lens).camera(lens.name) for lens in lenses]
        X_FC = np.stack([views[row].X_FC for row in rows])
        sees[:, rows] = cell.observer.seen_from(cameras, X_FC, way.scene.targets, way.states, *way.items)
    for number, lens in enumerate(lenses):
        sees[number, [all(one.name != lens.name for one in spots[view.spot].lenses) for view in views]] = False
    return sees


def joined_items(before: JudgedWay, sees: Mask, more: JudgedWay, added: Mask, after: JudgedWay) -> Mask:
    """What is seen of a way with further samples, (..., items); sees: before, added: of the further samples alone."""
    order = before.samples.merge_order(more.samples)
    count = len(before.samples)
    columns = {(int(s), int(t)): n for n, (s, t) in enumerate(zip(*before.items, strict=True))}
    columns |= {(count + int(s), int(t)): sees.shape[-1] + n for n, (s, t) in enumerate(zip(*more.items, strict=True))}
    chosen = [columns[int(order[s]), int(t)] for s, t in zip(*after.items, strict=True)]
    return np.concatenate([sees, added], axis=-1)[..., chosen]
