from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.logic.conditions import apply_effect, failing_literals
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases

OBJECTS = {
    "g1": frozenset({"cube", "movable", "object"}),
    "g2": frozenset({"cube", "movable", "object"}),
    "t1": frozenset({"tray", "fixture", "object"}),
}


def atoms(*texts: str) -> frozenset[Atom]:
    return frozenset(Atom(words[0], tuple(words[1:])) for words in map(str.split, texts))


def failing(precondition: str, facts: frozenset[Atom]) -> list[str]:
    text = f"""(define (domain d)
      (:requirements :typing :equality :negative-preconditions :disjunctive-preconditions :quantified-preconditions)
      (:types movable tray)
      (:constants bin - tray)
      (:predicates (hold ?x - movable) (on ?x - movable ?y - tray) (hand_empty) (open ?t - tray))
      (:action a :parameters (?x ?y - movable ?t - tray) :precondition {precondition} :effect (and)))"""
    domain = parse_domain(text, Path("d.pddl"))
    binding = {"x": "g1", "y": "g2", "t": "t1"}
    objects = {**OBJECTS, "bin": frozenset({"tray"})}
    return [str(failure) for failure in failing_literals(domain.actions["a"], binding, facts, objects, domain)]


@pytest.mark.parametrize(("precondition", "facts", "expected"), read_cases("conditions.yaml"))
def test_what_fails_is_named(precondition: str, facts: list[str], expected: list[str]) -> None:
    assert failing(precondition, atoms(*facts)) == expected


def test_an_effect_deletes_before_it_adds_and_leaves_the_rest() -> None:
    text = """(define (domain d) (:predicates (on ?x ?y) (hand_empty))
      (:action move :parameters (?x ?from ?to) :effect (and (on ?x ?to) (not (on ?x ?from)))))"""
    action = parse_domain(text, Path("d.pddl")).actions["move"]
    facts = atoms("on g1 t1", "on g2 t1", "hand_empty")
    assert apply_effect(action, {"x": "g1", "from": "t1", "to": "bin"}, facts) == atoms(
        "on g1 bin", "on g2 t1", "hand_empty"
    )
    assert apply_effect(action, {"x": "g1", "from": "t1", "to": "t1"}, facts) == facts
