"""What we read, and say can and cannot be done, compared with unified-planning's reader and with Fast Downward.

Fast Downward takes 0.2 s a problem, so the suite asks it about a few; `make planners` asks it about 300.
"""

from __future__ import annotations

import contextlib
import os
import random
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.logic.pddl_parser import parse_domain
from sqrp_cli.logic.planner import Plan, ProvenImpossible, find_plan
from sqrp_cli.logic.planning_task import PlanStep
from sqrp_cli.logic.unified_planner import engine_planner
from tests.cells import read_cases
from tests.logic.planning import Problem, assert_reaches, random_problem

pytest.importorskip("unified_planning")
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
fast_downward = pytest.mark.skipif(find_spec("up_fast_downward") is None, reason="no Fast Downward")  # slow to import

PROBLEMS = int(os.environ.get("SQRP_PLANNING_PROBLEMS", "16"))


def pddl(problem: Problem) -> str:
    def listed(literal: str) -> str:
        return f"(not ({literal.removeprefix('not ')}))" if literal.startswith("not ") else f"({literal})"

    facts = " ".join(f"({' '.join([fact.predicate, *fact.arguments])})" for fact in sorted(problem.facts))
    goal = " ".join(map(listed, problem.literals))
    objects = " ".join(problem.objects)
    return f"(define (problem p) (:domain random) (:objects {objects}) (:init {facts}) (:goal (and {goal})))"


def by_fast_downward(problem: Problem, folder: Path) -> Plan | None:
    """Its plan, None if there is none; the text is read by unified-planning, nothing of it by us."""
    from unified_planning.engines import PlanGenerationResultStatus as Status
    from unified_planning.environment import Environment
    from unified_planning.io import PDDLReader

    environment = Environment()
    environment.credits_stream = None
    environment.error_used_name = False
    read = PDDLReader(environment).parse_problem_string(problem.text, pddl(problem))
    with environment.factory.OneshotPlanner(name="fast-downward") as planner, contextlib.chdir(folder):
        result = planner.solve(read, timeout=60)
    if result.plan is None:
        assert result.status in (Status.UNSOLVABLE_PROVEN, Status.UNSOLVABLE_INCOMPLETELY), result.status
        return None
    return tuple(PlanStep(a.action.name, tuple(map(str, a.actual_parameters))) for a in result.plan.actions)


@fast_downward
@pytest.mark.parametrize("seed", range(PROBLEMS))
def test_fast_downward_solves_the_same_random_problems_with_negation(seed: int, tmp_path: Path) -> None:
    problem = random_problem(seed)
    domain, objects, facts, goal = problem.domain, problem.objects, problem.facts, problem.goal
    ours, theirs = find_plan(domain, objects, facts, goal, {}), by_fast_downward(problem, tmp_path)
    if theirs is None:
        assert isinstance(ours, ProvenImpossible)
        return
    assert_reaches(theirs, domain, objects, facts, goal)
    assert_reaches(ours, domain, objects, facts, goal)


@fast_downward
@pytest.mark.parametrize("seed", range(0, PROBLEMS, 4))
def test_another_engine_in_place_of_our_search_gives_the_same_kind_of_answer(seed: int) -> None:
    problem = random_problem(seed)
    domain, objects, facts, goal = problem.domain, problem.objects, problem.facts, problem.goal
    ours = find_plan(domain, objects, facts, goal, {})
    theirs = engine_planner("fast-downward")(domain, objects, facts, goal, {})
    assert type(theirs) is type(ours)
    if isinstance(theirs, tuple):
        assert_reaches(theirs, domain, objects, facts, goal)


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
