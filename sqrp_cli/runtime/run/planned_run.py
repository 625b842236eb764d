"""A run that goes exactly as planned, as the events that it would have: a program for ROS tools."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program
from sqrp_cli.ros.bag import written
from sqrp_cli.runtime.monitor.nominal_step import NominalStep, planned_joints
from sqrp_cli.runtime.monitor.step_monitor import StepMonitor
from sqrp_cli.runtime.record import events
from sqrp_cli.runtime.record.bag_recorder import BagRecorder
from sqrp_cli.runtime.robot_body import RobotBody
from sqrp_cli.runtime.run.ground_truth import RATE, asked_boxes, logged_pose


def write_planned_run(path: Path, program: Program, workspace: Workspace) -> None:
    """Write what is planned as a recording, by the suffix of its name. Raises InputError where that cannot be."""
    body = RobotBody.load(workspace.robot)
    with written(path) as writer:
        recorder = BagRecorder(writer, workspace, body)
        recorder.tell_planned(0.0, planned=True)
        for event in _events(program, body):
            recorder(event)


def _events(program: Program, body: RobotBody) -> Iterator[events.Event]:
    begin, last = 0.0, None
    for number, step in enumerate(program.steps, 1):
        for event in _of_step(program, number, NominalStep(step, program.joints, body), begin):
            if not isinstance(event, events.WholeState):
                yield event
                continue
            state: events.State = event if last is None else event.since(last)
            yield state
            last = event
        begin += step.time
    yield events.RunEnded(t=begin, event="done")


def _of_step(program: Program, number: int, nominal: NominalStep, begin: float) -> Iterator[events.Event]:
    step = nominal.step
    yield events.StepBegan(
        t=begin, number=number, skill=step.skill, parameters=dict(step.parameters), boxes=asked_boxes(step)
    )
    t = np.append(np.arange(0.0, step.time, 1.0 / RATE), step.time)
    q, monitor, due = planned_joints(step, t), StepMonitor(nominal, 1.0), list(step.primitives)
    literals: Mapping[str, events.ShownAtom] = {}
    for now, positions in zip(t.tolist(), q.tolist(), strict=True):
        while due and due[0].start <= now + 1e-9:
            primitive = due.pop(0)
            yield events.PrimitiveBegan(t=begin + primitive.start, name=primitive.name)
        objects = {name: logged_pose(X) for name, X in nominal.object_poses(now).items()}
        held = next((p.held for p in step.primitives if now <= p.end), step.after.held)
        yield events.WholeState(t=begin + now, joints=list(program.joints), q=positions, held=held, objects=objects)
        seen = {atom: _promised(nominal, atom, now, asked=atom in monitor.monitored(now)) for atom in step.targets}
        if seen != literals:
            yield events.EvidenceSeen(t=begin + now, exposed=begin + now, step_time=now, literals=seen)
            literals = seen


def _promised(nominal: NominalStep, atom: str, t: float, *, asked: bool) -> events.ShownAtom:
    """What images are promised to show of an atom."""
    value = Truth.TRUE if nominal.holds(atom, t) else Truth.FALSE
    covered = nominal.is_covered(atom, t)
    cameras = dict.fromkeys(nominal.covering(atom, t), value)
    return events.ShownAtom(value=value if covered else Truth.UNKNOWN, predicted=covered, asked=asked, cameras=cameras)
