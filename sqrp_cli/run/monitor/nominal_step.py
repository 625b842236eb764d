"""A step that goes well: which atoms hold when, and which the cameras are predicted to see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from sqrp_cli.files.frames import carried_poses, frame_poses
from sqrp_cli.geometry import Array, inverse
from sqrp_cli.logic.literal import Atom
from sqrp_cli.program.record import ProgramTarget, Step
from sqrp_cli.run.perception.detections import DetectionTargets
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.skill.target_box import object_of

SPACING = 0.02  # Sampling period of the nominal motion [s]


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


def planned_joints(step: Step, t: Array) -> Array:
    """Positions of the program's n joints at times t (m,) of a step [s], shape (m, n) [rad or m]."""
    primitives, ends = step.primitives, [primitive.end for primitive in step.primitives]
    of = np.minimum(np.searchsorted(ends, t), len(ends) - 1)
    found = np.empty((len(t), primitives[0].trajectory.positions([0.0]).shape[1]))
    for index, primitive in enumerate(primitives):
        found[of == index] = primitive.trajectory.positions(t[of == index] - primitive.start)
    return found


class NominalStep:
    """The expected course of a step if all goes well."""

    def __init__(self, step: Step, joints: tuple[str, ...], robot: RobotBody) -> None:
        """joints: names of the arm's joints, in the order of the step's trajectories."""
        self.step, before = step, step.before
        t = np.arange(0.0, step.time + SPACING, SPACING)
        self.times: Sequence[float] = t.tolist()
        """The instants at which the nominal motion is looked at, from 0 on [s]; the last may lie after its end."""
        self.when_open = {atom: (Atom.of(atom) in before.facts) == (before.held is None) for atom in step.targets}
        """The value of each atom while the fingers of a gripper are open: that at the start, if they are open then."""
        X_WL = robot.poses_over(dict(zip(joints, planned_joints(step, t).T, strict=True)))
        ends = [primitive.end for primitive in step.primitives]
        of = np.minimum(np.searchsorted(ends, t), len(ends) - 1).tolist()
        held = [step.primitives[index].held for index in of]
        # What is carried in some primitives rests in the others, where the last one left it.
        X_WT, self._X_WO = X_WL[robot.tool_frame], {name: X[None] for name, X in before.X_WO.items()}
        for name in {primitive.held for primitive in step.primitives if primitive.held is not None}:
            X_WO, X_TO = before.X_WO[name], before.X_TO if before.held == name else None
            holding = np.array([one == name for one in held])
            edges, stays = (np.flatnonzero(np.diff(holding)) + 1).tolist(), []
            for start, end in pairwise([0, *edges, len(holding)]):
                if not holding[start]:
                    X_TO = None
                elif X_TO is None:
                    X_TO = inverse(X_WT[start]) @ X_WO
                stays.append((slice(start, end), X_TO, None if holding[start] else X_WO))
                X_WO = X_WO if X_TO is None else X_WT[end - 1] @ X_TO
            self._X_WO[name] = carried_poses(X_WT, stays)
        self._holds = {atom: np.zeros(len(t), dtype=bool) for atom in step.targets}
        for i in range(len(t)):
            now_X_WL, now_X_WO = {link: X[i] for link, X in X_WL.items()}, self.object_poses(self.times[i])
            for atom, target in step.targets.items():
                inside = in_boxes(atom, target, now_X_WL, now_X_WO, before.X_WO, held[i])
                self._holds[atom][i] = self.when_open[atom] == (held[i] is None) if inside is None else inside

    @property
    def sought(self) -> DetectionTargets:
        """What to look for in images of the step."""
        return DetectionTargets(dict(self.step.targets), self.step.before.X_WO, self.when_open)

    def holds(self, atom: str, start: float, end: float | None = None, *, value: bool = True) -> bool:
        """Whether an atom has a value at a time of the step, or at all times from that to an end [s]."""
        first, last = (self._index(t) for t in (start, start if end is None else end))
        return bool((self._holds[atom][first : last + 1] == value).all())

    def object_poses(self, t: float) -> Mapping[str, Array]:
        """Where objects are at time t [s] of the step, (4, 4)."""
        index = self._index(t)
        return {name: poses[index if len(poses) > 1 else 0] for name, poses in self._X_WO.items()}

    def _index(self, t: float) -> int:
        return min(round(max(t, 0.0) / SPACING), len(self.times) - 1)

    def covering(self, atom: str, t: float, margin: float = 0.0) -> list[str]:
        """The cameras that were predicted to see an atom from t - margin to t + margin [s]."""
        seen = self.step.targets[atom].seen
        return [name for name, spans in seen.items() if any(a <= t - margin and t + margin <= b for a, b in spans)]

    def is_covered(self, atom: str, t: float, margin: float = 0.0) -> bool:
        """Whether enough cameras were predicted to see an atom from t - margin to t + margin [s]."""
        return len(self.covering(atom, t, margin)) >= self.step.targets[atom].cameras
