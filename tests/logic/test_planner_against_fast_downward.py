"""What our search says can and cannot be done, compared with Fast Downward, which reads the same text by other means.

Fast Downward takes 0.2 s a problem, so the suite asks it about a few; `make planners` asks it about 300.
"""

from __future__ import annotations

import contextlib
import os
from importlib.util import find_spec
from pathlib import Path

import pytest

from sqrp_cli.logic.planner import Plan, ProvenImpossible, find_plan
from sqrp_cli.logic.planning_task import PlanStep
from sqrp_cli.logic.unified_planner import engine_planner
from tests.logic.planning import Problem, assert_reaches, random_problem

pytestmark = [
    pytest.mark.skipif(find_spec("up_fast_downward") is None, reason="no Fast Downward"),  # its import takes seconds
    pytest.mark.filterwarnings("ignore::UserWarning"),
]

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
    return Plan(tuple(PlanStep(a.action.name, tuple(map(str, a.actual_parameters))) for a in result.plan.actions))


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


@pytest.mark.parametrize("seed", range(0, PROBLEMS, 4))
def test_another_engine_in_place_of_our_search_gives_the_same_kind_of_answer(seed: int) -> None:
    problem = random_problem(seed)
    domain, objects, facts, goal = problem.domain, problem.objects, problem.facts, problem.goal
    ours = find_plan(domain, objects, facts, goal, {})
    theirs = engine_planner("fast-downward")(domain, objects, facts, goal, {})
    assert type(theirs) is type(ours)
    if isinstance(theirs, Plan):
        assert_reaches(theirs, domain, objects, facts, goal)
