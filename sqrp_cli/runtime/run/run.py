"""Runs a program in a cell, step by step: moves, looks, judges, and responds to faults."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, Replanner, Step
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.nominal_step import Expectation
from sqrp_cli.runtime.monitor.prediction_check import PredictionCheck
from sqrp_cli.runtime.monitor.step_monitor import PATIENCE, Alarm, Judge
from sqrp_cli.runtime.perception.detector_pool import PerceptionPool
from sqrp_cli.runtime.perception.image_stream import Eyes
from sqrp_cli.runtime.record.events import Listener, Retrying, RunEnded, StepBegan
from sqrp_cli.runtime.record.film import Gallery
from sqrp_cli.runtime.record.publisher import Narrator
from sqrp_cli.runtime.record.report import RunReport, StepRecord, Stopped, Unwatched
from sqrp_cli.runtime.robot_body import RobotBody
from sqrp_cli.runtime.run.arm_motion import Playback
from sqrp_cli.runtime.run.fault_ledger import FaultLedger
from sqrp_cli.runtime.run.ground_truth import GroundTruth
from sqrp_cli.runtime.run.injected_fault import InjectedFault
from sqrp_cli.runtime.run.lockstep import Due, Lockstep
from sqrp_cli.runtime.run.observation import Lookout
from sqrp_cli.runtime.run.recovery import Retry
from sqrp_cli.runtime.run.state_recorder import Witness, asked_boxes
from sqrp_cli.runtime.run.tool import Tool


class Execution:
    """One run of a program."""

    def __init__(
        self,
        program: Program,
        workspace: Workspace,
        robot: RobotBody,
        cell: SimulatedCell,
        pool: PerceptionPool,
        replanner: Replanner,
        faults: Sequence[InjectedFault] = (),
        listeners: Sequence[Listener] = (),
        gallery: Gallery | None = None,
        *,
        witnessed: bool = False,
    ) -> None:
        """gallery: takes every image with what was seen in it, if images are to be kept.

        witnessed: whether listeners are told where everything really is, too.
        """
        self._program, self._robot, self._cell, self._faults = program, robot, cell, list(faults)
        self._cameras = workspace.cameras
        before = program.steps[0].before
        joints, limits, stop_limits = program.joints, workspace.robot.limits, workspace.robot.stop_limits
        q = np.array([before.joints[name] for name in joints])
        self._playback = Playback(joints, [limits[name] for name in joints], [stop_limits[name] for name in joints], q)
        self._narrator = Narrator(listeners)
        self._eyes = Eyes(workspace.cameras.values(), pool)
        self._tool = Tool(cell, self._playback, robot.fingers, holding=before.held is not None)
        self._lookout = Lookout(workspace.cameras, cell, self._eyes, pool, self._narrator, gallery)
        responses = {name: camera.response for name, camera in workspace.cameras.items()}
        self._ledger = FaultLedger(cell, self._eyes, pool, responses, self._narrator)
        self._witness = Witness(cell, self._narrator) if witnessed else None
        self._lockstep = Lockstep(
            self._witness or cell,
            self._playback,
            self._tool,
            self._eyes,
            self._lookout,
            GroundTruth(cell, robot),
            self._ledger,
            self._narrator,
        )
        self._retry = Retry(
            self._lockstep, self._playback, self._tool, self._lookout, self._ledger, cell, replanner, self._narrator
        )
        self._report = RunReport()

    def run(self) -> RunReport:
        """Run all steps; returns how it went."""
        report, lockstep = self._report, self._lockstep
        try:
            for index, step in enumerate(self._program.steps):
                self._run_step(index, step)
        except Stopped as stopped:
            report.outcome, report.reason = "stopped", str(stopped)
            self._ledger.stopped(lockstep.now, stopped if isinstance(stopped, Unwatched) else None)
            lockstep.halt(str(stopped))
        if self._witness is not None:
            self._witness.finish()
        report.time = round(lockstep.now, 6)
        report.faults, report.conflicts = self._ledger.records, self._lookout.conflicts
        report.stop_told, report.stop_done = lockstep.stop_told, lockstep.standing_since
        report.tracking, report.images = self._cell.tracking_error(), self._eyes.images
        self._narrator.publish(RunEnded(t=lockstep.now, event=report.outcome, reason=report.reason))
        wall = self._narrator.wall
        report.wall = {**wall, "all": self._narrator.elapsed(), "perception (in parallel)": self._eyes.seconds}
        return report

    def _run_step(self, index: int, step: Step) -> None:
        """Run a step, with as many retries as its response to a fault allows. Raises Stopped if that does not help."""
        record = StepRecord(step.skill, step.parameters, step.short_task, self._lockstep.now)
        self._report.steps.append(record)
        self._tool.holding = step.before.held is not None
        while True:
            attempt, alarm = self._attempt(index, step, first=record.attempts == 1)
            if alarm is None:
                break
            response, retries = alarm.response, record.attempts - 1
            if alarm.kind == "fault":
                self._ledger.seen(alarm, self._lockstep.now)
            elif alarm.kind == "violation":
                self._ledger.suspected(self._lockstep.now)
            if response.action != "retry" or retries >= response.retries:
                after = f" after {retries} {'retry' if retries == 1 else 'retries'}" if retries else ""
                raise Stopped(f"{alarm.text}{after}")
            step = self._retry.prepare(attempt, alarm)
            record.attempts += 1
            self._ledger.acted(self._lockstep.now)
            time = round(step.time, 6)
            self._narrator.publish(
                Retrying(t=self._lockstep.now, attempt=retries + 1, of=response.retries, step=step.skill, time=time)
            )
        record.end, record.unseen = round(self._lockstep.now, 6), attempt.unseen
        self._ledger.recovered(self._lockstep.now)

    def _attempt(self, index: int, step: Step, *, first: bool) -> tuple[Attempt, Alarm | None]:
        """Try a step once. Returns the attempt, and the alarm that needs a response; None if the step is done."""
        expectation = Expectation(step, self._program.joints, self._robot)
        check = PredictionCheck(index, expectation, list(self._cameras))
        judge = Judge(expectation, self._lookout.period)
        attempt = Attempt(step, expectation, judge, check, undisturbed=first)
        self._lockstep.attempt = attempt
        self._lookout.watch(attempt, index + 1, self._lockstep.now)
        began = StepBegan(
            t=self._lockstep.now,
            number=index + 1,
            skill=step.skill,
            parameters=dict(step.parameters),
            time=round(step.time, 6),
            boxes=asked_boxes(step),
        )
        self._narrator.publish(began)
        try:
            wrong = self._look(attempt, 0.0)
            if wrong is not None:
                raise Stopped(f"wrong start: {wrong.text}")
            alarm = self._move(attempt, index + 1)
        finally:
            if first:
                self._report.prediction.append(check.counts)
                self._report.disagreements.extend(check.disagreements)
        return attempt, alarm

    def _move(self, attempt: Attempt, number: int) -> Alarm | None:
        """Play the motion of an attempt at the step of a number, then look at what came of it."""
        lockstep, eyes = self._lockstep, self._eyes
        attempt.start = lockstep.now
        self._schedule(attempt, number, attempt.start)
        self._playback.play(attempt.step.primitives, attempt.start)
        end = attempt.end
        while lockstep.now < end - 1e-9 or eyes.has_arrival_from(end):
            for alarm in attempt.alarms(lockstep.pass_time(end)):
                if alarm.response.action != "continue":
                    return alarm
                self._ledger.seen(alarm, lockstep.now)
        self._lookout.forget(lockstep.now)
        return self._look(attempt, attempt.step.time)

    def _look(self, attempt: Attempt, tau: float) -> Alarm | None:
        """Stand and look until the images agree with what should be so at a time of the step, or for long enough."""
        lockstep, lookout = self._lockstep, self._lookout
        until = lockstep.now + max(PATIENCE, 3 * lookout.period) + lookout.latency
        alarm: Alarm | None = None
        looked = False
        while not looked or (alarm is not None and lockstep.now < until - 1e-9):
            for look in lockstep.pass_time():
                if look.complete:
                    attempt.note(look)
                    alarm = attempt.judge.at_rest(tau, look.values)
                    looked = True
        return alarm

    def _schedule(self, attempt: Attempt, number: int, start: float) -> None:
        """Have everything done that belongs to a motion that begins at `start` [s].

        number: of the step, whose faults happen once, with its first motion.
        """
        tool, schedule = self._tool, self._lockstep.schedule
        for primitive in attempt.step.primitives:
            begin, end = start + primitive.start, start + primitive.end
            if primitive.action == "Grasp":
                schedule(Due(begin, "tool", partial(self._grasp, attempt)))
            elif primitive.action == "Release":
                schedule(Due(begin if tool.fingers is not None else end, "tool", tool.release))
                schedule(Due(end, "tool", tool.released))
            schedule(Due(begin, "primitive", partial(self._begin, primitive.name)))
        for fault in self._faults:
            if fault.step == number:
                schedule(Due(start + (fault.t or 0.0), "fault", partial(self._inject, fault)))
        self._faults = [fault for fault in self._faults if fault.step != number]

    def _grasp(self, attempt: Attempt) -> None:
        self._tool.grasp()
        attempt.undisturbed &= not self._ledger.is_open

    def _begin(self, primitive: str) -> None:
        self._narrator.begin(self._lockstep.now, primitive)

    def _inject(self, fault: InjectedFault) -> None:
        if self._lockstep.attempt is not None:
            self._ledger.inject(fault, self._lockstep.now, self._lockstep.attempt)
