"""Who is in the way: which parts hide how much of a target from each camera, and what to move first.

It takes every triangle near a hidden view, so only what explains a candidate asks for it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sqrp_cli.geometry import Indices
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause, HidingPart
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.blind_spans import sample_weights
from sqrp_cli.study.result import HiddenTarget

_VIEWS = 4000  # Views to look at together, to bound the memory
HiddenViews = Mapping[tuple[int, int, int, int], tuple[HidingPart, ...]]
"""What hides a box, the largest share first, by the indices of target, box, sample and camera; where it is hidden."""


def hidden_views(cell: Cell, analysis: Analysis, rows: Indices | None = None) -> HiddenViews:
    """What hides each hidden box from each camera in the samples `rows` (all), of what must be observable then."""
    observation, targets = analysis.timeline.observation, analysis.planned.targets
    asked_for = observation.required.copy()
    if rows is not None:
        asked_for[np.isin(np.arange(len(asked_for)), rows, invert=True)] = False
    views = [np.zeros((4, 0), dtype=np.int64)]  # neighbours are of one box and camera
    for column, of_target in enumerate(observation.full_matrix):
        for number, verdicts in enumerate(of_target):
            camera, row = np.nonzero(((verdicts.cause == Cause.HIDDEN) & asked_for[:, column, None]).T)
            views.append(np.stack([np.full(len(row), column), np.full(len(row), number), row, camera]))
    states, every = analysis.planned.stage.states(analysis.timeline.samples), np.concatenate(views, axis=1)
    sought = [box for target in targets for box in target.boxes]
    first = np.cumsum([0, *(len(target.boxes) for target in targets)])
    found: dict[tuple[int, int, int, int], tuple[HidingPart, ...]] = {}
    for start in range(0, every.shape[1], _VIEWS):
        column, number, row, camera = some = every[:, start : start + _VIEWS]
        hiding = cell.observer.occluders(sought, states, first[column] + number, camera, row)
        found |= zip(zip(*some.tolist(), strict=True), hiding, strict=True)
    return found


def in_the_way(cell: Cell, analysis: Analysis, views: HiddenViews) -> tuple[HiddenTarget, ...]:
    """What hides each target from each camera, in the order of targets and cameras; views: all hidden ones."""
    weights, observation = sample_weights(analysis), analysis.timeline.observation
    found = []
    for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
        rows = np.flatnonzero(observation.required[:, column])
        first, box_of = first_failing(boxes, rows)
        for index, camera in enumerate(cell.observer.cameras):
            hidden = np.flatnonzero(first.cause[:, index] == Cause.HIDDEN)
            some = [
                (float(weights[rows[at]]), views[column, int(box_of[at, index]), int(rows[at]), index])
                for at in hidden.tolist()
            ]
            duration = sum(weight for weight, _ in some)
            if duration > 0:
                parts = _mean(some, duration)
                share = sum(part.share for part in parts)
                found.append(
                    HiddenTarget(
                        literal=str(target.atom), camera=camera.name, seconds=duration, hidden=share, parts=parts
                    )
                )
    return tuple(found)


def to_move(cell: Cell, analysis: Analysis, views: HiddenViews) -> tuple[HidingPart, ...]:
    """The objects in the way, the one first without which most would be seen.

    None that the task handles, nor a fixed one that others stand on. Shares are of all that is hidden, from any camera,
    while too few see the target. views: all hidden ones.
    """
    weights, uncovered = sample_weights(analysis), analysis.timeline.observation.uncovered
    missed = [(float(weights[row]), parts) for (column, _, row, _), parts in views.items() if uncovered[row, column]]
    parts = _mean(missed, 1.0)
    total = sum(part.share for part in parts)
    if total <= 0.0:
        return ()
    parents = {solid.name: solid.part.parent for solid in cell.observer.solids}
    objects = cell.workspace.objects
    supports = {one.on for one in objects.values() if one.on is not None and objects[one.on].fixed}
    kept = supports.union(analysis.planned.candidate.binding.values())
    of_objects = [replace(part, name=parents[part.name]) for part in parts]
    movable = _mean([(1.0, [part for part in of_objects if part.name in objects and part.name not in kept])], total)
    return tuple(sorted(movable, key=lambda one: (-one.alone, -one.share, one.name)))


def _mean(some: Sequence[tuple[float, Sequence[HidingPart]]], duration: float) -> tuple[HidingPart, ...]:
    """The parts of several views, each with its weight, the largest share first; over the weights' sum."""
    shares: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for weight, parts in some:
        for part in parts:
            shares[part.name][0] += weight * part.share / duration
            shares[part.name][1] += weight * part.alone / duration
    found = [HidingPart(name=name, share=share, alone=alone) for name, (share, alone) in shares.items()]
    return tuple(sorted(found, key=lambda one: (-one.share, one.name)))
