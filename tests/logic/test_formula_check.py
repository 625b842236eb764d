from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import Place
from sqrp_cli.logic.formula import Formula, argument_lists, bind, check_formula
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases

TEXT = """(define (domain place)
  (:requirements :typing :negative-preconditions :existential-preconditions :disjunctive-preconditions)
  (:types movable tray)
  (:constants bin - tray)
  (:predicates (hold ?x - movable) (on ?x - movable ?t - tray) (hand_empty) (full ?t - tray))
  (:action place :parameters (?object - movable ?onto - tray)
    :precondition (and (hold ?object) (not (hand_empty)) (not (exists (?t - tray) (full ?t))) (not (full bin)))
    :effect (and (on ?object ?onto) (not (hold ?object)) (hand_empty))))"""
DOMAIN = parse_domain(TEXT, Path("place.pddl"))
ACTION = DOMAIN.actions["place"]
LISTS = argument_lists(ACTION)


def parse(text: str) -> Formula:
    return parse_formula(text, Place(Path("skill.yaml"), 1, 1))


def test_argument_lists_are_those_of_precondition_and_effect() -> None:
    assert LISTS == {
        "hold": (("object",),),
        "hand_empty": ((),),
        "full": (("?t",), ("bin",)),
        "on": (("object", "onto"),),
    }


@pytest.mark.parametrize(
    ("text", "bound"),
    [
        (
            "always[a1.start, 2] (on and not hold(object) or hand_empty)",
            "always[a1.start, 2] (on(g1, t2) and not hold(g1) or hand_empty)",
        ),
        ("full(bin)", "full(bin)"),
    ],
)
def test_binding_fills_in_left_out_arguments_replaces_parameters_and_keeps_constants(text: str, bound: str) -> None:
    assert str(bind(parse(text), {"object": "g1", "onto": "t2"}, LISTS)) == bound


def test_arguments_that_are_not_unique_cannot_be_filled_in() -> None:
    with pytest.raises(ValueError, match="full"):
        bind(parse("full"), {}, LISTS)


def test_a_formula_with_known_names_has_no_problem() -> None:
    text = "always[a1.start, a2.end - 0.1] (on and on(object, bin)) -> not eventually[0, 3] (hold or hand_empty)"
    assert list(check_formula(parse(text), DOMAIN, ACTION, ["a1", "a2"])) == []


def test_every_problem_of_a_formula_is_reported() -> None:
    formula = parse("always[b1.start, b2.end] (on(onto, bin) and hol)")
    problems = list(check_formula(formula, DOMAIN, ACTION, ["a1", "a2"]))
    assert [problem.code for problem in problems] == [
        "mtl-unknown-primitive",
        "mtl-unknown-primitive",
        "mtl-type",
        "mtl-unknown-predicate",
    ]


@pytest.mark.parametrize(("interval", "empty"), read_cases("logic.yaml")["intervals"])
def test_an_interval_is_empty_if_it_is_for_every_duration_of_the_primitives(interval: str, empty: bool) -> None:
    problems = list(check_formula(parse(f"always{interval} hold"), DOMAIN, ACTION, ["a1", "a2"]))
    assert [problem.code for problem in problems] == ["mtl-empty-interval"] * empty
