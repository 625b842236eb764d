from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Place
from sqrp_cli.logic.formula import argument_lists, bind
from sqrp_cli.logic.formula_time import (
    GroundOperator,
    TimeInterval,
    ground_operators,
    merge,
    with_times,
)
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases

CASES = read_cases("logic.yaml")
SPANS = {"a1": (0.0, 2.0), "a2": (2.0, 3.0), "a3": (3.0, 4.0), "a4": (4.0, 5.5), "a5": (5.5, 8.0)}
TOTAL = 8.0

PICKUP = """(define (domain pickup) (:requirements :strips :negative-preconditions)
  (:predicates (hold ?x) (obj_on_table ?x) (hand_empty))
  (:action pickup :parameters (?object)
    :precondition (and (obj_on_table ?object) (not (hold ?object)) (hand_empty))
    :effect (and (hold ?object) (not (obj_on_table ?object)) (not (hand_empty)))))"""
ACTION = parse_domain(PICKUP, Path("pickup.pddl")).actions["pickup"]


def ground(text: str) -> tuple[GroundOperator, ...]:
    formula = parse_formula(text, Place(Path("skill.yaml"), 1, 1))
    return ground_operators(bind(formula, {"object": "g1"}, argument_lists(ACTION)), SPANS, TOTAL)


HOLD, ON_TABLE = Literal(Atom("hold", ("g1",))), Literal(Atom("obj_on_table", ("g1",)))


def test_a_fault_is_one_entry_with_its_literals_as_written() -> None:
    text = "eventually[a4.start, a4.end] (not hold and obj_on_table)"
    bound = "eventually[a4.start, a4.end] (not hold(g1) and obj_on_table(g1))"
    assert ground(text) == (GroundOperator(4.0, 5.5, bound, "eventually", (HOLD.negated(), ON_TABLE)),)
    assert [str(literal) for literal in ground(text)[0].literals] == ["not hold(g1)", "obj_on_table(g1)"]
    # Outside any operator: the formula is its text, and the start its interval.
    (entry,) = ground("not hold and hand_empty")
    assert (entry.start, entry.end, entry.text) == (0.0, 0.0, "not hold(g1) and hand_empty")


@pytest.mark.parametrize(("text", "expected"), CASES["operators"])
def test_operators_have_their_intervals_in_seconds(text: str, expected: list[object]) -> None:
    assert [[entry.operator, entry.start, entry.end] for entry in ground(text)] == expected


@pytest.mark.parametrize(("text", "expected"), CASES["own_literals"])
def test_operators_have_their_own_literals(text: str, expected: list[object]) -> None:
    assert [[entry.operator, list(map(str, entry.literals))] for entry in ground(text)] == expected


def test_an_interval_that_is_empty_once_grounded_names_the_numbers() -> None:
    for text, said in (
        ("always[a1.end, a1.start + 1.5] hold", "2 s to 1.5 s"),
        ("eventually[3, a1.end] hold", "3 s to 2 s"),
    ):
        with pytest.raises(InputError, match=f"from {said}") as error:
            ground(text)
        assert error.value.problems[0].code == "mtl-empty-interval"
        assert error.value.problems[0].excerpt is not None


def test_formula_time_is_a_union_in_which_stretches_merge_below_a_nanosecond_only() -> None:
    text = "always[a1.start, a2.end] hold and always[a4.start, a5.end] hold and eventually[a4.start, a4.end] hold"
    assert merge(ground(text)) == (TimeInterval(0.0, 3.0), TimeInterval(4.0, 8.0))
    assert sum(one.length for one in merge(ground(text))) == 7.0
    apart = TimeInterval(2.0 + 1.1e-9, 3.0)
    assert merge([TimeInterval(1.0, 2.0), TimeInterval(2.0 + 9e-10, 3.0)]) == (TimeInterval(1.0, 3.0),)
    assert merge([TimeInterval(1.0, 2.0), apart]) == (TimeInterval(1.0, 2.0), apart)
    assert merge([]) == ()


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 10)), max_size=12))
def test_the_length_of_the_union_counts_every_unit_of_time_once(spans: list[tuple[int, int]]) -> None:
    stretches = [TimeInterval(float(start), float(start + length)) for start, length in spans]
    units = {unit for start, length in spans for unit in range(start, start + length)}
    merged = merge(stretches)
    assert sum(one.length for one in merged) == len(units)
    assert all(left.end < right.start for left, right in pairwise(merged))


def test_bounds_become_numbers_and_the_ends_of_a_stretch_never_look_alike() -> None:
    formula = parse_formula("always[a1.end, a4.end - 0.5] eventually[0, a2.start] hold(g1)", Place(Path("f"), 1, 1))
    assert str(with_times(formula, SPANS)) == "always[2, 5] eventually[0, 2] hold(g1)"
    assert TimeInterval(6.0, 7.25).when == "from 6.0 s to 7.2 s"
    assert TimeInterval(6.001, 6.013).when == "from 6.001 s to 6.013 s"
    assert TimeInterval(6.0, 6.0).when == "at 6.0 s"
