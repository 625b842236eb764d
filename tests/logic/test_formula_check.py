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


def test_binding_fills_in_left_out_arguments_replaces_parameters_and_keeps_constants() -> None:
    binding = {"object": "g1", "onto": "t2"}
    text = "always[a1.start, 2] (on and not hold(object) or hand_empty)"
    assert str(bind(parse(text), binding, LISTS)) == "always[a1.start, 2] (on(g1, t2) and not hold(g1) or hand_empty)"
    assert str(bind(parse("full(bin)"), binding, LISTS)) == "full(bin)"
    assert LISTS["full"] == (("?t",), ("bin",))
    with pytest.raises(ValueError, match="full"):
        bind(parse("full"), {}, LISTS)


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("always[a1.start, a2.end - 0.1] (on and on(object, bin)) -> not eventually[0, 3] (hold or hand_empty)", []),
        ("always[b1.start, b2.end] (on(onto, bin) and hol)",
         [*["mtl-unknown-primitive"] * 2, "mtl-type", "mtl-unknown-predicate"]),
    ],
)  # fmt: skip
def test_every_problem_of_a_formula_is_reported(text: str, codes: list[str]) -> None:
    assert [problem.code for problem in check_formula(parse(text), DOMAIN, ACTION, ["a1", "a2"])] == codes


@pytest.mark.parametrize(("interval", "empty"), read_cases("logic.yaml")["intervals"])
def test_an_interval_is_empty_if_it_is_for_every_duration_of_the_primitives(interval: str, empty: bool) -> None:
    problems = list(check_formula(parse(f"always{interval} hold"), DOMAIN, ACTION, ["a1", "a2"]))
    assert [problem.code for problem in problems] == ["mtl-empty-interval"] * empty
