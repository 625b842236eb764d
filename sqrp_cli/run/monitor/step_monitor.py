"""One attempt at a step: it judges the formulas of the step while evidence arrives in three values.

And whether cameras see it as predicted, and formulas that the plan itself contradicts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Literal as OneOf

from sqrp_cli.errors import Place
from sqrp_cli.geometry import Array
from sqrp_cli.logic.domain import nested
from sqrp_cli.logic.formula import Formula, Operation, Predicate
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.truth import Monitor, Truth, evaluate
from sqrp_cli.program.record import ProgramFormula, ProgramResponse, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.perception.detections import Detection, Evidence
from sqrp_cli.run.record.report import Confusion, Disagreement

PATIENCE = 0.3  # How long predicted evidence may be missing before the robot stops [s]; at least three images
_SAME = 1e-9


def read_formula(text: str | Formula) -> Formula:
    """A formula of a program, or a part of one; its predicates have all their arguments."""
    formula = parse_formula(text, Place(Path("program"))) if isinstance(text, str) else text
    if isinstance(formula, Predicate):
        return Predicate(formula.name, formula.arguments or ())
    return replace(formula, parts=tuple(read_formula(part) for part in formula.parts))


def against_the_plan(nominal: NominalStep) -> Iterator[str]:
    """What no monitor can judge, in words: formulas of a step that fail as planned, faults that are seen as planned.

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
            stay = [atom for atom, end in ends.items() if nominal.holds(str(atom), t, end, value=values[atom])]
            samples.append((t, {atom: Truth.TRUE if values[atom] else Truth.FALSE for atom in stay}))
        truth = evaluate(formula, samples, total, total).at(0)
        if truth == (Truth.FALSE if entry.fault is None else Truth.TRUE):
            what = "fails" if entry.fault is None else f"is true, and so the fault `{entry.fault}` is seen,"
            yield f"`{entry.formula}` {what} though all goes as planned"


@dataclass(frozen=True)
class Alarm:
    """An event that needs a response."""

    kind: OneOf["fault", "violation", "blindness"]
    """A fault was seen, a formula is violated, or evidence that was predicted is missing."""
    name: str  # Of the fault, or the formula or atom
    text: str
    response: ProgramResponse


STOP = ProgramResponse(action="stop")


@dataclass(eq=False)
class _Watch:
    """A formula that is monitored."""

    entry: ProgramFormula
    operators: tuple[GroundOperator, ...]
    monitor: Monitor
    alarm: Alarm | None  # What is raised once the fault is seen; of a requirement, once it is violated
    over: bool = False  # Whether the alarm was raised


class Attempt:
    """One attempt at a step: watches all its formulas; times are those of the step's own clock [s], if not stated."""

    def __init__(
        self,
        nominal: NominalStep,
        period: float,
        check: PredictionCheck | None = None,
        *,
        undisturbed: bool = False,
        start: float | None = None,
    ) -> None:
        """period: time between images [s], of the slowest camera that matters. check: of the images of the attempt."""
        step = self.step = nominal.step
        self.nominal, self.check, self._margin, self._patience = nominal, check, period, max(PATIENCE, 3 * period)
        self.undisturbed = undisturbed
        """Whether all goes as the program planned, so that its images count in the check of predictions."""
        self.start = start
        """When its motion began on the cell's clock [s], None before it."""
        self.failed = False
        """Whether a fault was seen, so that objects are believed to be where they were before."""
        self.last_shown: dict[str, float] = {}
        """When the last image was taken that showed an atom's value, on the cell's clock [s]."""
        self.watches = []
        """The formulas."""
        for entry in step.formulas:
            formula, alarm = read_formula(entry.formula), None
            operators = tuple(ground_operators(formula, {}, step.time))
            literals = dict.fromkeys(literal for one in operators for literal in one.literals)
            if entry.fault is not None:
                either = any(
                    isinstance(one, Operation) and one.operator in ("or", "implies") for one in nested(formula)
                )
                text = f"images showed {entry.fault}{'' if either else f': {_all_of(step, literals)}'}"
                alarm = Alarm("fault", entry.fault, text, entry.response)
            self.watches.append(_Watch(entry, operators, Monitor(formula, step.time), alarm))
        self._contrary: dict[Literal, float] = {}
        self._missing: dict[str, float] = {}

    def monitored(self, t: float) -> tuple[str, ...]:
        """The atoms that some formula requires at a time."""
        operators = (one for watch in self.watches for one in watch.operators)
        active = (one for one in operators if one.start - _SAME <= t <= one.end + _SAME)
        return tuple(dict.fromkeys(str(literal.atom) for one in active for literal in one.literals))

    def beliefs(self, tau: float | None) -> Mapping[str, Array]:
        """Where objects are believed to be at a time of the step [s], (4, 4) each."""
        return self.nominal.object_poses(0.0 if self.failed else tau or 0.0)

    @property
    def unseen(self) -> Mapping[str, float | None]:
        """Atoms required at the end of the motion that no image showed from then on, with when one last did [s]."""
        end, last = (self.start or 0.0) + self.step.time, self.last_shown
        return {atom: last.get(atom) for atom in self.monitored(self.step.time) if last.get(atom, 0.0) < end - 1e-9}

    def note(self, evidence: Evidence) -> None:
        """Remember what complete evidence showed."""
        self.last_shown.update({atom: evidence.t for atom, value in evidence.values.items() if value != Truth.UNKNOWN})

    def alarms(self, arrived: Iterable[Evidence]) -> Iterator[Alarm]:
        """What calls for a response in the motion, first by what is known completely, then by what is there of more.

        arrived: in order of time, complete evidence first. None of the incomplete is kept, as images under way may
        change it; but a seen fault counts at once, and each alarm is raised only once. Missing evidence may be under
        way, so it counts only when the rest has arrived.
        """
        later, end = [], float("inf") if self.start is None else self.start + self.step.time
        for evidence in arrived:
            tau = evidence.tau
            if tau is None or not 0.0 <= tau <= self.step.time or evidence.t > end + 1e-9:
                continue
            if not evidence.complete:
                later.append((tau, evidence.values))
                continue
            self.note(evidence)
            if (alarm := self.observe(tau, evidence.values)) is not None:
                yield alarm
        while later:
            ahead = copy(self)  # which takes more evidence without this one learning of it
            ahead.watches = [replace(watch, monitor=copy(watch.monitor)) for watch in self.watches]
            ahead._contrary = dict(self._contrary)
            found = (alarm for t, values in later if (alarm := ahead._seen_wrong(t, values)) is not None)
            if (alarm := next(found, None)) is None:
                return
            for watch, other in zip(self.watches, ahead.watches, strict=True):
                watch.over = other.over
            yield alarm

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
            predicted = self.nominal.is_covered(atom, t, self._margin)
            if values.get(atom, Truth.UNKNOWN) != Truth.UNKNOWN or not predicted:
                self._missing.pop(atom, None)
            elif t - self._missing.setdefault(atom, t) >= self._patience - _SAME:
                cameras = ", ".join(self.nominal.covering(atom, t))
                told = f"whether {self.step.in_words(atom)} should be seen by {cameras}"
                text = f"{told}, but has not been for {self._patience:.2g} s"
                blindness = Alarm("blindness", atom, text, STOP)
                break
        return alarm or blindness

    def at_rest(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """Compare evidence with the expected state while the robot stands: at the start or the end.

        Returns a fault that happened unseen, else a deviation; missing evidence counts only if it was predicted.
        """
        for watch in self.watches:
            if watch.entry.fault is not None and not watch.over and self._seen_late(watch, t, values):
                watch.over = True
                return watch.alarm
        for atom in self.monitored(t):
            value, expected = values.get(atom, Truth.UNKNOWN), self.nominal.holds(atom, t)
            if value == (Truth.FALSE if expected else Truth.TRUE):
                wrong = Literal(Atom.of(atom), value == Truth.TRUE)
                text = f"images show that {_all_of(self.step, [wrong])}, which is not as planned"
                return Alarm("violation", atom, text, STOP)
            if value == Truth.UNKNOWN and self.nominal.is_covered(atom, t):
                cameras = ", ".join(self.nominal.covering(atom, t))
                text = f"whether {self.step.in_words(atom)} should be seen by {cameras}, but is not"
                return Alarm("blindness", atom, text, STOP)
        return None

    def _seen_wrong(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """A fault that is seen, else a violation."""
        found: list[Alarm] = []
        for watch in (watch for watch in self.watches if not watch.over and t <= self.step.time + _SAME):
            # Evidence of times at which no operator applies does not matter to the formula.
            entry, active = watch.entry, [one for one in watch.operators if one.start - _SAME <= t <= one.end + _SAME]
            known = {Atom.of(name): value for name, value in values.items()} if active else {}
            if entry.fault is not None:
                watch.over = watch.monitor.observe(t, known) == Truth.TRUE or self._seen_late(watch, t, values)
            else:
                # What contradicts a formula may be a change that is a little late: it counts once it has lasted for the
                # time to settle, and the nominal motion has had its change for as long.
                required = [literal for one in active if one.operator == "always" for literal in one.literals]
                for literal in required:
                    value, atom, since = _value(literal, values), str(literal.atom), t - entry.settle
                    if value == Truth.TRUE:
                        self._contrary.pop(literal, None)
                    elif value == Truth.FALSE:
                        late = t - self._contrary.setdefault(literal, t) < entry.settle
                        if late or not self.nominal.holds(atom, since, t, value=literal.positive):
                            known[literal.atom] = Truth.UNKNOWN
                if watch.alarm is None and watch.monitor.observe(t, known) == Truth.FALSE:
                    wrong = [one for one in required if _value(one, values) == Truth.FALSE]
                    what = f"that {_all_of(self.step, wrong)}, which" if wrong else "what"
                    text = f"images show {what} the skill rules out"
                    watch.alarm = Alarm("violation", entry.formula, text, entry.response)
                watch.over = watch.alarm is not None and not self._may_be_fault(t, values)
            if watch.over and watch.alarm is not None:
                found.append(watch.alarm)
        return min(found, key=lambda one: one.kind != "fault", default=None)

    def _may_be_fault(self, t: float, values: Mapping[str, Truth]) -> bool:
        """Whether a part of a fault is seen, and the rest is neither refuted nor predicted to be visible."""
        faults = (watch for watch in self.watches if watch.entry.fault is not None and not watch.over)
        for operator in (one for watch in faults for one in watch.operators):
            shown = {literal: _value(literal, values) for literal in operator.literals}
            unseen = [literal for literal, value in shown.items() if value == Truth.UNKNOWN]
            begun = t >= operator.start and len(unseen) < len(shown)
            predicted = (self.nominal.is_covered(str(literal.atom), t, self._margin) for literal in unseen)
            if begun and Truth.FALSE not in shown.values() and not any(predicted):
                return True
        return False

    def _seen_late(self, watch: _Watch, t: float, values: Mapping[str, Truth]) -> bool:
        """Whether what a fault leaves behind is seen after its interval, and would not be if all had gone well."""
        before, after = t - watch.entry.settle, t + watch.entry.settle
        for operator in watch.operators:
            if operator.operator == "eventually" and t >= operator.end and operator.literals:
                seen = all(_value(literal, values) == Truth.TRUE for literal in operator.literals)
                planned = ((str(one.atom), not one.positive) for one in operator.literals)
                if seen and any(self.nominal.holds(atom, before, after, value=other) for atom, other in planned):
                    return True
        return False


def _all_of(step: Step, literals: Iterable[Literal]) -> str:
    return " and ".join(step.in_words(str(literal)) for literal in literals)


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
                because = min(blind, key=lambda box: box.share).because if blind else "detector limit"
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
                        because=because if predicted else "",
                        usual=usual,
                    )
                )
