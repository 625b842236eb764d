"""Judges the formulas of a step while evidence arrives, in three values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Literal as OneOf

from sqrp_cli.logic.evaluation import Monitor
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramFormula, ProgramResponse
from sqrp_cli.runtime.monitor.nominal_step import NominalStep
from sqrp_cli.runtime.monitor.program_formulas import read_formula

PATIENCE = 0.3
"""How long predicted evidence may be missing before the robot stops [s]; at least three images."""

_SAME = 1e-9


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
        self.entry = entry
        self.formula = read_formula(entry.formula)
        self.operators = ground_operators(self.formula, {}, total)
        self.monitor = Monitor(self.formula, total)
        self.over = False
        self.violated: Alarm | None = None

    def copy(self) -> _FormulaMonitor:
        """One with the same evidence, which takes more without this one learning of it."""
        found = copy(self)
        found.monitor = self.monitor.copy()
        return found

    def applies(self, t: float) -> bool:
        """Whether any operator applies at a time; evidence of other times does not matter to it."""
        return any(operator.start - _SAME <= t <= operator.end + _SAME for operator in self.operators)


class StepMonitor:
    """Watches all formulas of one step; times are those of the step's own clock [s]."""

    def __init__(self, nominal: NominalStep, period: float) -> None:
        """period: time between images [s], of the slowest camera that matters."""
        step = nominal.step
        self._nominal, self._total = nominal, step.time
        self._watches = [_FormulaMonitor(entry, step.time) for entry in step.formulas]
        self._patience = max(PATIENCE, 3 * period)
        self._margin = period
        self._contrary: dict[Literal, float] = {}
        self._missing: dict[str, float] = {}

    def monitored(self, t: float) -> tuple[str, ...]:
        """The atoms that some formula requires at a time."""
        atoms = [
            str(literal.atom)
            for watch in self._watches
            for operator in watch.operators
            if operator.start - _SAME <= t <= operator.end + _SAME
            for literal in operator.literals
        ]
        return tuple(dict.fromkeys(atoms))

    def observe(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """Judge new evidence: the value of each atom from time t on. Returns an alarm, if any.

        The evidence is complete, and later than all before: nothing that arrives afterwards changes it.

        A fault has priority over the violation of a plain requirement, and that over missing evidence. A violation
        waits while a fault may explain it: as long as the unseen part of the fault is predicted to be out of sight.
        """
        alarm = self._seen_wrong(t, values)
        blindness = self._missing_evidence(t, values)
        return alarm or blindness

    def anticipate(self, evidence: Sequence[tuple[float, Mapping[str, Truth]]]) -> Alarm | None:
        """Judge incomplete evidence: of times after the complete ones, from the images that have arrived.

        evidence: all of it, with the value of each atom from its time on. None of it is kept, as images under way may
        change it; but a seen fault counts at once, and each alarm is raised only once. Missing evidence may be under
        way, so it counts only when the rest has arrived.
        """
        ahead = copy(self)
        ahead._watches = [watch.copy() for watch in self._watches]
        ahead._contrary = dict(self._contrary)
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
                watch.over = True
                return _fault_alarm(watch.entry)
        for atom in self.monitored(t):
            value, expected = values.get(atom, Truth.UNKNOWN), self._nominal.holds(atom, t)
            if value == (Truth.FALSE if expected else Truth.TRUE):
                wrong, right = (atom, f"not {atom}") if value == Truth.TRUE else (f"not {atom}", atom)
                return Alarm("violation", atom, f"the cameras see `{wrong}`, expected `{right}`", STOP)
            if value == Truth.UNKNOWN and self._nominal.is_covered(atom, t):
                cameras = ", ".join(self._nominal.covering(atom, t))
                return Alarm("blindness", atom, f"`{atom}` should be seen by {cameras}, but is not", STOP)
        return None

    def faults(self) -> list[tuple[str, list[tuple[float, float, tuple[Literal, ...]]]]]:
        """The name of each fault, with start, end and literals of each operator of its formula."""
        return [
            (watch.entry.fault, [(operator.start, operator.end, operator.literals) for operator in watch.operators])
            for watch in self._watches
            if watch.entry.fault is not None
        ]

    def _seen_wrong(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        alarms = [self._judge(watch, t, values) for watch in self._watches]
        found = [alarm for alarm in alarms if alarm is not None]
        return min(found, key=lambda alarm: alarm.kind != "fault", default=None)

    def _judge(self, watch: _FormulaMonitor, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        if watch.over or t > self._total + _SAME:
            return None
        entry = watch.entry
        if entry.fault is not None:
            known = {Atom.of(name): value for name, value in values.items()} if watch.applies(t) else {}
            seen = watch.monitor.observe(t, known).truth == Truth.TRUE or self._seen_late(watch, t, values)
            if not seen:
                return None
            watch.over = True
            return _fault_alarm(entry)
        settled = self._settled(watch, t, values)
        if watch.violated is None and watch.monitor.observe(t, settled).truth == Truth.FALSE:
            wrong = [one for one in _active(watch.operators, t) if _value(one, values) == Truth.FALSE]
            what = " and ".join(f"`{literal.negated()}`" for literal in wrong) or "something else"
            text = f"the cameras see {what} against `{entry.formula}`"
            watch.violated = Alarm("violation", entry.formula, text, entry.response)
        if watch.violated is None or self._may_be_fault(t, values):
            return None
        watch.over = True
        return watch.violated

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
                if seen and any(self._holds_nominally(literal.negated(), *around) for literal in operator.literals):
                    return True
        return False

    def _settled(self, watch: _FormulaMonitor, t: float, values: Mapping[str, Truth]) -> dict[Atom, Truth]:
        """The evidence, without what contradicts a formula but may be a change that is a little late.

        It counts once it has lasted for the time to settle, and the nominal motion has had its change for as long.
        """
        if not watch.applies(t):
            return {}
        known = {Atom.of(name): value for name, value in values.items()}
        for literal in _active(watch.operators, t):
            value = _value(literal, values)
            if value == Truth.TRUE:
                self._contrary.pop(literal, None)
            elif value == Truth.FALSE:
                since = self._contrary.setdefault(literal, t)
                settle = watch.entry.settle
                if t - since < settle or not self._holds_nominally(literal, t - settle, t):
                    known[literal.atom] = Truth.UNKNOWN
        return known

    def _holds_nominally(self, literal: Literal, start: float, end: float) -> bool:
        return self._nominal.held_throughout(str(literal.atom), literal.positive, start, end)

    def _missing_evidence(self, t: float, values: Mapping[str, Truth]) -> Alarm | None:
        """An alarm if an atom that was predicted to be seen all the time has not been seen for too long."""
        monitored = self.monitored(t)
        self._missing = {atom: since for atom, since in self._missing.items() if atom in monitored}
        for atom in monitored:
            predicted = self._nominal.is_covered(atom, t, self._margin)
            if values.get(atom, Truth.UNKNOWN) != Truth.UNKNOWN or not predicted:
                self._missing.pop(atom, None)
            elif t - self._missing.setdefault(atom, t) >= self._patience - _SAME:
                cameras = ", ".join(self._nominal.covering(atom, t))
                text = f"{atom} should be seen by {cameras}, but has not been for {self._patience:.2g} s"
                return Alarm("blindness", atom, text, STOP)
        return None


def _fault_alarm(entry: ProgramFormula) -> Alarm:
    return Alarm("fault", entry.fault or "", f"the fault `{entry.fault}` was seen: {entry.formula}", entry.response)


def _active(operators: tuple[GroundOperator, ...], t: float) -> list[Literal]:
    """The literals that `always` operators require at a time."""
    return [
        literal
        for operator in operators
        if operator.operator == "always" and operator.start - _SAME <= t <= operator.end + _SAME
        for literal in operator.literals
    ]


def _value(literal: Literal, values: Mapping[str, Truth]) -> Truth:
    value = values.get(str(literal.atom), Truth.UNKNOWN)
    return value if literal.positive else ~value
