"""Runs a program in a cell: moves, looks, judges, and responds to faults."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.workspace import Workspace, World
from sqrp_cli.logic.literal import Literal
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program import Program, ProgramResponse, Replanner, Step
from sqrp_cli.runtime.evidence import Finding, fuse
from sqrp_cli.runtime.expectation import Expectation, Situation, holds, values_when_open
from sqrp_cli.runtime.eyes import Eyes
from sqrp_cli.runtime.faults import InjectedFault
from sqrp_cli.runtime.judge import PATIENCE, Alarm, Judge, condition_value, read_formula
from sqrp_cli.runtime.outcome import Event, FaultRecord, Listener, RunReport, StepRecord
from sqrp_cli.runtime.perception.pool import PerceptionError, PerceptionPool
from sqrp_cli.runtime.perception.sighting import Posture, Sighting, Watchlist
from sqrp_cli.runtime.playback import Playback
from sqrp_cli.runtime.prediction_check import PredictionCheck, predicted_delay, word
from sqrp_cli.runtime.recording import Gallery
from sqrp_cli.runtime.simulation.cell import SimulatedCell
from sqrp_cli.runtime.twin import OPEN_SHARE, Twin

LOOK_AGAIN = 2.0
"""How long the robot waits for the condition of a retry to be seen [s]."""

TRUTH_SPACING = 0.01
"""Time between two looks at what really is so, once a fault was injected [s]."""


class Stopped(Exception):  # noqa: N818
    """The run cannot go on; the message is the reason."""


@dataclass
class _Action:
    """Something to do at a time of the step."""

    t: float
    do: str
    fault: InjectedFault | None = None


@dataclass(eq=False)
class _Attempt:
    """One attempt at a step.

    start: of its motion on the cell's clock [s], None before it. undisturbed: whether it is what the program planned.
    """

    step: Step
    expectation: Expectation
    judge: Judge
    check: PredictionCheck
    start: float | None = None
    actions: list[_Action] = field(default_factory=list)
    undisturbed: bool = False


class Execution:
    """One run of a program."""

    def __init__(
        self,
        program: Program,
        workspace: Workspace,
        twin: Twin,
        cell: SimulatedCell,
        pool: PerceptionPool,
        replanner: Replanner,
        faults: Sequence[InjectedFault] = (),
        listeners: Sequence[Listener] = (),
        gallery: Gallery | None = None,
    ) -> None:
        """gallery: takes every image with what was seen in it, if images are to be kept."""
        self._program, self._workspace, self._twin = program, workspace, twin
        self._cell, self._pool, self._replanner = cell, pool, replanner
        self._faults, self._listeners, self._gallery = list(faults), tuple(listeners), gallery
        self._eyes = Eyes(workspace.cameras.values(), pool)
        q = [program.steps[0].before.joints[name] for name in program.joints]
        limits = [workspace.robot.limits[name] for name in program.joints]
        self._playback = Playback(program.joints, limits, np.array(q))
        self._report = RunReport()
        self._latest: dict[str, Sighting] = {}
        self._truths: dict[float, tuple[float | None, dict[str, bool]]] = {}
        self._places: dict[str, list[tuple[float, Array]]] = {}
        self._findings: dict[str, Finding] = {}
        self._starts: Mapping[str, Array] = {}
        self._now = 0.0
        self._doing = "looks"
        self._found_at = -1.0
        self._holding = False
        self._open_fault: FaultRecord | None = None
        self._wall: dict[str, float] = {}

    def run(self) -> RunReport:
        """Run all steps; returns how it went."""
        began = time.perf_counter()
        try:
            for index, step in enumerate(self._program.steps):
                self._run_step(index, step)
        except Stopped as stopped:
            self._halt(str(stopped))
        report = self._report
        report.time = round(self._now, 6)
        report.tracking = self._cell.tracking_error()
        report.images = self._eyes.images
        self._say("done" if report.outcome == "done" else "stopped", reason=report.reason)
        self._wall["all"] = time.perf_counter() - began
        report.wall = {**self._wall, "perception (in parallel)": self._eyes.seconds}
        return report

    # Steps and retries

    def _run_step(self, index: int, step: Step) -> None:
        record = StepRecord(step.skill, step.parameters, step.short_task, self._now)
        self._report.steps.append(record)
        self._holding = step.before.held is not None
        tries = 0
        while True:
            alarm = self._attempt(index, step, first=tries == 0)
            if alarm is None:
                break
            if alarm.kind == "fault":
                self._note_detection(alarm)
            elif alarm.kind == "violation" and self._open_fault is not None:
                self._open_fault.detected = self._now
            response = alarm.response
            if response.action != "retry" or tries >= response.retries:
                more = f" after {tries} {'retry' if tries == 1 else 'retries'}" if tries else ""
                raise Stopped(f"{alarm.text}{more}")
            self._stop_motion(alarm.text)
            tries += 1
            record.attempts += 1
            step = self._replanned(step, response)
            if self._open_fault is not None:
                self._open_fault.acted = self._now
            self._say("retry", attempt=tries, of=response.retries, step=step.skill, time=round(step.time, 6))
        record.end = round(self._now, 6)
        if self._open_fault is not None:
            self._open_fault.recovered = self._now
            self._open_fault = None

    def _attempt(self, index: int, step: Step, *, first: bool) -> Alarm | None:
        """Try a step once. Returns the alarm that needs a response, None if the step is done."""
        expectation = Expectation(step, self._program.joints, self._twin)
        period = max(1.0 / camera.rate for camera in self._workspace.cameras.values())
        check = PredictionCheck(index, expectation, list(self._workspace.cameras))
        attempt = _Attempt(step, expectation, Judge(expectation, period), check, undisturbed=first)
        starts = {name: np.array(rows) for name, rows in step.before.objects.items()}
        self._pool.watch(Watchlist(dict(step.targets), starts, values_when_open(step)))
        self._starts = starts
        self._findings, self._found_at = {}, self._now
        self._latest.clear()
        self._say(
            "step", number=index + 1, skill=step.skill, parameters=dict(step.parameters), time=round(step.time, 6)
        )
        try:
            wrong = self._look(attempt, 0.0)
            if wrong is not None:
                raise Stopped(f"wrong start: {wrong.text}")
            return self._move(attempt, first=first)
        finally:
            if first:
                self._report.prediction.append(check.counts)
                self._report.disagreements.extend(check.disagreements)

    def _move(self, attempt: _Attempt, *, first: bool) -> Alarm | None:
        step, judge = attempt.step, attempt.judge
        attempt.start = self._now
        attempt.actions = self._actions(step, first=first)
        self._playback.play(step.primitives, attempt.start)
        end = attempt.start + step.time
        while self._now < end - 1e-9 or self._eyes.next_arrival <= end + self._slowest():
            for sighting_time in self._pass(attempt, end):
                tau = self._playback.step_time(sighting_time)
                alarm = judge.observe(tau, self._values()) if 0.0 <= tau <= step.time else None
                if alarm is not None and alarm.response.action != "continue":
                    return alarm
                if alarm is not None:
                    self._note_detection(alarm)
            if self._now >= end - 1e-9 and not self._eyes.has_arrival_from(end):
                break
        self._playback.stand()
        self._found_at = self._now
        self._findings = {}
        return self._look(attempt, step.time)

    def _look(self, attempt: _Attempt, tau: float) -> Alarm | None:
        """Stand and look until the images agree with what should be so at a time of the step, or for long enough."""
        until = self._now + max(PATIENCE, 3 * max(1.0 / c.rate for c in self._workspace.cameras.values()))
        until += self._slowest()
        alarm: Alarm | None = None
        looked = False
        while not looked or (alarm is not None and self._now < until - 1e-9):
            for _ in self._pass(attempt, float("inf")):
                alarm = attempt.judge.at_rest(tau, self._values())
                looked = True
        return alarm

    # Passing time

    def _pass(self, attempt: _Attempt | None, end: float) -> Iterator[float]:
        """Let time pass until the next event; yields the time of exposure of images that arrived [s].

        Raises Stopped where the cameras or the processes behind them fail.
        """
        actions = attempt.actions if attempt is not None else []
        start = attempt.start if attempt is not None else None
        t = min(self._eyes.next_exposure, self._eyes.next_arrival, self._eyes.next_check)
        if actions and start is not None:
            t = min(t, start + actions[0].t)
        if self._now < end - 1e-9:
            t = min(t, end)
        if self._watching_truth:
            t = min(t, self._now + TRUTH_SPACING)
        t = max(t, self._now)
        with self._timed("physics"):
            self._cell.advance(t, self._playback)
        self._now = t
        if self._watching_truth:
            self._look_for_fault(attempt)
        arrived: list[Sighting] = []
        if self._eyes.next_arrival <= t + 1e-9:
            with self._timed("waiting for perception"):
                try:
                    arrived = self._eyes.collect(t)
                except PerceptionError as error:
                    raise Stopped(str(error)) from error
        while actions and start is not None and start + actions[0].t <= t + 1e-9:
            self._act(actions.pop(0), attempt)
        if self._eyes.next_exposure <= t + 1e-9:
            self._expose(attempt)
        if (failure := self._eyes.failure(t)) is not None:
            raise Stopped(failure)
        if arrived:
            yield from self._take_notice(arrived, attempt)

    def _expose(self, attempt: _Attempt | None) -> None:
        posture = Posture(dict(self._cell.measured_joints()), self._holding, self._beliefs(attempt))
        t = self._now
        try:
            with self._timed("images"):
                frames = self._eyes.expose(t, self._cell.frames, posture)
        except PerceptionError as error:
            raise Stopped(str(error)) from error
        if frames:
            self._truths[round(frames[0].t, 9)] = (self._time_of_step(attempt), self._true_atoms(attempt))
        if self._gallery is not None:
            planned = attempt is not None and attempt.undisturbed
            for frame in frames:
                self._gallery.add(
                    frame, len(self._report.steps), self._time_of_step(attempt) if planned else None, self._doing
                )

    def _take_notice(self, arrived: Sequence[Sighting], attempt: _Attempt | None) -> Iterator[float]:
        for sighting in arrived:
            if sighting.frozen:
                raise Stopped(f"{sighting.camera} is frozen: it delivers the same image again")
        for t in sorted({sighting.t for sighting in arrived}):
            together = [sighting for sighting in arrived if sighting.t == t]
            tau, truths = self._truths.get(round(t, 9), (None, {}))
            for sighting in together:
                self._latest[sighting.camera] = sighting
                if self._gallery is not None:
                    self._gallery.seen(sighting)
                for name, place in sighting.places.items():
                    self._places.setdefault(name, []).append((t, place))
                if attempt is not None and attempt.undisturbed and tau is not None and 0.0 <= tau <= attempt.step.time:
                    attempt.check.add(sighting, tau, attempt.judge.monitored(tau), truths)
            if attempt is None or t < self._found_at - 1e-9:
                continue
            fresh = [s for s in self._latest.values() if t - s.t < 1.5 / self._workspace.cameras[s.camera].rate]
            self._findings = {atom: fuse(atom, target, fresh) for atom, target in attempt.step.targets.items()}
            self._report.conflicts += sum(finding.conflict for finding in self._findings.values())
            self._say_evidence(t, tau, attempt, truths)
            yield t

    # What is known

    def _values(self) -> dict[str, Truth]:
        return {atom: finding.truth for atom, finding in self._findings.items()}

    def _time_of_step(self, attempt: _Attempt | None) -> float | None:
        if attempt is None or attempt.start is None:
            return None
        return self._playback.step_time(self._now)

    def _beliefs(self, attempt: _Attempt | None) -> Mapping[str, Array]:
        if attempt is None:
            return self._starts
        return attempt.expectation.object_poses(self._time_of_step(attempt) or 0.0)

    def _true_atoms(self, attempt: _Attempt | None) -> dict[str, bool]:
        if attempt is None:
            return {}
        truth = self._cell.truth()
        is_open = self._twin.closure(truth.joints) <= OPEN_SHARE
        situation = Situation(self._twin.link_poses(truth.joints), truth.X_WO, self._starts, truth.held, is_open)
        when_open = values_when_open(attempt.step)
        return {
            atom: holds(atom, target, situation, when_open=when_open[atom])
            for atom, target in attempt.step.targets.items()
        }

    def _slowest(self) -> float:
        return max(camera.latency for camera in self._workspace.cameras.values())

    # Faults

    def _actions(self, step: Step, *, first: bool) -> list[_Action]:
        actions = []
        for primitive in step.primitives:
            if primitive.action == "Grasp":
                actions.append(_Action(primitive.start, "grasp"))
            elif primitive.action == "Release":
                opens = primitive.start if self._twin.fingers is not None else primitive.end
                actions += [_Action(opens, "release"), _Action(primitive.end, "let go")]
            actions.append(_Action(primitive.start, primitive.name))
        if first:
            actions.extend(_Action(fault.t if fault.t is not None else 0.0, "fault", fault) for fault in self._faults)
            self._faults = []
        return sorted(actions, key=lambda action: action.t)

    def _act(self, action: _Action, attempt: _Attempt | None) -> None:
        if action.do == "grasp":
            self._cell.grasp()
            self._holding = True
            if self._open_fault is not None and attempt is not None:
                attempt.undisturbed = False
        elif action.do == "release":
            self._cell.release()
        elif action.do == "let go":
            self._holding = False
        elif action.do == "fault" and action.fault is not None:
            self._inject(action.fault, attempt)
        else:
            self._doing = action.do
            self._say("primitive", name=action.do)

    def _inject(self, fault: InjectedFault, attempt: _Attempt | None) -> None:
        camera = fault.camera or ""
        match fault.kind:
            case "slip":
                self._cell.slip()
            case "miss-pick":
                self._cell.miss_next_grasp()
            case "camera-loss":
                self._eyes.lose(camera)
            case "frozen":
                self._eyes.freeze(camera)
            case "latency":
                self._eyes.delay(camera, fault.delay)
            case "perception-crash":
                self._pool.crash(camera)
        record = FaultRecord(self._fault_name(fault, attempt), injected=self._now)
        if fault.kind in ("slip", "miss-pick") and attempt is not None:
            attempt.undisturbed = fault.kind == "miss-pick"  # until the grasp
            self._open_fault = record
        self._report.faults.append(record)
        self._say("injected", fault=fault.text)

    def _fault_name(self, fault: InjectedFault, attempt: _Attempt | None) -> str:
        """The skill's own name for what was injected, if it has one."""
        names = [entry.fault for entry in attempt.step.formulas if entry.fault] if attempt is not None else []
        physical = fault.kind in ("slip", "miss-pick")
        return names[0] if physical and len(names) == 1 and names[0] is not None else fault.kind

    @property
    def _watching_truth(self) -> bool:
        return self._open_fault is not None and self._open_fault.happened is None

    def _look_for_fault(self, attempt: _Attempt | None) -> None:
        """Note when the fault's formula becomes true in the cell."""
        record = self._open_fault
        tau = self._time_of_step(attempt)
        if record is None or attempt is None or tau is None:
            return
        truths = self._true_atoms(attempt)
        for watch in attempt.judge.faults():
            for start, end, literals in watch:
                if start <= tau <= end and all(truths[str(lit.atom)] == lit.positive for lit in literals):
                    record.happened = self._now
                    responses = {name: camera.response for name, camera in self._workspace.cameras.items()}
                    record.predicted_delay = predicted_delay(attempt.step, _atoms(literals), responses, tau)
                    self._say("happened", fault=record.name)
                    return

    def _note_detection(self, alarm: Alarm) -> None:
        record = self._open_fault
        if record is None or record.detected is not None:
            record = FaultRecord(alarm.name)
            self._report.faults.append(record)
            self._open_fault = record
        record.name = alarm.name
        record.detected = self._now
        self._say("fault", name=alarm.name, text=alarm.text, response=alarm.response.action)

    # Responses

    def _stop_motion(self, reason: str) -> None:
        """Bring the arm to rest along its path."""
        self._say("stopping", reason=reason)
        self._doing = "stops"
        self._report.stop_told = self._now
        stands = self._playback.stop(self._now)
        while self._now < stands - 1e-9:
            for _ in self._pass(None, stands):
                pass
        self._playback.stand()
        self._report.stop_done = self._now

    def _halt(self, reason: str) -> None:
        """Stop for good, whatever perception does."""
        t = self._now
        if self._open_fault is not None and self._open_fault.acted is None and self._open_fault.detected is not None:
            self._open_fault.acted = t
        for record in self._report.faults:
            if record.name in ("camera-loss", "frozen", "latency", "perception-crash") and record.detected is None:
                record.detected = record.acted = t
        self._report.outcome, self._report.reason = "stopped", reason
        self._report.stop_told = t
        self._say("stopping", reason=reason)
        self._now = self._playback.stop(t)
        self._cell.advance(self._now, self._playback)
        self._playback.stand()
        self._report.stop_done = self._now

    def _replanned(self, step: Step, response: ProgramResponse) -> Step:
        """The step again, from where the arm is, once the condition is seen and the objects are found."""
        self._cell.release()
        self._holding = False
        if self._twin.fingers is not None:
            self._playback.place(self._twin.fingers.open)
        expectation = Expectation(step, self._program.joints, self._twin)
        attempt = _Attempt(step, expectation, Judge(expectation, 1.0), PredictionCheck(0, expectation, ()))
        self._found_at, self._findings = self._now, {}
        self._places.clear()
        until = self._now + LOOK_AGAIN
        while response.when is not None and condition_value(response.when, self._values()) != Truth.TRUE:
            if self._now >= until:
                raise Stopped(f"`{response.when}` was not seen within {LOOK_AGAIN:g} s, so there is no retry")
            for _ in self._pass(attempt, until):
                pass
        world = self._world_seen(step)
        planned = self._replanner.replan(step, world)
        if planned is None:
            raise Stopped(f"{step.skill} cannot be tried again: no feasible motion from here")
        return planned

    def _world_seen(self, step: Step) -> World:
        """The world as the images show it: objects where they were located, facts by evidence."""
        before = step.before.world
        X_WO = dict(before.X_WO)
        for name, places in self._places.items():
            X = X_WO[name].copy()
            X[:3, 3] = np.median([place for _, place in places], axis=0)
            X_WO[name] = X
        facts = set(before.facts)
        for literal, value in ((read_formula(atom), v) for atom, v in self._values().items()):
            atom = literal.atom  # type: ignore[union-attr]
            if value == Truth.TRUE:
                facts.add(atom)
            elif value == Truth.FALSE:
                facts.discard(atom)
        measured = self._cell.measured_joints()
        joints = {name: measured.get(name, value) for name, value in before.joints.items()}
        return replace(before, facts=frozenset(facts), X_WO=X_WO, joints=joints)

    # Telling

    def _say(self, kind: str, **fields: object) -> None:
        event = Event(round(self._now, 6), kind, fields)
        for listener in self._listeners:
            listener(event)

    def _say_evidence(self, t: float, tau: float | None, attempt: _Attempt, truths: Mapping[str, bool]) -> None:
        asked = attempt.judge.monitored(max(tau or 0.0, 0.0))
        literals = {
            atom: {
                "value": word(finding.truth),
                "true": truths.get(atom),
                "predicted": tau is not None and attempt.expectation.is_covered(atom, tau),
                "asked": atom in asked,
                "cameras": {camera: word(vote) for camera, vote in sorted(finding.votes.items())},
            }
            for atom, finding in self._findings.items()
        }
        fields = {"exposed": round(t, 6), "step_time": None if tau is None else round(tau, 6), "literals": literals}
        self._say("evidence", **fields)

    @contextmanager
    def _timed(self, what: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self._wall[what] = self._wall.get(what, 0.0) + time.perf_counter() - began


def _atoms(literals: Sequence[Literal]) -> list[str]:
    return [str(literal.atom) for literal in literals]
