from __future__ import annotations

from itertools import product
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.logic.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Instant,
    Interval,
    Not,
    Or,
    Predicate,
    children,
)
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import FormulaVerdict, Monitor, Signal, Trace, TraceSample, Truth, evaluate

P, Q = Predicate("p", ()), Predicate("q", ())
TRUE, FALSE, UNKNOWN = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
OPPOSITE = {TRUE: FALSE, FALSE: TRUE, UNKNOWN: UNKNOWN}


def interval(start: float, end: float) -> Interval:
    return Interval(Instant(offset=start), Instant(offset=end))


def evidence(predicate: Predicate, trace: Trace, half: int) -> Truth:
    """What a trace says of a predicate at half * 0.5 s."""
    time = half / 2
    known = [sample for sample in trace.samples if sample.time <= time]
    return known[-1].values.get(predicate.atom, UNKNOWN) if known and time <= trace.end else UNKNOWN


def brute_force(formula: Formula, trace: Trace) -> list[Truth]:
    """The value at every half second from 0 to the total, by looking at every half second.

    That is exact where all times of formula and trace are whole seconds: nothing changes between two half seconds save
    at whole ones.
    """
    instants = range(round(2 * trace.total) + 1)
    if isinstance(formula, Predicate):
        return [evidence(formula, trace, half) for half in instants]
    parts = [brute_force(part, trace) for part in children(formula)]
    match formula:
        case Not():
            return [OPPOSITE[value] for value in parts[0]]
        case And():
            return [min(values) for values in zip(*parts, strict=True)]
        case Or():
            return [max(values) for values in zip(*parts, strict=True)]
        case Implies():
            return [max(OPPOSITE[premise], conclusion) for premise, conclusion in zip(*parts, strict=True)]
        case Always(window) | Eventually(window):
            first, last = round(2 * window.start.offset), round(2 * window.end.offset)
            asked = [parts[0][max(0, half + first) : max(0, half + last + 1)] for half in instants]
            if isinstance(formula, Always):
                return [min(values, default=TRUE) for values in asked]
            return [max(values, default=FALSE) for values in asked]


def random_interval(random: Random) -> Interval:
    start = random.randint(-1, 4)
    return interval(start, start + random.randint(0, 4))


def random_formula(random: Random, leaves: int) -> Formula:
    if random.random() < 0.4:
        part = random_formula(random, leaves)
        kind = random.choice((Not, Always, Eventually))
        return Not(part) if kind is Not else kind(random_interval(random), part)
    if leaves == 1:
        return random.choice((P, Q))
    left = random.randint(1, leaves - 1)
    parts = random_formula(random, left), random_formula(random, leaves - left)
    kind = random.choice((And, Or, Implies))
    return Implies(*parts) if kind is Implies else kind(parts)


def random_trace(random: Random, most_samples: int) -> Trace:
    times = sorted(random.sample(range(9), random.randint(0, most_samples)))
    total = random.randint(0, 8)
    end = max([random.randint(-1, 8), *times])
    samples = (TraceSample(time, {atom: random.choice(list(Truth)) for atom in (P.atom, Q.atom)}) for time in times)
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
        signal = evaluate(formula, trace).signal
        values = brute_force(formula, trace)
        assert [signal.at(half / 2) for half in range(len(values))] == values, (str(formula), trace)


@settings(max_examples=30, deadline=None)
@given(ten_cases())
def test_every_sub_formula_has_its_own_verdict(cases: Cases) -> None:
    def check(verdict: FormulaVerdict) -> None:
        assert verdict == evaluate(verdict.formula, trace)
        for part in verdict.parts:
            check(part)

    for formula, trace in cases:
        check(evaluate(formula, trace))


@settings(max_examples=40, deadline=None)
@given(ten_cases(most_samples=3))
def test_a_decision_is_the_same_under_every_completion_of_the_evidence(cases: Cases) -> None:
    for formula, trace in cases:
        truth = evaluate(formula, trace).truth
        times = [0.0, *(sample.time for sample in trace.samples if 0 < sample.time <= trace.total)]
        if trace.end < trace.total:
            times.append(trace.end + 0.5)
        known = [[evidence(atom, trace, round(2 * time)) for atom in (P, Q)] for time in times]
        choices = [[TRUE, FALSE] if value == UNKNOWN else [value] for row in known for value in row]
        outcomes = set()
        for values in product(*choices):
            rows = zip(times, values[::2], values[1::2], strict=True)
            samples = tuple(TraceSample(time, {P.atom: p, Q.atom: q}) for time, p, q in rows)
            outcomes.add(evaluate(formula, Trace(samples, trace.total, trace.total)).truth)
        assert UNKNOWN not in outcomes
        if truth != UNKNOWN:
            assert outcomes == {truth}, (str(formula), trace)


@settings(max_examples=40, deadline=None)
@given(ten_cases())
def test_the_monitor_says_the_same_as_the_evaluation_of_the_evidence_so_far(cases: Cases) -> None:
    for formula, trace in cases:
        monitor = Monitor(formula, trace.total)
        decided = monitor.verdict.truth
        for count, sample in enumerate(trace.samples, start=1):
            truth = monitor.observe(sample.time, sample.values).truth
            assert truth == evaluate(formula, Trace(trace.samples[:count], sample.time, trace.total)).truth
            assert decided in {UNKNOWN, truth}, (str(formula), trace)
            decided = truth


def test_what_was_seen_up_to_an_instant_is_unknown_right_after_it() -> None:
    trace = Trace((TraceSample(0.0, {P.atom: TRUE}),), 5.0, 7.0)
    # At 0 s, after it, at 5 s, after it, at 7 s.
    assert evaluate(P, trace).signal == Signal((0, 5 * 10**9, 7 * 10**9), (TRUE, TRUE, TRUE, UNKNOWN, UNKNOWN))


def known(*samples: tuple[float, Truth]) -> Trace:
    return Trace(tuple(TraceSample(time, {P.atom: value}) for time, value in samples), 10.0, 10.0)


@pytest.mark.parametrize(
    ("formula", "trace", "truth"),
    [
        (Always(interval(1, 2), P), known((0, FALSE), (1, TRUE), (3, FALSE)), TRUE),
        (Always(interval(1, 3), P), known((0, TRUE), (3, FALSE)), FALSE),
        (Eventually(interval(1, 3), P), known((0, FALSE), (3, TRUE)), TRUE),
        (Eventually(interval(1, 2.9), P), known((0, FALSE), (3, TRUE)), FALSE),
        (Always(interval(1, 2), P), known((0, TRUE), (1.5, UNKNOWN), (1.6, TRUE)), UNKNOWN),
        (Always(interval(1, 2), P), known((0, TRUE), (1.5, UNKNOWN), (1.6, FALSE)), FALSE),
        (Eventually(interval(1, 2), P), known((0, UNKNOWN), (1.5, TRUE)), TRUE),
        (Always(interval(11, 12), P), known((0, FALSE)), TRUE),
        (Eventually(interval(11, 12), P), known((0, TRUE)), FALSE),
        (P, known((0, TRUE), (1, FALSE)), TRUE),
        (P, known((0.5, TRUE)), UNKNOWN),
        (Always(interval(0.1, 0.3), P), known((0, TRUE), (0.1 + 0.2, FALSE)), FALSE),
        (Always(interval(0.1, 0.3 - 1e-8), P), known((0, TRUE), (0.1 + 0.2, FALSE)), TRUE),
    ],
)
def test_verdicts_worked_out_by_hand(formula: Formula, trace: Trace, truth: Truth) -> None:
    assert evaluate(formula, trace).truth == truth


@pytest.mark.parametrize(
    ("end", "evidence"),
    [
        (2, [(0.0, FALSE, UNKNOWN), (1.0, TRUE, UNKNOWN), (1.9, TRUE, UNKNOWN), (2.0, TRUE, TRUE), (3.0, FALSE, TRUE)]),
        (9, [(0.0, TRUE, UNKNOWN), (4.0, FALSE, FALSE)]),
    ],
)
def test_a_monitor_decides_as_soon_as_the_evidence_does(end: float, evidence: list[tuple[float, Truth, Truth]]) -> None:
    monitor = Monitor(Always(interval(1, end), P), 10.0)
    for time, seen, truth in evidence:
        assert monitor.observe(time, {P.atom: seen}).truth == truth


def test_evidence_must_arrive_in_order() -> None:
    monitor = Monitor(Always(interval(1, 9), P), 10.0)
    monitor.observe(1.0, {P.atom: TRUE})
    with pytest.raises(ValueError, match="not newer"):
        monitor.observe(1.0, {P.atom: TRUE})


def test_bounds_must_be_numbers() -> None:
    formula = Always(Interval(Instant("a1", "start"), Instant(offset=2.0)), P)
    with pytest.raises(ValueError, match=r"a1\.start"):
        evaluate(formula, known((0, TRUE)))


def test_an_atom_without_evidence_is_unknown() -> None:
    assert evaluate(Or((P, Predicate("r", ("g1",)))), known((0, FALSE))).truth == UNKNOWN
    assert Atom("r", ("g1",)) not in known((0, FALSE)).samples[0].values
