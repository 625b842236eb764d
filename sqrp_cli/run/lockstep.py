"""Cell, cameras and perception on one clock: time passes from one event to the next, for all together."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program, ProgramPrimitive
from sqrp_cli.robot.robot import Robot
from sqrp_cli.run.arm_motion import ArmMotion
from sqrp_cli.run.faults import FaultTracker, InjectedFault
from sqrp_cli.run.ground_truth import DIGITS, RATE, changes, logged_poses, step_began
from sqrp_cli.run.monitor.nominal_step import in_boxes
from sqrp_cli.run.monitor.step_monitor import Attempt
from sqrp_cli.run.perception.detections import BelievedState, Detection, Evidence, fuse
from sqrp_cli.run.perception.streams import Streams
from sqrp_cli.run.record.events import EventPublisher, ShownAtom
from sqrp_cli.run.record.images import ImageRecorder
from sqrp_cli.run.record.report import TRUTH_SPACING, StopTimes
from sqrp_cli.run.robot_body import OPEN_SHARE, RobotBody

if TYPE_CHECKING:
    from sqrp_cli.run.cell import RunnableCell

MOST_COMMANDS = 20  # Most commands to the tool that are remembered
FEELING = 0.004  # Time between looks at the force of a guarded move [s]
SAME_INSTANT = 0.0015
"""Times that are closer are one [s]: the simulation steps by 2 ms, and takes images at the nearest step."""
Due: TypeAlias = Literal["grasp", "release", "released"] | ProgramPrimitive | InjectedFault
"""What is due at a time: that the tool grasps, lets go, and has; that a primitive begins; a fault to inject."""
Moment: TypeAlias = tuple[float | None, Mapping[str, bool], bool]
"""What a run knows of a time: that of the step's motion [s], None before it; the true values of all atoms, in a real
cell the planned ones; and whether the tool was commanded to hold."""
FRESH_PERIODS = 1.5  # What an image shows counts for this many frame periods of its camera


class EvidenceCollector:
    """Has images taken and looked at, and knows what all cameras together show of the attempt that is watched.

    An image counts as evidence from its exposure until the next exposure of its camera, at most for some frame periods.
    While an image is under way, the one before it no longer counts, and the cameras with arrived images decide alone.
    Evidence of a time is complete when no image taken by then is under way.
    """

    _attempt: Attempt

    def __init__(
        self, cell: RunnableCell, streams: Streams, publisher: EventPublisher, recorder: ImageRecorder | None = None
    ) -> None:
        """recorder: takes every image with what was seen in it, if images are to be kept."""
        self._cell, self.streams = cell, streams
        self._publisher, self._recorder, self._number = publisher, recorder, 0
        self._lifetimes = {name: FRESH_PERIODS / camera.rate for name, camera in streams.cameras.items()}
        self._exposures: list[Evidence] = []
        self._completed = -float("inf")
        self.conflicts = 0
        """How often cameras contradicted each other about an atom."""
        self.forget(0.0)

    def watch(self, attempt: Attempt, number: int, t: float) -> None:
        """Look for the atoms of an attempt at the step with that number, in images from time t [s] on."""
        self._attempt, self._number = attempt, number
        self.streams.detectors.watch(attempt.nominal.sought)
        self.forget(t)

    def forget(self, t: float) -> None:
        """Go by images that are taken from time t [s] on, and by nothing that was known before."""
        self._exposures = [
            Evidence(one.t, one.tau, one.truths, {name: None for name, d in one.detections.items() if d is None})
            for one in self._exposures
            if one.t >= t - 1e-9
        ]
        self.values: dict[str, Truth] = {}
        """What is known of each atom: the newest that any images show, none older than the last complete evidence."""
        self.complete: dict[str, Truth] = {}
        """The values of the last exposure since `forget` of which the images of all cameras are there."""
        self.places: dict[str, list[Array]] = {}
        """Where objects were located since `forget`, by the images one after the other, (3,) each [m]."""

    def expose(self, t: float, moment_at: Callable[[float], Moment]) -> None:
        """Take the images that are due at time t [s]. moment_at: what the run knows of a time [s].

        Raises Stopped if a process that looks at them has ended.
        """
        attempt, moment_at = self._attempt, cache(moment_at)
        with self._publisher.timed("images"):
            images = self.streams.expose(
                t,
                self._cell.frames,
                lambda at: BelievedState(
                    dict(self._cell.measured_joints(at)), moment_at(at)[2], attempt.beliefs(moment_at(at)[0])
                ),
            )
        for at, together in groupby(images, lambda image: image.t):
            (tau, truths, _), taken = moment_at(at), list(together)
            index = bisect_left(self._exposures, at, key=lambda one: one.t)
            if index == len(self._exposures) or self._exposures[index].t != at:
                self._exposures.insert(index, Evidence(at, tau, truths))
            self._exposures[index].detections.update(dict.fromkeys(image.camera for image in taken))
            if self._recorder is not None:
                for image in taken:
                    self._recorder.add(image, self._number, tau if attempt.undisturbed else None, self._publisher.doing)

    def take_notice(self, detections: Sequence[Detection], now: float) -> list[Evidence]:
        """Learn from what images show; returns the evidence of each exposure that was not complete before."""
        attempt = self._attempt
        for detection in detections:
            camera, t = detection.camera, detection.t
            if self._recorder is not None:
                outlines = [(box.outline, box.evidence) for boxes in detection.boxes.values() for box in boxes]
                self._recorder.seen(camera, t, outlines)
            taken = (one for one in reversed(self._exposures) if one.t == t and camera in one.detections)
            if (exposure := next(taken, None)) is None:
                continue
            exposure.detections[camera] = detection
            for name, place in detection.places.items():
                self.places.setdefault(name, []).append(place)
            tau = exposure.tau
            if tau is not None and attempt.undisturbed and attempt.check and 0.0 <= tau <= attempt.step.time:
                attempt.check.add(detection, tau, attempt.monitored(tau), exposure.truths)
        found = self._fused() if detections else []
        for evidence in found:
            tau, has_arrivals = evidence.tau, any(one is not None for one in evidence.detections.values())
            if has_arrivals and evidence.told != evidence.atoms:
                required = attempt.monitored(max(tau or 0.0, 0.0))
                shown = {
                    atom: ShownAtom(
                        value=fused.truth.word,
                        true=evidence.truths.get(atom),
                        predicted=tau is not None and attempt.nominal.is_covered(atom, tau),
                        asked=atom in required,
                        cameras={camera: vote.word for camera, vote in sorted(fused.votes.items())},
                    )
                    for atom, fused in evidence.atoms.items()
                }
                exposed, at = round(evidence.t, 6), None if tau is None else round(tau, 6)
                self._publisher.publish("evidence", now, exposed=exposed, step_time=at, literals=shown)
                evidence.told = evidence.atoms
            if evidence.complete:
                self.conflicts += sum(fused.conflict for fused in evidence.atoms.values())
                self.complete = evidence.values
        self.values = dict(self.complete)
        for evidence in found:
            if not evidence.complete:
                self.values.update({atom: value for atom, value in evidence.values.items() if value != Truth.UNKNOWN})
        return found

    def _fused(self) -> list[Evidence]:
        """The evidence of each exposure that was not complete before, up to the last of which an image has arrived."""
        arrivals = [any(d is not None for d in one.detections.values()) for one in self._exposures]
        count = max((index + 1 for index, arrived in enumerate(arrivals) if arrived), default=0)
        found, complete, last = [], True, dict[str, Detection | None]()
        for exposure in self._exposures[:count]:
            last.update(exposure.detections)
            complete = complete and exposure.t < self.streams.settled and None not in exposure.detections.values()
            if exposure.t > self._completed:
                arrived = [detection for detection in last.values() if detection is not None]
                counting = [one for one in arrived if exposure.t - one.t < self._lifetimes[one.camera]]
                targets = self._attempt.step.targets
                exposure.atoms = {atom: fuse(atom, target, counting) for atom, target in targets.items()}
                exposure.complete = complete
                found.append(exposure)
        self._completed = max((evidence.t for evidence in found if evidence.complete), default=self._completed)
        oldest = self._completed - max(self._lifetimes.values())
        self._exposures = [exposure for exposure in self._exposures if exposure.t > oldest]
        return found


class Lockstep:
    """Everything of a run that time passes for, with the robot as it is commanded, and its faults.

    Only images show whether the tool really holds what it is commanded to hold. The true state of a simulated cell is
    known, of a real one joints are measured, and the rest is planned: it is for checks and for the log.
    """

    def __init__(
        self,
        program: Program,
        robot: Robot,
        cell: RunnableCell,
        body: RobotBody,
        collector: EvidenceCollector,
        publisher: EventPublisher,
        *,
        states: bool,
    ) -> None:
        """The robot standing where a program begins. states: whether the true state is published at a fixed rate."""
        before, joints = program.steps[0].before, program.joints
        q = np.array([before.joints[name] for name in joints])
        self.motion = ArmMotion(joints, [robot.limits[n] for n in joints], [robot.stop_limits[n] for n in joints], q)
        self.fingers, self.cell, self._body, self._world = robot.fingers, cell, body, before
        self._states, self._number, self._told = states, 0, -float("inf")
        self._last: Mapping[str, Any] | None = None
        self.collector, self.publisher = collector, publisher
        self.faults = FaultTracker(cell, collector.streams, publisher)
        self._commands = deque([(-float("inf"), before.held is not None)], MOST_COMMANDS)
        self._due: list[tuple[float, Due]] = []
        self.now = 0.0
        """The time on the cell's clock [s]."""
        self.attempt: Attempt | None = None
        """What the robot is at."""
        self.last_stop = StopTimes()
        """When it was last commanded to stop, and stood."""

    def begin(self, attempt: Attempt, number: int) -> None:
        """Be at an attempt at the step of a number, from now on; time may have passed since, as for planning."""
        self.attempt = attempt
        self.now = self.collector.streams.present(self.now, resume=True)
        self.collector.watch(attempt, number, self.now)
        self.publisher.publish("step", self.now, **step_began(attempt.step, number))

    def schedule(self, t: float, what: Due) -> None:
        """Do something at a time [s] of the cell's clock, after what is due at the same time already."""
        insort(self._due, (t, what), key=lambda due: due[0])

    def cancel(self, *kinds: type) -> None:
        """Do nothing of some kinds any more; commands to the tool are of the kind `str`."""
        self._due = [due for due in self._due if not isinstance(due[1], kinds)]

    def command_hold(self, *, holding: bool) -> None:
        """The tool counts as commanded to hold, or not, from now on."""
        self._commands.append((self.now, holding))

    def _moment(self, t: float) -> Moment:
        """What is known of the time of an image [s]; the clock of a simulation steps from time to time."""
        attempt = self.attempt
        assert attempt is not None  # noqa: S101 - images are looked at in attempts alone
        at = self.now if abs(t - self.now) < SAME_INSTANT else t
        tau = None if attempt.start is None else self.motion.step_time(at)
        holds = next((holds for since, holds in reversed(self._commands) if since <= at + 1e-9), self._commands[0][1])
        if (truth := self.cell.truth()) is None:
            return tau, {atom: attempt.nominal.holds(atom, tau or 0.0) for atom in attempt.step.targets}, holds
        is_open, X_WL = self._body.closure(truth.joints) <= OPEN_SHARE, self._body.link_poses(truth.joints)
        truths = {}
        for atom, target in attempt.step.targets.items():
            inside = in_boxes(atom, target, X_WL, truth.X_WO, attempt.step.before.X_WO, truth.held)
            truths[atom] = attempt.nominal.when_open[atom] == is_open if inside is None else inside
        return tau, truths, holds

    def advance(self, t: float) -> None:
        """Let time pass until t [s] as the cell does, publishing the state of each time that is due until then.

        That has no other effect. The first state is complete, the others say only what has changed.
        """
        while self._states and (due := self._number / RATE) <= t + 1e-9:
            self.now = self.cell.advance(due, self.motion)
            self.publish_state(due)
            self._number += 1
        self.now = self.cell.advance(t, self.motion)

    def publish_state(self, t: float | None = None) -> None:
        """Publish the state now, at time t [s]; without, that at the end unless it is known. Only if states are."""
        if not self._states:
            return
        if (truth := self.cell.truth()) is not None:
            now, X_WO, held, joints, _ = truth
        else:
            now, attempt, X_WO, held = self.now, self.attempt, self._world.X_WO, self._world.held
            joints = self.cell.measured_joints()
            if attempt is not None:
                tau = 0.0 if attempt.start is None else now - attempt.start
                begun = [one for one in attempt.step.primitives if one.start <= tau]
                X_WO, held = attempt.beliefs(tau), begun[-1].held if begun and not attempt.failed else None
        if t is None and now <= self._told + 1e-9:
            return
        q = [round(q, DIGITS) + 0.0 for q in joints.values()]
        state = {"joints": list(joints), "q": q, "held": held, "objects": logged_poses(X_WO)}
        self._told = now if t is None else t
        self.publisher.publish("state", self._told, **changes(state, self._last))
        self._last = state

    def pass_time(self, end: float = float("inf")) -> list[Evidence]:
        """Let time pass until the next event, at most until `end` [s].

        Returns the evidence of the images that have arrived. Raises Stopped where cameras or the processes
        behind them fail.
        """
        streams, motion, faults, attempt = self.collector.streams, self.motion, self.faults, self.attempt
        pending = any(record.injected is not None and record.happened is None for record in faults.open)
        coming = [streams.next_event]
        coming += [self._due[0][0]] if self._due else []
        coming += [end] if self.now < end - 1e-9 else []
        coming += [self.now + TRUTH_SPACING] if pending else []
        coming += [self.now + FEELING] if motion.force_limit(self.now) is not None else []
        with self.publisher.timed("physics"):
            self.advance(max(min(coming), self.now))
        limit = motion.force_limit(self.now)
        if limit is not None and (force := self.cell.tool_force()) >= limit:  # a guarded move meets what it looks for
            motion.halt_primitive(self.now)
            self.publisher.publish("contact", self.now, force=round(force, 1))
        if pending and attempt is not None:
            tau, truths, _ = self._moment(self.now)
            faults.look(self.now, tau, attempt, truths)
        with self.publisher.timed("waiting for perception"):
            arrived = streams.collect(self.now)
        while self._due and self._due[0][0] <= self.now + 1e-9 and attempt is not None:
            match self._due.pop(0)[1]:
                case "grasp":
                    self.cell.grasp()
                    self.command_hold(holding=True)
                    attempt.undisturbed &= not faults.open
                case "release":
                    self.cell.release()
                case "released":
                    self.command_hold(holding=False)
                case ProgramPrimitive(name=name, does=does):
                    self.publisher.publish("primitive", self.now, name=name, does=does)
                case InjectedFault() as fault:
                    faults.inject(fault, self.now, attempt)
        if attempt is not None:
            self.collector.expose(self.now, self._moment)
        if (failure := self.cell.trouble() or streams.failure(self.now)) is not None:
            raise failure
        return self.collector.take_notice(arrived, self.now)

    def stop(self, reason: str, *, protective: bool = False) -> None:
        """Bring the arm to rest along its path, looking on; protective: as fast as it may, whatever cameras do."""
        self.cancel(str, ProgramPrimitive)
        self.now = self.collector.streams.present(self.now)
        self.last_stop = StopTimes(self.now)
        self.publisher.publish("stopping", self.now, reason=reason)
        stands = self.motion.stop(self.now, protective=protective)
        if protective:
            self.advance(max(self.now, stands))
        while self.now < stands - 1e-9:
            self.pass_time(stands)
        self.last_stop = StopTimes(self.last_stop.told, self.now)
