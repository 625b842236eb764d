"""One run of a program: command, images, evidence, verdict, alarm, recovery, retry."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, bad_input
from sqrp_cli.logic.domain import nested
from sqrp_cli.logic.formula import Predicate
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth, evaluate
from sqrp_cli.program.record import Program, Replanner, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.cell.ros_cell import RosCell
from sqrp_cli.run.faults import InjectedFault, parse_fault
from sqrp_cli.run.lockstep import SAME_INSTANT, EvidenceCollector, Lockstep
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.monitor.step_monitor import PATIENCE, Alarm, Attempt, PredictionCheck, read_formula
from sqrp_cli.run.perception.detections import CellModel, DetectionTargets
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.perception.streams import ImageStreams, ReceivedStreams, Streams
from sqrp_cli.run.record.events import EventPublisher, Listener, listed
from sqrp_cli.run.record.images import ImageRecorder
from sqrp_cli.run.record.report import Outcome, RunReport, StepRecord, Stopped
from sqrp_cli.run.robot_body import RobotBody

if TYPE_CHECKING:
    from sqrp_cli.run.cell import RunnableCell

LOOK_AGAIN = 2.0  # How long the robot stands and waits for the condition of a retry to be seen [s]
ELSEWHERE = 0.05  # How far from where it is meant to be at the end a part is that was dropped [m]
SPACING = 0.05  # Sampling period of a motion in the search for a viewpoint [s]


@dataclass(frozen=True, eq=False)
class Recording:
    """What is kept of a run, and its listeners."""

    listeners: Sequence[Listener] = ()  # Called with each event as it happens
    images: ImageRecorder | None = None  # Receives every image with its detections
    states: bool = False  # Whether the events include the true poses; the run itself is the same
    spectator: Any = None
    """Somebody who looks on, and may let slip what the tool holds: where `wants_slip()` says so, it slips now.

    `told(fault, refused)` gets the fault as `--fault` would have it, and why it cannot happen; empty if it does.
    """


class Run:
    """One run of a program in a cell, simulated or real, with what it takes: its perception, monitors and clock."""

    def __init__(
        self,
        program: Program,
        workspace: Workspace,
        cell: RunnableCell,
        replanner: Replanner,
        faults: Sequence[InjectedFault] = (),
        recording: Recording | None = None,
    ) -> None:
        """replanner: plans retries. faults: that are to happen, in a simulated cell.

        Raises InputError for a mesh, or a detector of a package, that cannot be used.
        """
        recording = Recording() if recording is None else recording
        self._program, self._cell, self._faults, self._replanner = program, cell, list(faults), replanner
        self._body, self._spectator = RobotBody.load(workspace.robot), recording.spectator
        self._detectors, cameras = DetectorPool(CellModel.of(workspace, self._body)), workspace.cameras
        self._streams: Streams = ImageStreams(cameras, self._detectors)
        if isinstance(cell, RosCell):
            self._streams = ReceivedStreams(cameras, self._detectors, lambda: cell.t, cell.file.mend_of_lateness)
        publisher = EventPublisher(recording.listeners)
        collector = EvidenceCollector(cell, self._streams, publisher, recording.images)
        states, robot = recording.states, workspace.robot
        self._lockstep = Lockstep(program, robot, cell, self._body, collector, publisher, states=states)
        self._report = RunReport(workspace=workspace.name)

    def run(self, *, moves: bool = True) -> RunReport:
        """Run all steps, and return how it went; without moving, only look whether all is right where the first starts.

        It can be run once.
        """
        lockstep, tracker, reason = self._lockstep, self._lockstep.faults, None
        outcome: Outcome = "done"
        with self._detectors:
            if isinstance(self._cell, RosCell):
                self._detectors.watch(DetectionTargets({}, {}, {}))
                self._detectors.get_ready()
                self._cell.begin()
            try:
                for index, step in enumerate(self._program.steps if moves else ()):
                    self._run_step(index, step)
                if not moves:
                    self._began(0, self._program.steps[0], first=True)
            except Stopped as stopped:
                outcome, reason = "stopped", str(stopped)
                tracker.stopped(lockstep.now, stopped)
                lockstep.stop(str(stopped), protective=True)
            lockstep.publish_state()
        truth = self._cell.truth()
        if outcome == "done" and truth is not None:
            meant = self._program.steps[-1].after.X_WO
            lies = {name: X_WO[:3, 3] - meant[name][:3, 3] for name, X_WO in truth.X_WO.items() if name in meant}
            for record in tracker.records if any(np.linalg.norm(away) > ELSEWHERE for away in lies.values()) else ():
                # A part lies where it should not: no formula asks about when it slipped, but it did.
                if record.kind == "slip" and record.happened is None and record.detected is None:
                    record.happened = record.injected
        report = replace(
            self._report,
            time=round(lockstep.now, 6),
            faults=[replace(record) for record in tracker.records],  # with the delays that follow from the times
            conflicts=lockstep.collector.conflicts,
            tracking=None if truth is None else truth.tracking,
            images=self._streams.images,
            stop=lockstep.last_stop,
        )
        if report.missed and outcome == "done":
            named = " and ".join(f"{fault.name}, which happened at {fault.happened:.2f} s" for fault in report.missed)
            outcome, reason = "missed", f"no image showed {named}"
        publisher = lockstep.publisher
        publisher.publish(outcome, lockstep.now, reason=reason)
        wall = {**publisher.wall, "all": time.perf_counter() - publisher.began}
        wall["perception (in parallel)"] = self._streams.seconds
        return replace(report, outcome=outcome, reason=reason, wall=wall)

    def _run_step(self, index: int, step: Step) -> None:
        """Run a step, with as many retries as its response to a fault allows. Raises Stopped if that does not help."""
        lockstep, tracker, report = self._lockstep, self._lockstep.faults, self._report
        record = StepRecord(step.skill, step.parameters, step.short_task, lockstep.now, says=step.says)
        report.steps.append(record)
        lockstep.command_hold(holding=step.before.held is not None)
        while True:
            first, retries = record.attempts == 1, record.attempts - 1
            attempt = self._began(index, step, first=first)
            alarm = self._move(attempt, index + 1)
            if alarm is None:
                break
            response = alarm.response
            if alarm.kind == "fault":
                tracker.seen(alarm, lockstep.now)
            for fault in tracker.open if alarm.kind == "violation" else ():  # images show that something is wrong
                fault.detected = lockstep.now if fault.detected is None else fault.detected
            if response.action != "retry" or retries >= response.retries:
                after = f", after {retries} {'retry' if retries == 1 else 'retries'}" if retries else ""
                raise Stopped(f"{alarm.text}{after}")
            step = prepare_retry(lockstep, self._replanner, attempt, alarm)
            record.attempts += 1
            tracker.note(acted=lockstep.now)
            of, planned = response.retries, round(step.time, 6)
            lockstep.publisher.publish("retry", lockstep.now, attempt=retries + 1, of=of, step=step.skill, time=planned)
        record.end, record.unseen = round(lockstep.now, 6), attempt.unseen
        tracker.note(recovered=lockstep.now)
        tracker.open.clear()

    def _began(self, index: int, step: Step, *, first: bool) -> Attempt:
        """An attempt at a step, begun by a look. Raises Stopped where something is not as it should be."""
        nominal, report = NominalStep(step, self._program.joints, self._body), self._report
        check = PredictionCheck(index, nominal, list(self._streams.cameras))
        attempt = Attempt(nominal, self._streams.period, check, undisturbed=first)
        if first and report.steps:  # predictions are checked while all goes as planned, and not by a mere look
            report.prediction.append(check.counts)
            report.usual.append(check.usual)
            check.disagreements = report.disagreements
        self._lockstep.begin(attempt, index + 1)
        if (wrong := self._look(attempt, 0.0)) is not None:
            raise Stopped(f"wrong start: {wrong.text}")
        return attempt

    def _move(self, attempt: Attempt, number: int) -> Alarm | None:
        """Play the motion of an attempt at the step of a number, then look at what came of it.

        The faults of the step happen once, with its first motion.
        """
        lockstep, schedule = self._lockstep, self._lockstep.schedule
        start = attempt.start = self._streams.present(lockstep.now)
        for primitive in attempt.step.primitives:
            begin, end = start + primitive.start, start + primitive.end
            if primitive.action == "Grasp":
                schedule(begin, "grasp")
            elif primitive.action == "Release":  # fingers follow their motion from its beginning
                schedule(begin if lockstep.fingers is not None else end, "release")
                schedule(end, "released")
            schedule(begin, primitive)
        for fault in [fault for fault in self._faults if fault.step == number]:
            self._faults.remove(fault)
            schedule(start + (fault.t or 0.0), fault)
        lockstep.motion.play(attempt.step.primitives, start)
        end = start + attempt.step.time
        while lockstep.now < end - 1e-9 or self._streams.has_arrival_from(end):
            if self._spectator is not None and self._spectator.wants_slip():
                # At the next millisecond, so that a command can say when.
                t = math.ceil(1e3 * (lockstep.now - start + SAME_INSTANT)) / 1e3
                text, refused = f"slip@{t:g}" if len(self._program.steps) == 1 else f"{number}:slip@{t:g}", ""
                try:
                    if self._report.steps[-1].attempts > 1:
                        raise bad_input("bad-fault", "a fault happens in the first try of a step")
                    fault = parse_fault(text, self._program.steps, (), np.random.default_rng(0), "slip")
                    schedule(start + (fault.t or 0.0), fault)
                except InputError as error:
                    refused = error.problems[0].message
                self._spectator.told(text, refused)
            for alarm in attempt.alarms(lockstep.pass_time(end)):
                if alarm.response.action != "continue":
                    return alarm
                lockstep.faults.seen(alarm, lockstep.now)
        lockstep.collector.forget(lockstep.now)
        return self._look(attempt, attempt.step.time)

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
                    alarm = attempt.at_rest(tau, evidence.values)
                    looked = True
        return alarm


def prepare_retry(lockstep: Lockstep, replanner: Replanner, attempt: Attempt, alarm: Alarm) -> Step:
    """The step of an attempt that failed again, from where the arm stands then, in the world that is seen then.

    The robot stops at once where it is predicted to see the condition of the retry, or sees it already; else it moves
    on first, without any command to the tool. It stands then until the condition is seen, and all cameras have said
    where objects are. Raises Stopped where the condition is not seen or no motion is found.
    """
    condition = None if alarm.response.when is None else read_formula(alarm.response.when)
    atoms = {str(one.atom) for one in (nested(condition) if condition else ()) if isinstance(one, Predicate)}
    collector, motion, when, before = lockstep.collector, lockstep.motion, alarm.response.when, attempt.step.before

    def is_seen() -> bool:
        known = {Atom.of(atom): value for atom, value in collector.values.items()}
        return condition is None or evaluate(condition, [(0.0, known)], 0.0, 0.0).at(0) == Truth.TRUE

    attempt.failed, attempt.undisturbed = True, False
    lockstep.cancel(str)
    where = ""  # it looks, for the reason why it stops
    if when is not None and condition is not None and not is_seen():
        # The next place along the motion from which all atoms of the condition are predicted to be seen, else its end.
        tau, end, nominal = motion.step_time(lockstep.now), attempt.step.time, attempt.nominal
        stop_at, cameras = end, list[str]()
        for begin in np.arange(min(tau, end), end, SPACING).tolist():
            stands = motion.standing_time(begin)
            margin = min(collector.streams.period, stands, end - stands)
            if all(atom in attempt.step.targets and nominal.is_covered(atom, stands, margin) for atom in atoms):
                cameras = sorted({name for atom in atoms for name in nominal.covering(atom, stands, margin)})
                stop_at = begin
                break
        where = f" where {listed(cameras)} should see it" if cameras else " at the end of the motion"
        if stop_at > tau:
            began = lockstep.now
            until = round(stop_at, 6)
            lockstep.publisher.publish("moving on", began, to_see=when, cameras=cameras, until=until)
            if lockstep.fingers is not None:  # they stay, whatever the rest of the motion does with them
                wanted = dict(zip(motion.joints, motion.state(began).positions.tolist(), strict=True))
                motion.place({name: wanted[name] for name in lockstep.fingers.open if name in wanted})
            while lockstep.now < began + stop_at - tau - 1e-9 and not is_seen():
                lockstep.pass_time(began + stop_at - tau)
            lockstep.faults.note(moved_on=round(lockstep.now - began, 6))
    lockstep.stop(alarm.text)
    lockstep.cell.release()  # at once, whatever the motion wants of the fingers
    lockstep.command_hold(holding=False)
    if lockstep.fingers is not None:
        motion.place(lockstep.fingers.open)
    collector.forget(lockstep.now)
    until = lockstep.now + LOOK_AGAIN
    while when is not None and not (collector.complete and is_seen()):
        if lockstep.now >= until - 1e-9:
            told = " and ".join(f"whether {attempt.step.in_words(atom)}" for atom in sorted(atoms))
            raise Stopped(f"{told} was not seen within {LOOK_AGAIN:g} s of standing{where}, so there is no retry")
        lockstep.pass_time(until)
    # The world as the images show it: objects where they were located, facts by evidence.
    X_WO = dict(before.X_WO)
    for name, place in collector.places.items():
        X_WO[name] = X_WO[name].copy()
        X_WO[name][:3, 3] = np.median(place, axis=0)
    known = {Atom.of(atom): value for atom, value in collector.values.items()}
    seen, refuted = ({atom for atom, value in known.items() if value == one} for one in (Truth.TRUE, Truth.FALSE))
    # Fingers may still be on their way to where they were told to be.
    measured = {**lockstep.cell.measured_joints(), **(lockstep.fingers.open if lockstep.fingers is not None else {})}
    joints = {name: measured.get(name, value) for name, value in before.joints.items()}
    world = replace(before, facts=(before.facts | seen) - refuted, X_WO=X_WO, joints=joints)
    if (planned := replanner(attempt.step, world)) is None:
        raise Stopped(f"{attempt.step.skill} cannot be tried again: no motion from here can be done")
    return planned
