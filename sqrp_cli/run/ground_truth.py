"""What the log says of the true state of a cell, for checks of what was detected and pictures, never for perception.

And the events of a run that goes exactly as planned: a program for ROS tools.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.files.frames import AT_START, WORLD
from sqrp_cli.geometry import Array, matrix_to_quaternion
from sqrp_cli.logic.truth import TruthWord
from sqrp_cli.program.record import Program, Step
from sqrp_cli.ros.bag import written
from sqrp_cli.run.monitor.nominal_step import NominalStep, planned_joints
from sqrp_cli.run.monitor.step_monitor import Attempt
from sqrp_cli.run.record.bag_recorder import BagRecorder
from sqrp_cli.run.record.events import AskedBox, ShownAtom, event
from sqrp_cli.run.robot_body import RobotBody

RATE = 25.0
"""States per second of the cell's clock; an object that falls freely is within 2 mm of the line between two of them."""
DIGITS = 5
"""Decimals of positions [m or rad] and of quaternions: 10 micrometres, and as much at a distance of 1 m.

0.0 is added to what is rounded, so that there is no -0.0, which is not 0.0 to whoever reads the log.
"""


def changes(state: Mapping[str, Any], before: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """What the event of a state says: the fields that are not as they were before, all of the first one.

    Of objects it says nothing without any.
    """
    if before is None:
        return {key: value for key, value in state.items() if value or key != "objects"}
    moved = {name: X for name, X in state["objects"].items() if before["objects"].get(name) != X}
    changed = {key: state[key] for key in ("q", "held") if state[key] != before[key]}
    return {**changed, "objects": moved} if moved else changed


def step_began(step: Step, number: int) -> Mapping[str, Any]:
    """The fields of the event that an attempt at a step begins, with the boxes in which its images are judged, by atom.

    The frame of each is a link of the robot, or the world for a box at `object@start`. A box that moves with a carried
    object is left out: images are searched for it where the robot believes it is, not where the object is or was.
    """
    carried, before = {step.before.held, *(primitive.held for primitive in step.primitives)}, step.before.X_WO
    boxes: dict[str, list[AskedBox]] = {atom: [] for atom in step.targets}
    for atom, box in ((atom, box) for atom, target in step.targets.items() for box in target.boxes):
        name = box.frame.removesuffix(AT_START)
        if name in before and not box.frame.endswith(AT_START) and name in carried:
            continue
        frame, X_FB = (WORLD, before[name] @ box.X_FB) if name in before else (str(box.frame), box.X_FB)
        pose = [[round(x, DIGITS) + 0.0 for x in row] for row in X_FB.tolist()]
        boxes[atom].append(AskedBox(frame=frame, size=list(box.size), pose=pose))
    parameters, time = dict(step.parameters), round(step.time, 6)
    said = {"number": number, "skill": step.skill, "parameters": parameters, "time": time}
    return {**said, "boxes": boxes, "says": step.says}


def write_planned_run(path: Path, program: Program, workspace: Workspace) -> None:
    """Write the events that a run would have if it went exactly as planned as a recording, by the suffix of its name.

    Raises InputError where that cannot be.
    """
    body = RobotBody.load(workspace.robot)
    with written(path) as writer:
        recorder = BagRecorder(writer, workspace, body)
        recorder.tell_planned(0.0, planned=True)
        begin, last = 0.0, None
        for number, step in enumerate(program.steps, 1):
            nominal = NominalStep(step, program.joints, body)
            recorder(event("step", begin, **step_began(step, number)))
            t = np.append(np.arange(0.0, step.time, 1.0 / RATE), step.time)
            q, monitor, due = planned_joints(step, t), Attempt(nominal, 1.0), list(step.primitives)
            literals: Mapping[str, ShownAtom] = {}
            for now, positions in zip(t.tolist(), q.tolist(), strict=True):
                while due and due[0].start <= now + 1e-9:
                    primitive = due.pop(0)
                    recorder(event("primitive", begin + primitive.start, name=primitive.name))
                held = next((p.held for p in step.primitives if now <= p.end), step.after.held)
                objects = logged_poses(nominal.object_poses(now))
                state = {"joints": list(program.joints), "q": positions, "held": held, "objects": objects}
                recorder(event("state", begin + now, **changes(state, last)))
                last, asked, seen = state, monitor.monitored(now), dict[str, ShownAtom]()
                for atom in step.targets:
                    value: TruthWord = "true" if nominal.holds(atom, now) else "false"
                    covered, cameras = nominal.is_covered(atom, now), dict.fromkeys(nominal.covering(atom, now), value)
                    shown = value if covered else "blind"
                    seen[atom] = ShownAtom(value=shown, predicted=covered, asked=atom in asked, cameras=cameras)
                if seen != literals:
                    recorder(event("evidence", begin + now, exposed=begin + now, step_time=now, literals=seen))
                    literals = seen
            begin += step.time
        recorder(event("done", begin))


def logged_poses(X_WO: Mapping[str, Array]) -> dict[str, list[float]]:
    """Poses (4, 4) as the log has them: x, y, z [m] and a quaternion x, y, z, w."""
    return {
        name: [round(float(x), DIGITS) + 0.0 for x in (*X[:3, 3], *matrix_to_quaternion(X[:3, :3]))]
        for name, X in X_WO.items()
    }
