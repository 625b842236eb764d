"""Judges the formulas of a step while evidence arrives in three values; finds formulas that the plan contradicts.

And one attempt at a step: its motion and progress, and whether cameras see it as predicted.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import field, replace
from pathlib import Path
from typing import Literal as OneOf

from sqrp_cli.errors import Place
from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula import Formula, Predicate
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.truth import Monitor, Trace, Truth, evaluate
from sqrp_cli.program.record import Program, ProgramFormula, ProgramResponse, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.perception.detections import Detection, Evidence, MissReason
from sqrp_cli.run.record.report import Confusion, Disagreement
from sqrp_cli.run.robot_body import RobotBody

PATIENCE = 0.3
"""How long predicted evidence may be missing before the robot stops [s]; at least three images."""
_SAME = 1e-9


def read_formula(text: str) -> Formula:
    """A formula of a program; its predicates have all their arguments."""

    def grounded(formula: Formula) -> Formula:
        if isinstance(formula, Predicate):
            return Predicate(formula.name, formula.arguments or ())
        return replace(formula, parts=tuple(grounded(part) for part in formula.parts))

    return grounded(parse_formula(text, Place(Path("program"))))


def contradictions(program: Program, robot: RobotBody) -> Iterator[str]:
    """Formulas that the plan contradicts, in words: monitors cannot judge them."""
    for number, step in enumerate(program.steps, 1):
        for text in against_the_plan(NominalStep(step, program.joints, robot)):
            yield f"step {number} (`{step.short_task}`): {text}"


def against_the_plan(nominal: NominalStep) -> Iterator[str]:
    """The formulas of a step that fail as planned, and the faults that are seen as planned, in words.

    Of the atoms that operators require at a time, only those count that stay constant to the end of the interval. One
    that changes within an interval is only late: a lifted object leaves its place after a while.
    """
    total = nominal.step.time
    for entry in nominal.step.formulas:
        formula, samples = read_formula(entry.formula), list[tuple[float, dict[Atom, Truth]]]()
        operators = ground_operators(formula, {}, total)
        for t in nominal.times:
            ends: dict[Atom, float] = {}
            for one in (one for one in operators if one.start <= t <= one.end):
                for literal in one.literals:
                    ends[literal.atom] = max(ends.get(literal.atom, 0.0), one.end)
            values = {atom: nominal.holds(str(atom), t) for atom in ends}
            stay = [atom for atom, end in ends.items() if nominal.held_throughout(Literal(atom, values[atom]), t, end)]
            samples.append((t, {atom: Truth.TRUE if values[atom] else Truth.FALSE for atom in stay}))
        truth = evaluate(formula, Trace(tuple(samples), total, total)).at(0)
        if truth == (Truth.FALSE if entry.fault is None else Truth.TRUE):
            what = "fails" if entry.fault is None else f"is true, and so the fault `{entry.fault}` is seen,"
            yield f"`{entry.formula}` {what} though all goes as planned"


@dataclass(frozen=True)
class Alarm:
    """An event that needs a response."""

    kind: OneOf["fault", "violation", "blindness"]
    """A fault was seen, a formula is violated, or evidence that was predicted is missing."""
    name: str
    """Of the fault, or the formula or atom."""
    text: str
    response: ProgramResponse


STOP = ProgramResponse(action="stop")


class _FormulaMonitor:
    """One formula with its monitor."""

    def __init__(self, entry: ProgramFormula, total: float) -> None:
        self.entry, formula = entry, read_formula(entry.formula)
        self.operators, self.monitor = ground_operators(formula, {}, total), Monitor(formula, total)
        self.over = False
        self.violated: Alarm | None = None

    def active(self, t: float) -> Iterator[GroundOperator]:
        """The operators that apply at a time; evidence of other times does not matter to the formula."""
        return (one for one in self.operators if one.start - _SAME <= t <= one.end + _SAME)

    def fault_alarm(self) -> Alarm:
        """That the fault of the formula was seen, told once."""
        self.over, entry = True, self.entry
        return Alarm("fault", entry.fault or "", f"the fault `{entry.fault}` was seen: {entry.formula}", entry.response)


class StepMonitor:
    """Watches all formulas of one step; times are those of the step's own clock [s]."""

    def __init__(self, nominal: NominalStep, period: float) -> None:
        """period: time between images [s], of the slowest camera that matters."""
        step = nominal.step
        self._nominal, self._total, self._margin = nominal, step.time, period
        self._watches = [_FormulaMonitor(entry, step.time) for entry in step.formulas]
        self._patience = max(PATIENCE, 3 * period)
        self._contrary: dict[Literal, float] = {}
        self._missing: dict[str, float] = {}
        self.faults = [(one.entry.fault, one.operators) for one in self._watches if one.entry.fault is not None]
        """The name of each fault, with the operators of its formula."""

    def monitored(self, t: float) -> tuple[str, ...]:
        """The atoms that some formula requires at a time."""
        literals = (literal for watch in self._watches for one in watch.active(t) for literal in one.literals)
        return tuple(dict.fromkeys(str(literal.atom) for literal in literals))

    def observe(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """Judge new evidence: the value of each atom from time t on. Returns an alarm, if any.

        The evidence is complete, and later than all before: nothing that arrives afterwards changes it.

        A fault has priority over the violation of a plain requirement, and that over missing evidence. A violation
        waits while a fault may explain it: as long as the unseen part of the fault is predicted to be out of sight.
        """
        alarm, blindness = self._seen_wrong(t, values), None
        monitored = self.monitored(t)
        self._missing = {atom: since for atom, since in self._missing.items() if atom in monitored}
        for atom in monitored:  # has one that was predicted to be seen all the time not been seen for too long?
            predicted = self._nominal.is_covered(atom, t, self._margin)
            if values.get(atom, Truth.UNKNOWN) != Truth.UNKNOWN or not predicted:
                self._missing.pop(atom, None)
            elif t - self._missing.setdefault(atom, t) >= self._patience - _SAME:
                cameras = ", ".join(self._nominal.covering(atom, t))
                text = f"{atom} should be seen by {cameras}, but has not been for {self._patience:.2g} s"
                blindness = Alarm("blindness", atom, text, STOP)
                break
        return alarm or blindness

    def anticipate(self, evidence: Sequence[tuple[float, Mapping[str, Truth]]]) -> Alarm | None:
        """Judge incomplete evidence: of times after the complete ones, from the images that have arrived.

        evidence: all of it, with the value of each atom from its time on. None of it is kept, as images under way may
        change it; but a seen fault counts at once, and each alarm is raised only once. Missing evidence may be under
        way, so it counts only when the rest has arrived.
        """
        ahead = copy(self)
        ahead._watches, ahead._contrary = [copy(watch) for watch in self._watches], dict(self._contrary)
        for watch in ahead._watches:  # takes more evidence without the others learning of it
            watch.monitor = copy(watch.monitor)
        for t, values in evidence:
            if (alarm := ahead._seen_wrong(t, values)) is not None:
                for watch, other in zip(self._watches, ahead._watches, strict=True):
                    watch.over = other.over
                return alarm
        return None

    def at_rest(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """Compare evidence with the expected state while the robot stands: at the start or the end.

        Returns a fault that happened unseen, else a deviation; missing evidence counts only if it was predicted.
        """
        for watch in self._watches:
            if watch.entry.fault is not None and not watch.over and self._seen_late(watch, t, values):
                return watch.fault_alarm()
        for atom in self.monitored(t):
            value, expected = values.get(atom, Truth.UNKNOWN), self._nominal.holds(atom, t)
            if value == (Truth.FALSE if expected else Truth.TRUE):
                wrong, right = (atom, f"not {atom}") if value == Truth.TRUE else (f"not {atom}", atom)
                return Alarm("violation", atom, f"the cameras see `{wrong}`, expected `{right}`", STOP)
            if value == Truth.UNKNOWN and self._nominal.is_covered(atom, t):
                cameras = ", ".join(self._nominal.covering(atom, t))
                return Alarm("blindness", atom, f"`{atom}` should be seen by {cameras}, but is not", STOP)
        return None

    def _seen_wrong(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """A fault that is seen, else a violation."""
        found: list[Alarm] = []
        for watch in self._watches:
            if watch.over or t > self._total + _SAME:
                continue
            entry, known = (
                watch.entry,
                {Atom.of(name): value for name, value in values.items()} if any(watch.active(t)) else {},
            )
            if entry.fault is not None:
                if watch.monitor.observe(t, known) == Truth.TRUE or self._seen_late(watch, t, values):
                    found.append(watch.fault_alarm())
                continue
            # What contradicts a formula may be a change that is a little late: it counts once it has lasted for the
            # time to settle, and the nominal motion has had its change for as long.
            required = [literal for one in watch.active(t) if one.operator == "always" for literal in one.literals]
            for literal in required:
                value = _value(literal, values)
                if value == Truth.TRUE:
                    self._contrary.pop(literal, None)
                elif value == Truth.FALSE:
                    late = t - self._contrary.setdefault(literal, t) < entry.settle
                    if late or not self._nominal.held_throughout(literal, t - entry.settle, t):
                        known[literal.atom] = Truth.UNKNOWN
            if watch.violated is None and watch.monitor.observe(t, known) == Truth.FALSE:
                wrong = [one for one in required if _value(one, values) == Truth.FALSE]
                what = " and ".join(f"`{literal.negated()}`" for literal in wrong) or "something else"
                text = f"the cameras see {what} against `{entry.formula}`"
                watch.violated = Alarm("violation", entry.formula, text, entry.response)
            if watch.violated is not None and not self._may_be_fault(t, values):
                watch.over = True
                found.append(watch.violated)
        return min(found, key=lambda one: one.kind != "fault", default=None)

    def _may_be_fault(self, t: float, values: Mapping[str, Truth]) -> bool:
        """Whether a part of a fault is seen, and the rest is neither refuted nor predicted to be visible."""
        for watch in self._watches:
            for operator in watch.operators if watch.entry.fault is not None and not watch.over else ():
                unseen = [literal for literal in operator.literals if _value(literal, values) == Truth.UNKNOWN]
                refuted = any(_value(literal, values) == Truth.FALSE for literal in operator.literals)
                begun = t >= operator.start and len(unseen) < len(operator.literals)
                predicted = (self._nominal.is_covered(str(literal.atom), t, self._margin) for literal in unseen)
                if begun and not refuted and not any(predicted):
                    return True
        return False

    def _seen_late(self, watch: _FormulaMonitor, t: float, values: Mapping[str, Truth]) -> bool:
        """Whether what a fault leaves behind is seen after its interval, and would not be if all had gone well."""
        for operator in watch.operators:
            if operator.operator == "eventually" and t >= operator.end and operator.literals:
                seen = all(_value(literal, values) == Truth.TRUE for literal in operator.literals)
                around = (t - watch.entry.settle, t + watch.entry.settle)
                if seen and any(self._nominal.held_throughout(one.negated(), *around) for one in operator.literals):
                    return True
        return False


def _value(literal: Literal, values: Mapping[str, Truth]) -> Truth:
    value = values.get(str(literal.atom), Truth.UNKNOWN)
    return value if literal.positive else ~value


class PredictionCheck:
    """Counts for one step, image by image, whether cameras see what the program predicted.

    An atom counts as detected if the image alone gives its true value.
    """

    def __init__(self, index: int, nominal: NominalStep, cameras: Collection[str]) -> None:
        """index: of the step. cameras: names of all."""
        self._index, self._nominal = index, nominal
        self.counts, self.usual = (
            {atom: {name: Confusion() for name in cameras} for atom in nominal.step.targets} for _ in range(2)
        )
        """By atom and camera, of all images and of those that were not predicted to show the atom."""
        self.disagreements: list[Disagreement] = []

    def add(self, detection: Detection, t: float, atoms: Collection[str], truths: Mapping[str, bool]) -> None:
        """Count an image taken at time t [s] of the step, for the atoms that count then, with their true values."""
        for atom in atoms:
            predicted = detection.camera in self._nominal.covering(atom, t)
            target = self._nominal.step.targets[atom]
            spans = (target.usual if truths[atom] or not target.refuted else target.refuted).get(detection.camera, ())
            usual = not predicted and any(start <= t <= end for start, end in spans)
            seen, boxes = detection.truth(atom), detection.boxes.get(atom, ())
            detected = seen == (Truth.TRUE if truths[atom] else Truth.FALSE)
            self.counts[atom][detection.camera].add(predicted, detected)
            if not predicted:
                self.usual[atom][detection.camera].add(usual, detected)
            if predicted != detected:
                blind = [box for box in boxes if box.evidence is Truth.UNKNOWN]
                because = min(blind, key=lambda box: box.share).because if blind else MissReason.DETECTOR
                self.disagreements.append(
                    Disagreement(
                        step=self._index,
                        t=round(t, 6),
                        atom=atom,
                        camera=detection.camera,
                        predicted=predicted,
                        seen=seen.word,
                        true=truths[atom],
                        share=round(min((box.share for box in boxes), default=0.0), 3),
                        because=because.value if predicted else "",
                        usual=usual,
                    )
                )


def predicted_delay(step: Step, atoms: Collection[str], responses: Mapping[str, float], x: float) -> float | None:
    """Time from a fault at time x [s] of a step until it is seen; None if it never is.

    atoms: that decide the fault; responses: of each camera [s]. First all atoms must be covered at once, then comes one
    frame period and the latency of the k-th fastest camera of the slowest atom.
    """
    edges = sorted({x, *(start for atom in atoms for s in step.targets[atom].seen.values() for start, _ in s)})
    for t in (edge for edge in edges if edge >= x):
        slowest = 0.0
        for target in (step.targets[atom] for atom in atoms):
            covering = [name for name, spans in target.seen.items() if any(a <= t <= b for a, b in spans)]
            if len(covering) < target.cameras:
                break
            slowest = max(slowest, sorted(responses[name] for name in covering)[target.cameras - 1])
        else:
            return t - x + slowest
    return None


@dataclass(eq=False)
class Attempt:
    """One attempt at a step."""

    step: Step
    nominal: NominalStep
    monitor: StepMonitor
    check: PredictionCheck
    undisturbed: bool
    """Whether all goes as the program planned, so that its images count in the check of predictions."""
    start: float | None = None
    """When its motion began on the cell's clock [s], None before it."""
    failed: bool = False
    """Whether a fault was seen, so that objects are believed to be where they were before."""
    last_shown: dict[str, float] = field(default_factory=dict)
    """When the last image was taken that showed an atom's value [s]."""

    @property
    def end(self) -> float:
        """When its motion is over on the cell's clock [s]; infinite before it."""
        return float("inf") if self.start is None else self.start + self.step.time

    def beliefs(self, tau: float | None) -> Mapping[str, Array]:
        """Where objects are believed to be at a time of the step [s], (4, 4) each."""
        return self.nominal.object_poses(0.0 if self.failed else tau or 0.0)

    @property
    def unseen(self) -> Mapping[str, float | None]:
        """Atoms required at the end of the motion that no image showed from then on, with when one last did [s]."""
        required, last = self.monitor.monitored(self.step.time), self.last_shown
        return {atom: last.get(atom) for atom in required if last.get(atom, 0.0) < self.end - 1e-9}

    def note(self, evidence: Evidence) -> None:
        """Remember what complete evidence showed."""
        self.last_shown.update({atom: evidence.t for atom, value in evidence.values.items() if value != Truth.UNKNOWN})

    def alarms(self, arrived: Iterable[Evidence]) -> Iterator[Alarm]:
        """What calls for a response in the motion, first by what is known completely, then by what is there of more.

        arrived: in order of time, complete evidence first.
        """
        ahead = []
        for evidence in arrived:
            tau = evidence.tau
            if tau is None or not 0.0 <= tau <= self.step.time or evidence.t > self.end + 1e-9:
                continue
            if not evidence.complete:
                ahead.append((tau, evidence.values))
                continue
            self.note(evidence)
            if (alarm := self.monitor.observe(tau, evidence.values)) is not None:
                yield alarm
        while ahead and (alarm := self.monitor.anticipate(ahead)) is not None:
            yield alarm
