"""A step that goes well: which atoms hold when, and which the cameras are predicted to see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.files.frames import Stay, carried_poses, frame_poses
from sqrp_cli.geometry import Array, inverse
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.program.record import ProgramTarget, Step
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.skill.target_box import object_of

SPACING = 0.02
"""Sampling period of the nominal motion [s]."""


def in_boxes(
    atom: str,
    target: ProgramTarget,
    X_WL: Mapping[str, Array],
    X_WO: Mapping[str, Array],
    starts: Mapping[str, Array],
    held: str | None,
) -> bool | None:
    """Whether an object is in each of the boxes that decide an atom; None for one that is about the gripper's fingers.

    It is in a box that moves with the robot if the tool holds it, in any other if its centre is inside. X_WL, X_WO,
    starts: the pose of each link, of each object, and of that when the step began, (4, 4). held: in the tool.
    """
    named = [(name, box) for box in target.boxes if (name := object_of(atom, box, X_WO)) is not None]
    for name, box in named:
        if box.frame in X_WL:
            inside = held == name
        else:
            X_WB = frame_poses({}, X_WO, starts)[box.frame] @ box.X_FB
            offset = (X_WO[name][:3, 3] - X_WB[:3, 3]) @ X_WB[:3, :3]
            inside = bool((np.abs(offset) <= 0.5 * np.array(box.size)).all())
        if not inside:
            return False
    return True if named else None


def values_when_open(step: Step) -> dict[str, bool]:
    """The value of each atom at the start of a step if the fingers are open then, else the opposite."""
    return {atom: (Atom.of(atom) in step.before.facts) == (step.before.held is None) for atom in step.targets}


def planned_joints(step: Step, t: Array) -> Array:
    """Positions of the program's n joints at times t (m,) of a step [s], shape (m, n) [rad or m]."""
    of, found = _primitive_at(step, t), np.empty((len(t), step.primitives[0].trajectory.positions([0.0]).shape[1]))
    for index, primitive in enumerate(step.primitives):
        found[of == index] = primitive.trajectory.positions(t[of == index] - primitive.start)
    return found


def _primitive_at(step: Step, t: Array) -> NDArray[np.int64]:
    """The index of the primitive at times t (m,) [s], (m,)."""
    return np.minimum(np.searchsorted([primitive.end for primitive in step.primitives], t), len(step.primitives) - 1)


class NominalStep:
    """The expected course of a step if all goes well."""

    def __init__(self, step: Step, joints: tuple[str, ...], robot: RobotBody) -> None:
        """joints: names of the arm's joints, in the order of the step's trajectories."""
        self.step, before = step, step.before
        t = np.arange(0.0, step.time + SPACING, SPACING)
        self.times: Sequence[float] = t.tolist()
        """The instants at which the nominal motion is looked at, from 0 on [s]; the last may lie after its end."""
        primitive_of = _primitive_at(step, t)
        X_WL = robot.poses_over(dict(zip(joints, planned_joints(step, t).T, strict=True)))
        X_WT, held = X_WL[robot.tool_frame], [step.primitives[index].held for index in primitive_of.tolist()]
        self._X_WO: dict[str, Array] = {name: X[None] for name, X in before.X_WO.items()}
        for name in dict.fromkeys(primitive.held for primitive in step.primitives if primitive.held is not None):
            self._X_WO[name] = carried_poses(X_WT, _stays(name, step, held, X_WT))
        self.when_open = values_when_open(step)
        """The value of each atom while the fingers of a gripper are open."""
        self._holds = {atom: np.zeros(len(t), dtype=bool) for atom in step.targets}
        for i in range(len(t)):
            now_X_WL = {link: X[i] for link, X in X_WL.items()}
            now_X_WO = {name: X[i if len(X) > 1 else 0] for name, X in self._X_WO.items()}
            for atom, target in step.targets.items():
                inside = in_boxes(atom, target, now_X_WL, now_X_WO, before.X_WO, held[i])
                self._holds[atom][i] = self.when_open[atom] == (held[i] is None) if inside is None else inside

    def _index(self, t: float) -> int:
        return min(round(max(t, 0.0) / SPACING), len(self.times) - 1)

    def holds(self, atom: str, t: float) -> bool:
        """Whether an atom holds at time t [s] of the step."""
        return bool(self._holds[atom][self._index(t)])

    def held_throughout(self, literal: Literal, start: float, end: float) -> bool:
        """Whether a literal holds at all times from start to end [s]."""
        found = self._holds[str(literal.atom)][self._index(start) : self._index(end) + 1]
        return bool((found == literal.positive).all())

    def object_poses(self, t: float) -> Mapping[str, Array]:
        """Where objects are at time t [s] of the step, (4, 4)."""
        index = self._index(t)
        return {name: poses[index if len(poses) > 1 else 0] for name, poses in self._X_WO.items()}

    def covering(self, atom: str, t: float, margin: float = 0.0) -> list[str]:
        """The cameras that were predicted to see an atom from t - margin to t + margin [s]."""
        seen = self.step.targets[atom].seen
        return [name for name, spans in seen.items() if any(a <= t - margin and t + margin <= b for a, b in spans)]

    def is_covered(self, atom: str, t: float, margin: float = 0.0) -> bool:
        """Whether enough cameras were predicted to see an atom from t - margin to t + margin [s]."""
        return len(self.covering(atom, t, margin)) >= self.step.targets[atom].cameras


def _stays(name: str, step: Step, held: Sequence[str | None], X_WT: Array) -> Iterator[Stay]:
    """The pose of an object that is carried in some primitives and rests in the others."""
    X_WO, X_TO = step.before.X_WO[name], step.before.X_TO if step.before.held == name else None
    holding = np.array([one == name for one in held])
    edges = (np.flatnonzero(np.diff(holding)) + 1).tolist()
    for start, end in pairwise([0, *edges, len(holding)]):
        if holding[start]:
            X_TO = inverse(X_WT[start]) @ X_WO if X_TO is None else X_TO
            yield Stay(slice(start, end), X_TO, None)
            X_WO = X_WT[end - 1] @ X_TO
        else:
            X_TO = None
            yield Stay(slice(start, end), None, X_WO)
