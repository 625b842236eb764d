"""One run of a program: command, images, evidence, verdict, alarm, recovery, retry."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from sqrp_cli.errors import InputError, bad_input
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, ProgramPrimitive, Replanner, Step
from sqrp_cli.runtime.cell.interface import RunnableCell
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.nominal_step import NominalStep
from sqrp_cli.runtime.monitor.prediction_check import PredictionCheck
from sqrp_cli.runtime.monitor.step_monitor import PATIENCE, Alarm, StepMonitor
from sqrp_cli.runtime.perception.detector_pool import DetectorPool
from sqrp_cli.runtime.perception.image_stream import ImageStreams, Streams
from sqrp_cli.runtime.record.events import EventPublisher, Listener, Retrying, RunEnded, StepBegan
from sqrp_cli.runtime.record.film import ImageRecorder
from sqrp_cli.runtime.record.report import MonitoringLost, RunReport, StepRecord, Stopped
from sqrp_cli.runtime.robot_body import RobotBody
from sqrp_cli.runtime.run.commanded_robot import CommandedRobot
from sqrp_cli.runtime.run.evidence_collector import EvidenceCollector
from sqrp_cli.runtime.run.fault_tracker import FaultTracker, MakeHappen, in_simulation
from sqrp_cli.runtime.run.ground_truth import Beliefs, GroundTruth, StateRecorder, Truths, asked_boxes
from sqrp_cli.runtime.run.injected_fault import InjectedFault, StepPlace, parse_fault
from sqrp_cli.runtime.run.lockstep import SAME_INSTANT, Due, Lockstep
from sqrp_cli.runtime.run.retry_planner import RetryPlanner


@dataclass(frozen=True, eq=False)
class Workcell:
    """What a run commands and observes."""

    workspace: Workspace
    body: RobotBody
    cell: RunnableCell
    streams: Streams
    truth: Truths
    make_happen: MakeHappen
    witness: SimulatedCell | None = None
    """Where the true poses are to be had; in a real cell, what the run believes stands for them."""

    @classmethod
    def simulated(cls, workspace: Workspace, body: RobotBody, cell: SimulatedCell, detectors: DetectorPool) -> Workcell:
        """A simulated cell, whose images are looked at in other processes."""
        streams = ImageStreams(workspace.cameras, detectors)
        return cls(workspace, body, cell, streams, GroundTruth(cell, body), in_simulation(cell, streams), cell)


class Spectator(Protocol):
    """Somebody who looks on, and may let go what the tool holds."""

    def wants_slip(self) -> bool:
        """Whether it is to slip now."""

    def told(self, fault: str, refused: str) -> None:
        """The fault as `--fault` would have it, and why it cannot happen; empty if it does."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What is kept of a run, and its listeners."""

    listeners: Sequence[Listener] = ()
    """Called with each event as it happens."""
    images: ImageRecorder | None = None
    """Receives every image with its detections."""
    states: bool = False
    """Whether the events include the true poses; the run itself is the same."""
    spectator: Spectator | None = None


class Run:
    """One run of a program."""

    def __init__(
        self,
        program: Program,
        workcell: Workcell,
        replanner: Replanner,
        faults: Sequence[InjectedFault],
        recording: Recording,
    ) -> None:
        """replanner: plans retries. faults: that are to happen."""
        self._program, self._body, self._cell, self._faults = program, workcell.body, workcell.cell, list(faults)
        cell, workspace = workcell.cell, workcell.workspace
        self._publisher = EventPublisher(recording.listeners)
        self._beliefs = Beliefs(cell, program.steps[0].before)
        self._states = StateRecorder(workcell.witness or self._beliefs, self._publisher) if recording.states else None
        self._robot = CommandedRobot.at_the_start(program, workspace.robot, cell, self._states)
        self._streams = workcell.streams
        self._collector = EvidenceCollector(cell, self._streams, self._publisher, recording.images)
        self._tracker = FaultTracker(workcell.make_happen, self._streams, self._publisher)
        self._lockstep = Lockstep(self._robot, self._collector, self._tracker, workcell.truth, self._publisher)
        self._retry_planner = RetryPlanner(self._lockstep, replanner)
        self._spectator = recording.spectator
        self._report = RunReport()

    def run(self) -> RunReport:
        """Run all steps; returns how it went."""
        return self._reported(self._run_steps)

    def look(self) -> RunReport:
        """Look whether all is as it should be where the first step starts, without moving; returns what came of it."""
        step = self._program.steps[0]
        return self._reported(lambda: self._look_at_start(self._prepared(0, step, first=True), 1))

    def _run_steps(self) -> None:
        for index, step in enumerate(self._program.steps):
            self._run_step(index, step)

    def _reported(self, happen: Callable[[], None]) -> RunReport:
        """How it went when something happened."""
        report, lockstep = self._report, self._lockstep
        try:
            happen()
        except Stopped as stopped:
            report.outcome, report.reason = "stopped", str(stopped)
            self._tracker.stopped(lockstep.now, stopped if isinstance(stopped, MonitoringLost) else None)
            lockstep.halt(str(stopped))
        if self._states is not None:
            self._states.finish()
        report.time = round(lockstep.now, 6)
        report.faults, report.conflicts = self._tracker.records, self._collector.conflicts
        if report.missed and report.outcome == "done":
            named = " and ".join(f"{fault.name}, which happened at {fault.happened:.2f} s" for fault in report.missed)
            report.outcome, report.reason = "missed", f"no image showed {named}"
        report.stop_told, report.stop_done = lockstep.stop_told, lockstep.standing_since
        report.tracking, report.images = self._cell.tracking_error(), self._streams.images
        self._publisher.publish(RunEnded(t=lockstep.now, event=report.outcome, reason=report.reason))
        wall = self._publisher.wall
        report.wall = {**wall, "all": self._publisher.elapsed(), "perception (in parallel)": self._streams.seconds}
        return report

    def _run_step(self, index: int, step: Step) -> None:
        """Run a step, with as many retries as its response to a fault allows. Raises Stopped if that does not help."""
        record = StepRecord(step.skill, step.parameters, step.short_task, self._lockstep.now)
        self._report.steps.append(record)
        self._robot.holding = step.before.held is not None
        attempt, alarm = self._attempt(index, step, first=True)
        while alarm is not None:
            step = self._respond(attempt, alarm, record)
            attempt, alarm = self._attempt(index, step, first=False)
        record.end, record.unseen = round(self._lockstep.now, 6), attempt.unseen
        self._tracker.recovered(self._lockstep.now)

    def _attempt(self, index: int, step: Step, *, first: bool) -> tuple[Attempt, Alarm | None]:
        """Try a step once. Returns the attempt, and the alarm that needs a response; None if the step is done."""
        attempt, number = self._prepared(index, step, first=first), index + 1
        check = attempt.check
        try:
            self._look_at_start(attempt, number)
            alarm = self._move(attempt, number)
        finally:
            if first:
                self._report.prediction.append(check.counts)
                self._report.usual.append(check.usual)
                self._report.disagreements.extend(check.disagreements)
        return attempt, alarm

    def _prepared(self, index: int, step: Step, *, first: bool) -> Attempt:
        """An attempt at a step, before it begins."""
        nominal = NominalStep(step, self._program.joints, self._body)
        check = PredictionCheck(index, nominal, list(self._streams.cameras))
        return Attempt(step, nominal, StepMonitor(nominal, self._streams.period), check, undisturbed=first)

    def _look_at_start(self, attempt: Attempt, number: int) -> None:
        """Begin an attempt at the step of a number by a look. Raises Stopped where something is not as it should be."""
        lockstep = self._lockstep
        lockstep.attempt = self._beliefs.attempt = attempt
        lockstep.catch_up()
        self._collector.watch(attempt, number, lockstep.now)
        self._publisher.publish(_step_began(attempt.step, number, lockstep.now))
        if (wrong := self._look(attempt, 0.0)) is not None:
            raise Stopped(f"wrong start: {wrong.text}")

    def _move(self, attempt: Attempt, number: int) -> Alarm | None:
        """Play the motion of an attempt at the step of a number, then look at what came of it."""
        lockstep = self._lockstep
        attempt.start = lockstep.present
        self._schedule(attempt, number, attempt.start)
        self._robot.motion.play(attempt.step.primitives, attempt.start)
        end = attempt.end
        while lockstep.now < end - 1e-9 or self._streams.has_arrival_from(end):
            if self._spectator is not None and self._spectator.wants_slip():
                self._slip(self._spectator, number, attempt.start)
            for alarm in attempt.alarms(lockstep.pass_time(end)):
                if alarm.response.action != "continue":
                    return alarm
                self._tracker.seen(alarm, lockstep.now)
        self._collector.forget(lockstep.now)
        return self._look(attempt, attempt.step.time)

    def _slip(self, spectator: Spectator, number: int, start: float) -> None:
        """Let slip what the tool holds, at the next millisecond, so that a command can say when."""
        t = math.ceil(1e3 * (self._lockstep.now - start + SAME_INSTANT)) / 1e3
        text = StepPlace(number, self._program.steps).prefix + f"slip@{t:g}"
        refused = ""
        try:
            if self._report.steps[-1].attempts > 1:
                raise bad_input("bad-fault", "a fault happens in the first try of a step")
            fault = parse_fault(text, self._program.steps, (), np.random.default_rng(0), "slip")
            self._lockstep.schedule(Due(start + (fault.t or 0.0), "fault", partial(self._inject, fault)))
        except InputError as error:
            refused = error.problems[0].message
        spectator.told(text, refused)

    def _look(self, attempt: Attempt, tau: float) -> Alarm | None:
        """Stand and look until the images agree with what should be so at a time of the step, or for long enough."""
        lockstep, streams = self._lockstep, self._streams
        until = lockstep.now + max(PATIENCE, 3 * streams.period) + streams.latency
        alarm: Alarm | None = None
        looked = False
        while not looked or (alarm is not None and lockstep.now < until - 1e-9):
            for evidence in lockstep.pass_time():
                if evidence.complete:
                    attempt.note(evidence)
                    alarm = attempt.monitor.at_rest(tau, evidence.values)
                    looked = True
        return alarm

    def _respond(self, attempt: Attempt, alarm: Alarm, record: StepRecord) -> Step:
        """Plan the step of an attempt again after an alarm. Raises Stopped where no retry is left or possible."""
        lockstep, response, retries = self._lockstep, alarm.response, record.attempts - 1
        if alarm.kind == "fault":
            self._tracker.seen(alarm, lockstep.now)
        elif alarm.kind == "violation":
            self._tracker.suspected(lockstep.now)
        if response.action != "retry" or retries >= response.retries:
            after = f" after {retries} {'retry' if retries == 1 else 'retries'}" if retries else ""
            raise Stopped(f"{alarm.text}{after}")
        step = self._retry_planner.prepare(attempt, alarm)
        record.attempts += 1
        self._tracker.acted(lockstep.now)
        time = round(step.time, 6)
        self._publisher.publish(
            Retrying(t=lockstep.now, attempt=retries + 1, of=response.retries, step=step.skill, time=time)
        )
        return step

    def _schedule(self, attempt: Attempt, number: int, start: float) -> None:
        """Have everything done that belongs to a motion that begins at `start` [s].

        number: of the step, whose faults happen once, with its first motion.
        """
        for primitive in attempt.step.primitives:
            self._schedule_primitive(attempt, primitive, start)
        for fault in self._faults:
            if fault.step == number:
                self._lockstep.schedule(Due(start + (fault.t or 0.0), "fault", partial(self._inject, fault)))
        self._faults = [fault for fault in self._faults if fault.step != number]

    def _schedule_primitive(self, attempt: Attempt, primitive: ProgramPrimitive, start: float) -> None:
        robot, schedule = self._robot, self._lockstep.schedule
        begin, end = start + primitive.start, start + primitive.end
        if primitive.action == "Grasp":
            schedule(Due(begin, "tool", partial(self._grasp, attempt)))
        elif primitive.action == "Release":
            schedule(Due(begin if robot.fingers is not None else end, "tool", robot.release))
            schedule(Due(end, "tool", robot.released))
        schedule(Due(begin, "primitive", partial(self._begin, primitive)))

    def _grasp(self, attempt: Attempt) -> None:
        self._robot.grasp()
        attempt.undisturbed &= not self._tracker.is_open

    def _begin(self, primitive: ProgramPrimitive) -> None:
        self._publisher.begin(self._lockstep.now, primitive.name, primitive.does)

    def _inject(self, fault: InjectedFault) -> None:
        if self._lockstep.attempt is not None:
            self._tracker.inject(fault, self._lockstep.now, self._lockstep.attempt)


def _step_began(step: Step, number: int, now: float) -> StepBegan:
    return StepBegan(
        t=now,
        number=number,
        skill=step.skill,
        parameters=dict(step.parameters),
        time=round(step.time, 6),
        boxes=asked_boxes(step),
    )
