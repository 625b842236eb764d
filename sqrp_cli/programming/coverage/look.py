"""Looks at many motions of one cell at once: the coverage of given samples of each, in one batch.

They rule out ways before `timeline.observe`, which finds its own samples, decides between the few that are left.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, starmap

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.frames import FrameName
from sqrp_cli.programming.coverage.observation import Observation, coverage_only
from sqrp_cli.programming.coverage.stage import Samples, Stage, states_of
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import Target

_STATES_TOGETHER = 4000
"""States to look at together, to bound the memory."""


@dataclass(frozen=True, eq=False)
class Look:
    """Samples of a motion, and what must be seen in them."""

    stage: Stage
    targets: tuple[Target, ...]
    samples: Samples
    faults: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """The columns of the atoms of each fault, by its name: indices into `targets`.

    Without them, a target is left out where another one already decides that the state is not covered.
    """


def look_at(observer: Observer, looks: Sequence[Look]) -> tuple[Observation, ...]:
    """The coverage of motions in one cell, each as a timeline of its samples has it; much faster than one by one.

    Targets with the same atom should differ in nothing but the poses of their boxes: they are looked at together.
    """
    return tuple(observation for batch in _batches(looks) for observation in _look_at(observer, batch))


def _batches(looks: Sequence[Look]) -> Iterator[Sequence[Look]]:
    """The looks in order, as many at once as fit the memory."""
    batch = np.cumsum([len(look.samples) for look in looks]) // _STATES_TOGETHER
    edges = [0, *(np.flatnonzero(np.diff(batch)) + 1).tolist(), len(looks)]
    yield from (looks[start:end] for start, end in pairwise(edges) if start < end)


def _look_at(observer: Observer, looks: Sequence[Look]) -> Iterator[Observation]:
    states = states_of([look.stage for look in looks], [look.samples for look in looks])
    alike: dict[Hashable, dict[int, Target]] = {}  # of each kind, the targets by the index of their look
    kinds = [[_kind(target) for target in look.targets] for look in looks]
    for index, (look, of_look) in enumerate(zip(looks, kinds, strict=True)):
        for target, kind in zip(look.targets, of_look, strict=True):
            alike.setdefault(kind, {})[index] = target
    number = {kind: column for column, kind in enumerate(alike)}
    columns = [np.array([number[kind] for kind in of_look], dtype=np.int64) for of_look in kinds]
    rows = list(starmap(slice, pairwise(np.cumsum([0, *(len(look.samples) for look in looks)]).tolist())))

    required, faults = np.zeros((states.count, len(alike)), dtype=bool), {}
    for look, row, column in zip(looks, rows, columns, strict=True):
        required[row, column] = look.stage.requires(look.targets, look.samples)
        for of_fault in look.faults.values():
            atoms = tuple(column[list(of_fault)].tolist())
            faults[str(atoms)] = atoms
    frames = dict(states.X_WF)
    targets = [_as_one(targets, rows, frames, states.count) for targets in alike.values()]
    states = SceneStates(states.count, frames)
    # About as many as there are candidates: each look asks for one target after the other, as it would alone.
    together = len(targets) // max(1, max(len(look.targets) for look in looks))
    found = coverage_only(observer, targets, states, Observation.unknown(required), faults, max(1, together))
    yield from map(found.part, rows, columns)


def _kind(target: Target) -> Hashable:
    """What targets have in common that are looked at together."""
    boxes = ((box.frame, box.size, box.normal, box.encloses, box.limits) for box in target.boxes)
    return target.atom, target.cameras, tuple(boxes)


def _as_one(targets: Mapping[int, Target], rows: Sequence[slice], frames: dict[str, Array], count: int) -> Target:
    """Targets of one kind as one target; adds a frame for each box that has several poses in its own.

    targets: by the index of their look. rows: the states of each look, of `count` in all. frames: see `SceneStates`.
    """
    first, boxes = next(iter(targets.values())), []
    for number, box in enumerate(first.boxes):
        poses = {index: target.boxes[number].X_FB for index, target in targets.items()}
        if not all(np.array_equal(X_FB, box.X_FB) for X_FB in poses.values()):
            X_FB = np.tile(box.X_FB, (count, 1, 1))
            for index, X in poses.items():
                X_FB[rows[index]] = X
            frame = FrameName(f"box {number} of {first.atom}")
            frames[frame] = frames[box.frame] @ X_FB
            box = replace(box, frame=frame, X_FB=np.eye(4))
        boxes.append(box)
    return replace(first, boxes=tuple(boxes))
