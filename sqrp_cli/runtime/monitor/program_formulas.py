"""The formulas of a program: reading them, conditions of retries, and formulas that the plan itself contradicts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from sqrp_cli.errors import Place
from sqrp_cli.logic.evaluation import Trace, TraceSample, evaluate
from sqrp_cli.logic.formula import Formula, Predicate, children, with_children
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program
from sqrp_cli.runtime.monitor.nominal_step import NominalStep
from sqrp_cli.runtime.robot_body import RobotBody


def read_formula(text: str) -> Formula:
    """A formula of a program; its predicates have all their arguments."""
    return _grounded(parse_formula(text, Place(Path("program"))))


def condition_value(text: str, values: Mapping[str, Truth]) -> Truth:
    """The value of a formula without temporal operators, such as the condition of a retry."""
    known = {Atom.of(name): value for name, value in values.items()}
    return evaluate(read_formula(text), Trace((TraceSample(0.0, known),), 0.0, 0.0)).truth


def condition_atoms(text: str) -> tuple[str, ...]:
    """The atoms of a formula without temporal operators."""
    found: dict[str, None] = {}
    waiting = [read_formula(text)]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Predicate):
            found[str(Atom(part.name, tuple(map(str, part.arguments or ()))))] = None
        waiting += children(part)
    return tuple(found)


def contradictions(program: Program, robot: RobotBody) -> Iterator[str]:
    """Formulas that the plan contradicts, in words: monitors cannot judge them."""
    for number, step in enumerate(program.steps, 1):
        for text in against_the_plan(NominalStep(step, program.joints, robot)):
            yield f"step {number} (`{step.short_task}`): {text}"


def against_the_plan(nominal: NominalStep) -> Iterator[str]:
    """The formulas of a step that fail as planned, and the faults that are seen as planned, in words."""
    total = nominal.step.time
    for entry in nominal.step.formulas:
        formula = read_formula(entry.formula)
        operators = ground_operators(formula, {}, total)
        samples = tuple(TraceSample(t, _settled(nominal, operators, t)) for t in nominal.times)
        truth = evaluate(formula, Trace(samples, total, total)).truth
        if truth == (Truth.FALSE if entry.fault is None else Truth.TRUE):
            what = "fails" if entry.fault is None else f"is true, and so the fault `{entry.fault}` is seen,"
            yield f"`{entry.formula}` {what} though all goes as planned"


def _settled(nominal: NominalStep, operators: tuple[GroundOperator, ...], t: float) -> Mapping[Atom, Truth]:
    """The values of the atoms that operators require at a time [s] and that stay constant to the end of the interval.

    An atom that changes within an interval is only late: a lifted object leaves its place after a while.
    """
    ends: dict[Atom, float] = {}
    for operator in operators:
        if operator.start <= t <= operator.end:
            for literal in operator.literals:
                ends[literal.atom] = max(ends.get(literal.atom, 0.0), operator.end)
    values = {atom: nominal.holds(str(atom), t) for atom in ends}
    return {
        atom: Truth.TRUE if value else Truth.FALSE
        for atom, value in values.items()
        if nominal.held_throughout(str(atom), value, t, ends[atom])
    }


def _grounded(formula: Formula) -> Formula:
    if isinstance(formula, Predicate):
        return Predicate(formula.name, formula.arguments or ())
    return with_children(formula, tuple(_grounded(part) for part in children(formula)))
