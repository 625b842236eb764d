"""Problems too large to be solved: that is told from their numbers before the work, or after little of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.logic import planning_task
from sqrp_cli.logic.conditions import GroundCondition, Joined, ground_condition, literal_count
from sqrp_cli.logic.domain import Compound, Condition, Domain, Holds, Parameter
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.pddl_parser import parse_domain
from sqrp_cli.logic.planner import find_plan
from sqrp_cli.logic.planning_task import Budget, GaveUp

NEEDS = "(:requirements :negative-preconditions :universal-preconditions)"
FIFTEEN = " ".join(f"?p{number}" for number in range(15))
GOAL = Holds("done", ())


def read(actions: str) -> Domain:
    text = f"(define (domain d) {NEEDS} (:predicates (on ?x ?y) (at ?x) (free ?x) (done))\n{actions})"
    return parse_domain(text, Path("large.pddl"))


@pytest.mark.parametrize(
    ("actions", "within", "why"),
    [
        (
            f"(:action big :parameters ({FIFTEEN}) :precondition (at ?p0) :effect (and (done) (at ?p14)))",
            "50,000 ground actions",
            "the 15 parameters of `big` (large.pddl:2:10) have 30,517,578,125 choices",
        ),
        (
            f"(:action big :parameters ({FIFTEEN}) :precondition (free ?p14) :effect (done))",
            "500,000 choices of objects",
            "the 15 parameters of `big` (large.pddl:2:10) have 30,517,578,125 choices",
        ),
        (
            f"(:action big :parameters () :precondition (forall ({FIFTEEN}) (at ?p3)) :effect (done))",
            "50,000 literals",
            "30,517,578,125",
        ),
        (
            """(:action big :parameters (?p ?q ?r ?s ?t) :precondition (forall (?a ?b ?c ?d) (not (on ?a ?p)))
              :effect (and (on ?p ?q) (done)))""",
            "1,000,000 literals of ground actions",
            "the 5 parameters of `big`",
        ),
    ],
)
def test_planning_gives_up_before_it_grounds_and_says_which_action_is_too_large(
    actions: str, within: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_goal_only(condition: Condition, *rest: Any) -> GroundCondition:
        assert condition is GOAL, "an action was grounded"
        return ground_condition(condition, *rest)

    monkeypatch.setattr(planning_task.conditions, "ground_condition", of_goal_only)
    objects = {f"o{number}": frozenset({"thing"}) for number in range(5)}
    result = find_plan(read(actions), objects, frozenset({Atom("at", ("o0",))}), GOAL, {})
    assert isinstance(result, GaveUp)
    assert result.within == within
    assert why in result.why


def test_a_search_among_many_actions_ends_after_few_states() -> None:
    domain = read("""
      (:action move :parameters (?x ?y ?z) :precondition (and (on ?x ?y) (not (on ?y ?z)))
       :effect (and (on ?y ?z) (not (on ?x ?y))))
      (:action note :parameters (?x) :precondition (forall (?y) (on ?x ?y)) :effect (free ?x))
      (:action end :parameters (?x) :precondition (and (on ?x ?x) (free ?x)) :effect (done))""")
    objects = {f"o{number}": frozenset({"thing"}) for number in range(24)}
    budget = Budget(trials=2_000_000)
    result = find_plan(domain, objects, frozenset({Atom("on", ("o0", "o1"))}), GOAL, {}, budget)
    assert isinstance(result, GaveUp)
    states, _, rest = result.within.partition(" ")
    assert rest == "states and 13,872 ground actions"
    assert 0 < int(states.replace(",", "")) * 13_872 <= budget.trials


PREDICATES = st.sampled_from([Holds("at", ("?x",)), GOAL])
VARIABLES = st.lists(st.sampled_from([Parameter("x"), Parameter("y"), Parameter("z", "cube")]), min_size=1, max_size=2)
CONDITIONS: st.SearchStrategy[Condition] = st.recursive(
    PREDICATES,
    lambda parts: st.one_of(
        st.builds(Compound, st.just("not"), st.tuples(parts)),
        st.builds(Compound, st.sampled_from(["and", "or"]), st.lists(parts, max_size=3).map(tuple)),
        st.builds(Compound, st.sampled_from(["forall", "exists"]), st.tuples(parts), VARIABLES.map(tuple)),
    ),
    max_leaves=6,
)


@given(CONDITIONS, st.integers(0, 3), st.integers(0, 2))
def test_the_number_of_literals_is_reported_without_making_them(condition: Condition, cubes: int, others: int) -> None:
    objects = {f"c{number}": frozenset({"cube"}) for number in range(cubes)}
    objects |= {f"o{number}": frozenset({"thing"}) for number in range(others)}
    typed = "(:requirements :typing) (:types cube) (:predicates (p))"
    domain = parse_domain(f"(define (domain d) {typed} (:action a :parameters () :effect (p)))", Path("d.pddl"))
    made = ground_condition(condition, {"x": "a"}, objects, domain)

    def count(made: GroundCondition) -> int:
        return sum(map(count, made.parts)) if isinstance(made, Joined) else 1

    assert literal_count(condition, objects, domain) == count(made)
