"""A step that goes well: which atoms hold when, and which the cameras are predicted to see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, inverse
from sqrp_cli.knowledge.frames import Stay, carried_poses, frame_poses
from sqrp_cli.knowledge.skill.target_box import TargetBox, object_of
from sqrp_cli.logic.literal import Atom
from sqrp_cli.program.record import ProgramTarget, Step
from sqrp_cli.runtime.robot_body import RobotBody

SPACING = 0.02
"""Sampling period of the nominal motion [s]."""


@dataclass(frozen=True, eq=False)
class Situation:
    """Where everything is at one moment."""

    X_WL: Mapping[str, Array]
    """Pose of each link, (4, 4)."""
    X_WO: Mapping[str, Array]
    """Of each object."""
    starts: Mapping[str, Array]
    """Of each object when the step began."""
    held: str | None
    """The object in the tool."""
    open: bool
    """Whether the fingers of a gripper are open."""


def holds(atom: str, target: ProgramTarget, situation: Situation, *, when_open: bool) -> bool:
    """Whether an atom is true: its object is in each box that is for one.

    It is in a box that moves with the robot if the tool holds it, in any other if its centre is inside. An atom without
    an object is about the gripper's fingers. when_open: the value of such an atom while they are open.
    """
    named = [(object_of(atom, box, situation.X_WO), box) for box in target.boxes]
    if all(name is None for name, _ in named):
        return when_open == situation.open
    return all(_is_in(name, box, situation) for name, box in named if name is not None)


def values_when_open(step: Step) -> dict[str, bool]:
    """The value of each atom at the start of a step if the fingers are open then, else the opposite."""
    return {atom: (Atom.of(atom) in step.before.facts) == (step.before.held is None) for atom in step.targets}


def _is_in(name: str, box: TargetBox, situation: Situation) -> bool:
    if box.frame in situation.X_WL:
        return situation.held == name
    X_WB = frame_poses({}, situation.X_WO, situation.starts)[box.frame] @ box.X_FB
    offset = (situation.X_WO[name][:3, 3] - X_WB[:3, 3]) @ X_WB[:3, :3]
    return bool((np.abs(offset) <= 0.5 * np.array(box.size)).all())


def planned_joints(step: Step, t: Array) -> Array:
    """Positions of the program's n joints at times t (m,) of a step [s], shape (m, n) [rad or m]."""
    of = _primitive_at(step, t)
    q = [p.trajectory.positions(t[of == index] - p.start) for index, p in enumerate(step.primitives)]
    found = np.empty((len(t), q[0].shape[1]))
    for index, positions in enumerate(q):
        found[of == index] = positions
    return found


def _primitive_at(step: Step, t: Array) -> NDArray[np.int64]:
    """The index of the primitive at times t (m,) [s], (m,)."""
    return np.minimum(np.searchsorted([primitive.end for primitive in step.primitives], t), len(step.primitives) - 1)


class NominalStep:
    """The expected course of a step if all goes well."""

    def __init__(self, step: Step, joints: tuple[str, ...], robot: RobotBody) -> None:
        """joints: names of the arm's joints, in the order of the step's trajectories."""
        self.step = step
        self._t = np.arange(0.0, step.time + SPACING, SPACING)
        self._X_WO, self._holds = self._simulate(joints, robot)

    @property
    def times(self) -> Sequence[float]:
        """The instants at which the nominal motion is looked at, from 0 on [s]; the last may lie after its end."""
        return self._t.tolist()

    def holds(self, atom: str, t: float) -> bool:
        """Whether an atom holds at time t [s] of the step."""
        return bool(self._holds[atom][min(round(max(t, 0.0) / SPACING), len(self._t) - 1)])

    def held_throughout(self, atom: str, positive: bool, start: float, end: float) -> bool:
        """Whether an atom has a value at all times from start to end [s]."""
        first, last = (min(max(round(t / SPACING), 0), len(self._t) - 1) for t in (start, end))
        return bool((self._holds[atom][first : last + 1] == positive).all())

    def object_poses(self, t: float) -> Mapping[str, Array]:
        """Where objects are at time t [s] of the step, (4, 4)."""
        index = min(round(max(t, 0.0) / SPACING), len(self._t) - 1)
        return {name: poses[index if len(poses) > 1 else 0] for name, poses in self._X_WO.items()}

    def covering(self, atom: str, t: float, margin: float = 0.0) -> list[str]:
        """The cameras that were predicted to see an atom from t - margin to t + margin [s]."""
        target = self.step.targets[atom]
        return [name for name, spans in target.seen.items() if _within(spans, t - margin, t + margin)]

    def usually_shows(self, atom: str, camera: str, t: float, *, value: bool) -> bool:
        """Whether a camera's image of time t [s] usually shows an atom with this value, be it promised or not."""
        target = self.step.targets[atom]
        usual = target.usual if value or not target.refuted else target.refuted
        return _within(usual.get(camera, ()), t, t)

    def is_covered(self, atom: str, t: float, margin: float = 0.0) -> bool:
        """Whether enough cameras were predicted to see an atom from t - margin to t + margin [s]."""
        return len(self.covering(atom, t, margin)) >= self.step.targets[atom].cameras

    def _simulate(
        self, joints: tuple[str, ...], robot: RobotBody
    ) -> tuple[Mapping[str, Array], Mapping[str, NDArray[np.bool_]]]:
        step = self.step
        primitive_of, q = _primitive_at(step, self._t), planned_joints(step, self._t)
        X_WL = robot.poses_over(dict(zip(joints, q.T, strict=True)))
        X_WT = X_WL[robot.tool_frame]
        X_WO: dict[str, Array] = {name: X[None] for name, X in step.before.X_WO.items()}
        for name in dict.fromkeys(primitive.held for primitive in step.primitives if primitive.held is not None):
            X_WO[name] = carried_poses(X_WT, _stays(name, step, primitive_of, X_WT))
        held = [step.primitives[index].held for index in primitive_of.tolist()]
        return X_WO, self._values(X_WL, X_WO, held)

    def _values(
        self, X_WL: Mapping[str, Array], X_WO: Mapping[str, Array], held: Sequence[str | None]
    ) -> Mapping[str, NDArray[np.bool_]]:
        """Whether each atom holds at each time, shape (m,); links and objects are where it is said."""
        step = self.step
        when_open = values_when_open(step)
        values = {atom: np.zeros(len(self._t), dtype=bool) for atom in step.targets}
        for i in range(len(self._t)):
            now = Situation(
                {link: X[i] for link, X in X_WL.items()},
                {name: X[i if len(X) > 1 else 0] for name, X in X_WO.items()},
                step.before.X_WO,
                held[i],
                held[i] is None,
            )
            for atom, target in step.targets.items():
                values[atom][i] = holds(atom, target, now, when_open=when_open[atom])
        return values


def _stays(name: str, step: Step, primitive_of: NDArray[np.int64], X_WT: Array) -> Iterator[Stay]:
    """The pose of an object that is carried in some primitives and rests in the others."""
    X_WO, X_TO = step.before.X_WO[name], step.before.X_TO if step.before.held == name else None
    holding = np.array([primitive.held == name for primitive in step.primitives])[primitive_of]
    edges = (np.flatnonzero(np.diff(holding)) + 1).tolist()
    for start, end in pairwise([0, *edges, len(holding)]):
        if holding[start]:
            X_TO = inverse(X_WT[start]) @ X_WO if X_TO is None else X_TO
            yield Stay(slice(start, end), X_TO, None)
            X_WO = X_WT[end - 1] @ X_TO
        else:
            X_TO = None
            yield Stay(slice(start, end), None, X_WO)


def _within(spans: tuple[tuple[float, float], ...], start: float, end: float) -> bool:
    return any(first <= start and end <= last for first, last in spans)
