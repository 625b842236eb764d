"""Reading of PDDL compared with the reader of unified-planning, where that is installed."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases

pytest.importorskip("unified_planning")
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

CONDITIONS = read_cases("logic.yaml")["conditions"]
TEMPLATE = """; comment
(define (domain handling)
  (:requirements :strips :typing :equality :negative-preconditions :disjunctive-preconditions
                 :existential-preconditions :universal-preconditions)
  (:types screw - movable movable tray - object)
  (:constants bin - tray)
  (:predicates (hold ?x - movable) (on ?x - movable ?t - tray) (hand_empty))
  (:action move
    :parameters (?x ?y - movable ?t - tray)
    :precondition {}
    :effect (and (on ?x ?t) (not (hold ?x)) (hand_empty)))
  (:action look :parameters () :effect (hand_empty)))"""


def theirs(text: str) -> object | None:
    """The problem that unified-planning makes of a domain, None if it rejects it."""
    from unified_planning.environment import Environment
    from unified_planning.io import PDDLReader

    environment = Environment()
    environment.error_used_name = False
    try:
        return PDDLReader(environment).parse_problem_string(text)
    except Exception:
        return None


def is_ours(text: str) -> bool:
    try:
        parse_domain(text, Path("domain.pddl"))
    except InputError:
        return False
    return True


@pytest.mark.parametrize("condition", CONDITIONS)
def test_both_read_valid_domains_alike(condition: str) -> None:
    text = TEMPLATE.format(condition)
    problem = theirs(text)
    domain = parse_domain(text, Path("domain.pddl"))
    assert problem is not None
    assert {a.name: [p.name for p in a.parameters] for a in problem.actions} == {
        action.name: [p.name for p in action.parameters] for action in domain.actions.values()
    }
    assert {f.name: [str(p.type).split(" - ")[0] for p in f.signature] for f in problem.fluents} == {
        signature.name: [parameter.type for parameter in signature.parameters]
        for signature in domain.predicates.values()
    }
    for action in problem.actions:
        ours = domain.actions[action.name]
        assert sum(effect.value.is_true() for effect in action.effects) == len(ours.adds)
        assert sum(effect.value.is_false() for effect in action.effects) == len(ours.deletes)


def test_a_damaged_domain_that_unified_planning_rejects_is_rejected() -> None:
    rng = random.Random(0)  # noqa: S311
    for _ in range(150):
        text = TEMPLATE.format(rng.choice(CONDITIONS))
        words = re.findall(r"[()]|[^\s()]+", text.removeprefix("; comment"))
        place = rng.randrange(len(words))
        damage = rng.choice(["drop", "copy", "swap"])
        if damage == "drop":
            del words[place]
        elif damage == "copy":
            words[place] = rng.choice(words)
        else:
            other = rng.randrange(len(words))
            words[place], words[other] = words[other], words[place]
        damaged = " ".join(words)
        assert not is_ours(damaged) or theirs(damaged) is not None, damaged
