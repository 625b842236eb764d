"""Verdicts on complete traces compared with rtamt, where that is installed."""

from __future__ import annotations

import random

import pytest

from sqrp_cli.logic.formula import Always, And, Eventually, Formula, Implies, Instant, Interval, Not, Or, Predicate
from sqrp_cli.logic.truth import Trace, TraceSample, Truth, evaluate

rtamt = pytest.importorskip("rtamt")

SECONDS = 40
"""Longer than any formula below looks ahead, so that rtamt never judges by a trace that ends too early."""


def random_formula(rng: random.Random, depth: int) -> Formula:
    kind = rng.choice(["predicate", "not", "and", "or", "implies", "always", "eventually"]) if depth else "predicate"
    match kind:
        case "predicate":
            return Predicate(rng.choice(["p", "q"]), ())
        case "not":
            return Not(random_formula(rng, depth - 1))
        case "and":
            return And((random_formula(rng, depth - 1), random_formula(rng, depth - 1)))
        case "or":
            return Or((random_formula(rng, depth - 1), random_formula(rng, depth - 1)))
        case "implies":
            return Implies(random_formula(rng, depth - 1), random_formula(rng, depth - 1))
    start = rng.randint(0, 4)
    interval = Interval(Instant(offset=start), Instant(offset=start + rng.randint(0, 4)))
    operator = Always if kind == "always" else Eventually
    return operator(interval, random_formula(rng, depth - 1))


def in_rtamt(formula: Formula) -> str:
    match formula:
        case Predicate(name):
            return f"({name} > 0)"
        case Not(operand):
            return f"(not {in_rtamt(operand)})"
        case And((left, right)):
            return f"({in_rtamt(left)} and {in_rtamt(right)})"
        case Or((left, right)):
            return f"({in_rtamt(left)} or {in_rtamt(right)})"
        case Implies(premise, conclusion):
            return f"({in_rtamt(premise)} -> {in_rtamt(conclusion)})"
        case Always(interval, operand):
            return f"(always[{interval.start}:{interval.end}] {in_rtamt(operand)})"
        case Eventually(interval, operand):
            return f"(eventually[{interval.start}:{interval.end}] {in_rtamt(operand)})"
    raise TypeError(formula)


@pytest.mark.parametrize("seed", range(40))
def test_verdicts_on_complete_traces_agree(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311
    formula = random_formula(rng, 4)
    values = {name: [rng.choice([1.0, -1.0]) for _ in range(SECONDS)] for name in "pq"}

    specification = rtamt.StlDiscreteTimeSpecification()
    for name in values:
        specification.declare_var(name, "float")
    specification.spec = in_rtamt(formula)
    specification.parse()
    (_, robustness), *_ = specification.evaluate({"time": list(range(SECONDS)), **values})

    samples = tuple(
        TraceSample(time, {Predicate(name, ()).atom: Truth(int(value[time])) for name, value in values.items()})
        for time in range(SECONDS)
    )
    assert evaluate(formula, Trace(samples, SECONDS, SECONDS)).truth == (1 if robustness > 0 else -1)
