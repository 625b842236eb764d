"""Formulas that a step contradicts though all goes as planned: monitors could only be silent about them, or wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sqrp_cli.logic.evaluation import Trace, TraceSample, evaluate
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program
from sqrp_cli.runtime.monitor.nominal_step import NominalStep
from sqrp_cli.runtime.monitor.step_monitor import read_formula
from sqrp_cli.runtime.robot_body import RobotBody


def contradictions(program: Program, robot: RobotBody) -> Iterator[str]:
    """What is wrong with the formulas of a program, in words."""
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
    """The values of the atoms that operators ask about at a time [s] and that do not change any more while they do.

    What changes within an interval is on its way to what is asked: an object that is lifted leaves its place after a
    while.
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
