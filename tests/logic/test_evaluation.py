from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.logic.evaluation import Monitor, Sample, Trace, Verdict, evaluate
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.mtl import Always, And, Eventually, Formula, Implies, Instant, Interval, Not, Or, Predicate
from sqrp_cli.logic.truth import Truth

P, Q = Predicate("p", ()), Predicate("q", ())
TRUE, FALSE, UNKNOWN = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN


def interval(start: float, end: float) -> Interval:
    return Interval(Instant(offset=start), Instant(offset=end))


def brute_force(formula: Formula, trace: Trace, half: int) -> Truth:
    """The value at half * 0.5 s, by looking at every half second.

    That is exact where all times of formula and trace are whole seconds: nothing changes between two half seconds save
    at whole ones.
    """
    match formula:
        case Predicate():
            time = half / 2
            known = [sample for sample in trace.samples if sample.time <= time]
            return known[-1].values.get(formula.atom, UNKNOWN) if known and time <= trace.end else UNKNOWN
        case Not(operand):
            return Truth(-brute_force(operand, trace, half))
        case And(operands):
            return min(brute_force(operand, trace, half) for operand in operands)
        case Or(operands):
            return max(brute_force(operand, trace, half) for operand in operands)
        case Implies(premise, conclusion):
            return max(Truth(-brute_force(premise, trace, half)), brute_force(conclusion, trace, half))
        case Always(window, operand) | Eventually(window, operand):
            first = max(0, half + round(2 * window.start.offset))
            last = min(round(2 * trace.total), half + round(2 * window.end.offset))
            values = [brute_force(operand, trace, other) for other in range(first, last + 1)]
            return min(values, default=TRUE) if isinstance(formula, Always) else max(values, default=FALSE)


bounds = st.tuples(st.integers(-1, 4), st.integers(0, 4)).map(lambda pair: interval(pair[0], pair[0] + pair[1]))


def combined(parts: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    pairs = st.tuples(parts, parts)
    return st.one_of(
        st.builds(Not, parts),
        st.builds(And, pairs),
        st.builds(Or, pairs),
        st.builds(Implies, parts, parts),
        st.builds(Always, bounds, parts),
        st.builds(Eventually, bounds, parts),
    )


formulas = st.recursive(st.sampled_from([P, Q]), combined, max_leaves=5)


@st.composite
def traces(draw: st.DrawFn, most_samples: int = 6) -> Trace:
    times = sorted(draw(st.sets(st.integers(0, 8), max_size=most_samples)))
    total = draw(st.integers(0, 8))
    end = max([draw(st.integers(-1, 8)), *times])
    values = st.sampled_from(list(Truth))
    return Trace(tuple(Sample(time, {P.atom: draw(values), Q.atom: draw(values)}) for time in times), end, total)


@settings(max_examples=5000, deadline=None)
@given(formulas, traces())
def test_the_verdict_equals_that_of_a_brute_force_evaluator_at_every_instant(formula: Formula, trace: Trace) -> None:
    verdict = evaluate(formula, trace)
    for half in range(round(2 * trace.total) + 1):
        assert verdict.signal.at(half / 2) == brute_force(formula, trace, half)


@settings(max_examples=500, deadline=None)
@given(formulas, traces())
def test_every_sub_formula_has_its_own_verdict(formula: Formula, trace: Trace) -> None:
    def check(verdict: Verdict) -> None:
        assert verdict == evaluate(verdict.formula, trace)
        for part in verdict.parts:
            check(part)

    check(evaluate(formula, trace))


@settings(max_examples=1000, deadline=None)
@given(formulas, traces(most_samples=3))
def test_a_decision_is_the_same_under_every_completion_of_the_evidence(formula: Formula, trace: Trace) -> None:
    truth = evaluate(formula, trace).truth
    times = [0.0, *(sample.time for sample in trace.samples if sample.time > 0)]
    if trace.end < trace.total:
        times.append(trace.end + 0.5)
    known = [[brute_force(atom, trace, round(2 * time)) for atom in (P, Q)] for time in times]
    choices = [[TRUE, FALSE] if value == UNKNOWN else [value] for row in known for value in row]
    outcomes = set()
    for values in product(*choices):
        rows = zip(times, values[::2], values[1::2], strict=True)
        samples = tuple(Sample(time, {P.atom: p, Q.atom: q}) for time, p, q in rows)
        outcomes.add(evaluate(formula, Trace(samples, trace.total, trace.total)).truth)
    assert UNKNOWN not in outcomes
    if truth != UNKNOWN:
        assert outcomes == {truth}


@settings(max_examples=1000, deadline=None)
@given(formulas, traces())
def test_the_monitor_says_the_same_as_the_evaluation_of_the_evidence_so_far(formula: Formula, trace: Trace) -> None:
    monitor = Monitor(formula, trace.total)
    decided = monitor.verdict.truth
    for count, sample in enumerate(trace.samples, start=1):
        truth = monitor.observe(sample.time, sample.values).truth
        assert truth == evaluate(formula, Trace(trace.samples[:count], sample.time, trace.total)).truth
        assert decided in {UNKNOWN, truth}
        decided = truth
    assert monitor.finish(trace.end).truth == evaluate(formula, trace).truth


def known(*samples: tuple[float, Truth]) -> Trace:
    return Trace(tuple(Sample(time, {P.atom: value}) for time, value in samples), 10.0, 10.0)


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


def test_a_monitor_decides_as_soon_as_the_evidence_does() -> None:
    monitor = Monitor(Always(interval(1, 2), P), 10.0)
    assert monitor.observe(0.0, {P.atom: FALSE}).truth == UNKNOWN
    assert monitor.observe(1.0, {P.atom: TRUE}).truth == UNKNOWN
    assert monitor.observe(1.9, {P.atom: TRUE}).truth == UNKNOWN
    assert monitor.observe(2.0, {P.atom: TRUE}).truth == TRUE
    assert monitor.observe(3.0, {P.atom: FALSE}).truth == TRUE


def test_a_violation_is_seen_at_once() -> None:
    monitor = Monitor(Always(interval(1, 9), P), 10.0)
    monitor.observe(0.0, {P.atom: TRUE})
    assert monitor.observe(4.0, {P.atom: FALSE}).truth == FALSE


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
