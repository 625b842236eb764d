from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError
from sqrp_cli.logic.domain import Domain, Holds, Parameter, merge_domains
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases
from tests.logic.planning import read

CASES = read_cases("pddl_errors.yaml")

TRAYS = """; Several actions, and all that is supported.
(define (domain Trays)
  (:requirements :strips :typing :equality :negative-preconditions :quantified-preconditions
                 :disjunctive-preconditions)
  (:types screw cube - movable tray table - fixture movable fixture)
  (:constants bin - tray)
  (:predicates (hold ?x - movable) (on ?x - movable ?y) (hand_empty))
  (:ACTION Place
    :parameters (?x - movable ?y - tray)
    :precondition (AND (hold ?X) (not (= ?y bin))
                       (forall (?z - movable) (not (on ?z ?y)))
                       (exists (?z - screw ?t - table) (or (on ?z ?t) (imply (hand_empty) (= ?z ?x)))))
    :effect (and (on ?x ?y) (hand_empty) (not (hold ?x))))
  (:action wait :parameters () :effect (and)))
"""


def test_a_domain_with_everything_that_is_supported() -> None:
    domain = read(TRAYS)
    of_movable, of_fixture = dict.fromkeys(("screw", "cube"), "movable"), dict.fromkeys(("tray", "table"), "fixture")
    assert domain.types == {**of_movable, **of_fixture, "movable": "object", "fixture": "object"}
    assert domain.constants == {"bin": "tray"}
    assert domain.predicates["on"].parameters == (Parameter("x", "movable"), Parameter("y", "object"))
    action = domain.actions["place"]
    assert action.parameters == (Parameter("x", "movable"), Parameter("y", "tray"))
    assert str(action.precondition) == (
        "hold(?x) and not (?y = bin) and for all ?z - movable: not on(?z, ?y) and "
        "for some ?z - screw, ?t - table: on(?z, ?t) or not hand_empty or ?z = ?x"
    )
    assert action.adds == (Holds("on", ("?x", "?y")), Holds("hand_empty", ()))
    assert action.deletes == (Holds("hold", ("?x",)),)
    wait = domain.actions["wait"]
    assert (str(wait.precondition), wait.adds, wait.deletes) == ("", (), ())
    strips = "(define (domain d) (:predicates (p ?x)) (:action a :parameters (?x) :precondition () :effect (p ?x)))"
    assert read(strips).actions["a"].parameters == (Parameter("x", "object"),)


def test_an_object_fits_a_type_by_any_of_its_types() -> None:
    several = ["bolt", "movable", "object"]
    for types, fits, others in (
        (["screw"], ["screw", "movable", "object"], ["fixture", "tray"]),
        (["movable"], ["movable"], ["screw"]),
        (several, ["movable", "bolt"], ["screw"]),
        (["bolt"], ["bolt", "object"], ["movable"]),
    ):
        assert all(read(TRAYS).fits(types, one) for one in fits), types
        assert not any(read(TRAYS).fits(types, one) for one in others), types


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_errors_say_what_is_wrong_and_where(case: dict[str, str]) -> None:
    with pytest.raises(InputError) as error:
        read(case["input"])
    at_place = [
        problem
        for problem in error.value.problems
        if problem.place is not None and (problem.place.line, problem.place.column) == (case["line"], case["column"])
    ]
    assert [problem.code for problem in at_place] == [case["code"]], error.value
    assert case["message"] in at_place[0].message
    line, caret = str(at_place[0].excerpt).split("\n")
    assert line == case["input"].split("\n")[int(case["line"]) - 1].rstrip()
    assert caret == " " * (int(case["column"]) - 1) + "^"


def test_problems_are_reported_together_in_order_of_place() -> None:
    text = """(define (domain d)
      (:predicates (hold ?x))
      (:action a :parameters (?x) :precondition (not (hold ?y)) :effect (held ?x))
      (:action b :parameters (?x) :effect (hold ?x ?x)))"""
    with pytest.raises(InputError) as error:
        read(text)
    assert [problem.code for problem in error.value.problems] == [
        "pddl-undeclared-requirement",
        "pddl-unknown-variable",
        "pddl-unknown-predicate",
        "pddl-arity",
    ]
    assert error.value.problems[0].mend == "add `:negative-preconditions` to `(:requirements ...)`"


@pytest.mark.parametrize("text", ["(" * 5000, "(" * 5000 + ")" * 5000, "(define " * 60 + ")" * 60, "a" * 1_000_001])
def test_huge_or_deep_text_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        read(text)


@given(st.integers(0, len(TRAYS) - 1), st.sampled_from(["", "(", ")", "?", " ", "x", "-", ":"]))
def test_a_damaged_domain_is_read_or_refused_with_a_place_in_the_file(position: int, damage: str) -> None:
    try:
        read(TRAYS[:position] + damage + TRAYS[position + 1 :])
    except InputError as error:
        for problem in error.problems:
            assert problem.place is not None
            assert 1 <= (problem.place.line or 0) <= TRAYS.count("\n") + 1


def domain(name: str, predicates: str, action: str, types: str = "movable tray") -> Domain:
    text = f"""(define (domain {name}) (:requirements :typing) (:types {types}) (:predicates {predicates})
        (:action {action} :parameters () :effect (and)))"""
    return parse_domain(text, Path(f"{name}.pddl"))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (domain("place", "(hold ?x - tray)", "place"), "predicate `hold` is also defined in pick.pddl"),
        (domain("place", "(hold ?x ?y - movable)", "place"), "predicate `hold` is also defined in pick.pddl"),
        (domain("place", "(on ?x)", "place", "movable - tray tray"), "type `movable` is also defined in pick.pddl"),
        (domain("place", "(on ?x)", "pick"), "action `pick` is also defined in pick.pddl"),
    ],
)
def test_domains_merge_unless_they_use_a_name_differently(other: Domain, message: str) -> None:
    pick = domain("pick", "(hold ?object - movable)", "pick")
    merged = merge_domains([pick, domain("place", "(hold ?x - movable) (on ?x - movable ?t - tray)", "place")])
    assert (set(merged.actions), set(merged.predicates)) == ({"pick", "place"}, {"hold", "on"})
    with pytest.raises(InputError, match="defined in") as error:
        merge_domains([pick, other])
    assert message in error.value.problems[0].message
    assert str(error.value.problems[0].place) == "place.pddl"
