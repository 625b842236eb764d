"""Verdicts on evidence with gaps, against looking at every half second, and on complete evidence against rtamt."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from random import Random
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import Place
from sqrp_cli.logic.formula import Formula, Instant, Interval, Operation, Predicate
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.truth import Monitor, Sample, Truth, evaluate
from tests.cells import read_cases

P, Q = Predicate("p", ()), Predicate("q", ())
TRUE, FALSE, UNKNOWN = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
OPPOSITE = {TRUE: FALSE, FALSE: TRUE, UNKNOWN: UNKNOWN}


class Trace(NamedTuple):
    samples: tuple[Sample, ...]
    end: float
    total: float


def evidence(predicate: Predicate, trace: Trace, half: int) -> Truth:
    """What a trace says of a predicate at half * 0.5 s."""
    known = [values for time, values in trace.samples if time <= half / 2]
    return known[-1].get(predicate.atom, UNKNOWN) if known and half / 2 <= trace.end else UNKNOWN


def brute_force(formula: Formula, trace: Trace) -> list[Truth]:
    """The value at every half second from 0 to the total, by looking at every half second.

    That is exact where all times of formula and trace are whole seconds: nothing changes between two half seconds save
    at whole ones.
    """
    instants = range(round(2 * trace.total) + 1)
    if isinstance(formula, Predicate):
        return [evidence(formula, trace, half) for half in instants]
    parts = [brute_force(part, trace) for part in formula.parts]
    if (window := formula.interval) is not None:
        first, last = round(2 * window.start.offset), round(2 * window.end.offset)
        asked = [parts[0][max(0, half + first) : max(0, half + last + 1)] for half in instants]
        if formula.operator == "always":
            return [min(values, default=TRUE) for values in asked]
        return [max(values, default=FALSE) for values in asked]
    match formula.operator:
        case "not":
            return [OPPOSITE[value] for value in parts[0]]
        case "and":
            return [min(values) for values in zip(*parts, strict=True)]
        case "or":
            return [max(values) for values in zip(*parts, strict=True)]
    return [max(OPPOSITE[premise], conclusion) for premise, conclusion in zip(*parts, strict=True)]


def random_formula(random: Random, leaves: int, earliest: int = -1) -> Formula:
    if random.random() < 0.4:
        kind = random.choice(["not", "always", "eventually"])
        start = random.randint(earliest, 4)
        bounds = Interval(Instant(offset=start), Instant(offset=start + random.randint(0, 4)))
        part = random_formula(random, leaves, earliest)
        return Operation(kind, (part,), None if kind == "not" else bounds)
    if leaves == 1:
        return random.choice((P, Q))
    left = random.randint(1, leaves - 1)
    parts = random_formula(random, left, earliest), random_formula(random, leaves - left, earliest)
    return Operation(random.choice(["and", "or", "implies"]), parts)


def random_trace(random: Random, most_samples: int) -> Trace:
    times = sorted(random.sample(range(9), random.randint(0, most_samples)))
    total = random.randint(0, 8)
    end = max([random.randint(-1, 8), *times])
    samples = ((time, {atom: random.choice(list(Truth)) for atom in (P.atom, Q.atom)}) for time in times)
    return Trace(tuple(samples), end, total)


Cases = list[tuple[Formula, Trace]]


def ten_cases(most_samples: int = 6) -> st.SearchStrategy[Cases]:
    """Formulas with evidence, ten at a time: it takes longer to draw a number than to judge what is made from it."""

    def made(seed: int) -> Cases:
        random = Random(seed)  # noqa: S311
        return [(random_formula(random, random.randint(1, 5)), random_trace(random, most_samples)) for _ in range(10)]

    return st.integers(0, 2**32 - 1).map(made)


@settings(max_examples=120, deadline=None)
@given(ten_cases())
def test_the_verdict_equals_that_of_a_brute_force_evaluator_at_every_instant(cases: Cases) -> None:
    for formula, trace in cases:
        signal, values = evaluate(formula, *trace), brute_force(formula, trace)
        assert [signal.at(half * 10**9) for half in range(len(values))] == values, (str(formula), trace)


@settings(max_examples=40, deadline=None)
@given(ten_cases(most_samples=3))
def test_a_decision_is_the_same_under_every_completion_of_the_evidence(cases: Cases) -> None:
    for formula, trace in cases:
        truth = evaluate(formula, *trace).at(0)
        times = [0.0, *(time for time, _ in trace.samples if 0 < time <= trace.total)]
        if trace.end < trace.total:
            times.append(trace.end + 0.5)
        known = [[evidence(atom, trace, round(2 * time)) for atom in (P, Q)] for time in times]
        choices = [[TRUE, FALSE] if value == UNKNOWN else [value] for row in known for value in row]
        outcomes = set()
        for values in product(*choices):
            rows = zip(times, values[::2], values[1::2], strict=True)
            samples = tuple((time, {P.atom: p, Q.atom: q}) for time, p, q in rows)
            outcomes.add(evaluate(formula, samples, trace.total, trace.total).at(0))
        assert UNKNOWN not in outcomes
        if truth != UNKNOWN:
            assert outcomes == {truth}, (str(formula), trace)


@settings(max_examples=40, deadline=None)
@given(ten_cases())
def test_the_monitor_says_the_same_as_the_evaluation_of_the_evidence_so_far(cases: Cases) -> None:
    for formula, trace in cases:
        monitor = Monitor(formula, trace.total)
        decided = monitor.truth
        for count, (time, values) in enumerate(trace.samples, start=1):
            truth = monitor.observe(time, values)
            assert truth == evaluate(formula, trace.samples[:count], time, trace.total).at(0)
            assert decided in {UNKNOWN, truth}, (str(formula), trace)
            decided = truth


def read(text: str) -> Formula:
    """A formula about p and q, whose arguments may be left out because there are none."""
    return parse_formula(text.replace("p", "p(g1)"), Place(Path("formula"), 1, 1))


SEEN = Atom("p", ("g1",))


def known(*samples: tuple[float, Truth]) -> Trace:
    return Trace(tuple((time, {SEEN: value}) for time, value in samples), 10.0, 10.0)


def test_what_was_seen_up_to_an_instant_is_unknown_right_after_it() -> None:
    signal, second = evaluate(read("p"), ((0.0, {SEEN: TRUE}),), 5.0, 7.0), 2 * 10**9
    assert [signal.at(half) for half in (0, 1, 5 * second)] == [TRUE] * 3
    assert [signal.at(half) for half in (5 * second + 1, 7 * second)] == [UNKNOWN] * 2


@pytest.mark.parametrize(("formula", "samples", "truth"), read_cases("logic.yaml")["verdicts"])
def test_verdicts_worked_out_by_hand(formula: str, samples: list[tuple[float, int]], truth: int) -> None:
    assert evaluate(read(formula), *known(*((time, Truth(value)) for time, value in samples))).at(0) == truth


LATE = [(0.0, FALSE, UNKNOWN), (1.0, TRUE, UNKNOWN), (1.9, TRUE, UNKNOWN), (2.0, TRUE, TRUE), (3.0, FALSE, TRUE)]


@pytest.mark.parametrize(
    ("formula", "evidence"),
    [("always[1, 2] p", LATE), ("always[1, 9] p", [(0.0, TRUE, UNKNOWN), (4.0, FALSE, FALSE)])],
)
def test_a_monitor_decides_as_soon_as_the_evidence_does(
    formula: str, evidence: list[tuple[float, Truth, Truth]]
) -> None:
    monitor = Monitor(read(formula), 10.0)
    for time, seen, truth in evidence:
        assert monitor.observe(time, {SEEN: seen}) == truth
    with pytest.raises(ValueError, match="not newer"):
        monitor.observe(evidence[-1][0], {SEEN: TRUE})
    with pytest.raises(ValueError, match=r"a1\.start"):
        evaluate(read(formula.replace("1", "a1.start", 1)), *known((0, TRUE)))


@pytest.mark.parametrize("seed", range(40))
def test_verdicts_on_complete_traces_are_those_of_rtamt(seed: int) -> None:
    rtamt = pytest.importorskip("rtamt")
    random, seconds = Random(seed), 60  # noqa: S311 - longer than any formula looks ahead: rtamt judges to the end alone
    formula = random_formula(random, 5, earliest=0)
    values = {name: [random.choice([1.0, -1.0]) for _ in range(seconds)] for name in "pq"}

    def in_rtamt(formula: Formula) -> str:
        if isinstance(formula, Predicate):
            return f"({formula.name} > 0)"
        texts = [in_rtamt(part) for part in formula.parts]
        if formula.interval is not None:
            return f"({formula.operator}[{formula.interval.start}:{formula.interval.end}] {texts[0]})"
        sign = {"implies": "->"}.get(formula.operator, formula.operator)
        return f"(not {texts[0]})" if sign == "not" else f"({f' {sign} '.join(texts)})"

    specification = rtamt.StlDiscreteTimeSpecification()
    for name in values:
        specification.declare_var(name, "float")
    specification.spec = in_rtamt(formula)
    specification.parse()
    (_, robustness), *_ = specification.evaluate({"time": list(range(seconds)), **values})
    samples = tuple((t, {Atom(name): Truth(int(value[t])) for name, value in values.items()}) for t in range(seconds))
    assert evaluate(formula, samples, seconds, seconds).at(0) == (1 if robustness > 0 else -1)
