"""Where everything really is while a run goes on: for pictures of it and for its log, never for perception."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array, matrix_to_quaternion
from sqrp_cli.knowledge.target_box import START, TargetBox
from sqrp_cli.program import Step
from sqrp_cli.runtime.narrator import Narrator
from sqrp_cli.runtime.outcome import STATE, Event
from sqrp_cli.runtime.simulation.cell import SimulatedCell
from sqrp_cli.runtime.simulation.reference import Reference

RATE = 25.0
"""States per second of the cell's clock; a thing that falls freely is within 2 mm of the line between two of them."""

DIGITS = 5
"""Decimals of positions [m or rad] and of quaternions: 10 micrometres, and as much at a distance of 1 m."""


class Witness:
    """A cell that tells at a fixed rate where everything in it is, while time passes as it would without.

    An event has the positions `q` of all joints [rad or m], the poses of `objects` in the world (x, y, z [m] and a
    quaternion x, y, z, w) and what the tool holds (`held`). The first one has all of it, with the names of the
    `joints`; the others have what is not as it was in the one before.
    """

    def __init__(self, cell: SimulatedCell, narrator: Narrator) -> None:
        self._cell, self._narrator = cell, narrator
        self._number = 0
        self._told_at = -1.0
        self._told: dict[str, Any] = {}
        self._poses: dict[str, list[float]] = {}

    def advance(self, t: float, reference: Reference) -> None:
        """Let time pass until t [s] as the cell does, telling what is so at each time that is due until then."""
        while (due := self._number / RATE) <= t + 1e-9:
            self._cell.advance(due, reference)
            self._tell(due)
            self._number += 1
        self._cell.advance(t, reference)

    def finish(self) -> None:
        """Tell what is so at the end."""
        if self._cell.t > self._told_at + 1e-9:
            self._tell(self._cell.t)

    def _tell(self, t: float) -> None:
        truth = self._cell.truth()
        state = {"joints": list(truth.joints), "q": [_rounded(q) for q in truth.joints.values()], "held": truth.held}
        poses = {name: _pose(X) for name, X in truth.X_WO.items()}
        changed = {name: value for name, value in state.items() if name not in self._told or self._told[name] != value}
        moved = {name: pose for name, pose in poses.items() if self._poses.get(name) != pose}
        self._narrator.say(t, STATE, **changed, **({"objects": moved} if moved else {}))
        self._told, self._poses, self._told_at = state, poses, t


@dataclass(frozen=True, eq=False)
class Track:
    """Where everything was during a run.

    t: n times on the run's clock [s], shape (n,). joints: names of j joints. q: their positions, shape (n, j) [rad or
    m]. held: what the tool held, n of them. poses: of each object in the world, as pairs of the index of a time and
    the pose from then on (x, y, z [m] and a quaternion x, y, z, w).
    """

    t: Array
    joints: tuple[str, ...]
    q: Array
    held: tuple[str | None, ...]
    poses: Mapping[str, tuple[tuple[int, tuple[float, ...]], ...]]

    @classmethod
    def of(cls, events: Iterable[Event]) -> Track | None:
        """What a `Witness` told, from all events of a run; None if there was none."""
        states = [event for event in events if event.kind == STATE]
        if not states:
            return None
        q: list[Any] = []
        held: list[str | None] = []
        poses: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        for index, state in enumerate(states):
            q.append(state.fields["q"] if "q" in state.fields else q[-1])
            held.append(state.fields["held"] if "held" in state.fields else held[-1])
            for name, pose in state.fields.get("objects", {}).items():
                poses.setdefault(name, []).append((index, tuple(pose)))
        return cls(
            np.array([state.t for state in states]),
            tuple(states[0].fields["joints"]),
            np.array(q, dtype=float).reshape(len(states), -1),
            tuple(held),
            {name: tuple(found) for name, found in poses.items()},
        )


def asked_boxes(step: Step) -> dict[str, list[dict[str, Any]]]:
    """The boxes in which images of a step are judged, by atom: the `frame` that each moves with, its `size` and `pose`.

    The frame is a link of the robot or the world, in which a box stays that belongs to where an object was when the
    step began. A box that moves with an object which is carried is left out: where images are searched for it is what
    the robot believes, and neither where the object is nor where it was.
    """
    found = {atom: [_asked(step, box) for box in target.boxes] for atom, target in step.targets.items()}
    return {atom: [box for box in boxes if box is not None] for atom, boxes in found.items()}


def _asked(step: Step, box: TargetBox) -> dict[str, Any] | None:
    name = box.frame.removesuffix(START)
    carried = {step.before.held, *(primitive.held for primitive in step.primitives)}
    if name not in step.before.X_WO:
        frame, X_FB = box.frame, box.X_FB
    elif box.frame == name and name in carried:
        return None
    else:
        frame, X_FB = "world", step.before.X_WO[name] @ box.X_FB
    return {"frame": frame, "size": list(box.size), "pose": [[_rounded(x) for x in row] for row in X_FB.tolist()]}


def _pose(X_WO: Array) -> list[float]:
    return [_rounded(float(x)) for x in (*X_WO[:3, 3], *matrix_to_quaternion(X_WO[:3, :3]))]


def _rounded(value: float) -> float:
    return round(value, DIGITS) + 0.0  # no -0.0, which is not 0.0 to whoever reads the log
