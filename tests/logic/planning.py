"""Planning problems for tests, and what the definition of PDDL says of them."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

from sqrp_cli.logic.domain import Compound, Condition, Domain, Holds
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.pddl_parser import parse_domain
from sqrp_cli.logic.planner import PlanningResult
from sqrp_cli.logic.planning_task import PlanStep

Facts = frozenset[tuple[str, ...]]
Objects = Mapping[str, frozenset[str]]


def named(terms: tuple[str, ...], names: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(names[term.removeprefix("?")] if term.startswith("?") else term for term in terms)


class Simulator:
    """What a domain's actions do, worked out from the definition of PDDL on tuples of words."""

    def __init__(self, domain: Domain, objects: Objects) -> None:
        self.domain = domain
        self.objects = {name: {above for t in types for above in self.up(t)} for name, types in objects.items()}

    def up(self, type_name: str | None) -> set[str]:
        found = {"object"}
        while type_name is not None and type_name not in found:
            found.add(type_name)
            type_name = self.domain.types.get(type_name)
        return found

    def of_type(self, type_name: str) -> list[str]:
        return [name for name, types in self.objects.items() if type_name in types]

    def true(self, condition: Condition, names: Mapping[str, str], facts: Facts) -> bool:
        if isinstance(condition, Holds):
            terms = named(condition.terms, names)
            return terms[0] == terms[1] if condition.predicate == "=" else (condition.predicate, *terms) in facts
        if condition.kind == "not":
            return not self.true(condition.parts[0], names, facts)
        choices = product(*(self.of_type(variable.type) for variable in condition.variables))
        keys = [variable.name for variable in condition.variables]
        bindings = [{**names, **dict(zip(keys, choice, strict=True))} for choice in choices]
        found = [self.true(part, binding, facts) for binding in bindings for part in condition.parts]
        return all(found) if condition.kind in ("and", "forall") else any(found)

    def act(self, step: PlanStep, facts: Facts) -> Facts:
        action = self.domain.actions[step.action]
        names = dict(zip([parameter.name for parameter in action.parameters], step.arguments, strict=True))
        assert all(names[p.name] in self.of_type(p.type) for p in action.parameters)
        assert self.true(action.precondition, names, facts), f"{step} is not possible"

        def changed(changes: tuple[Holds, ...]) -> Facts:
            return frozenset((change.predicate, *named(change.terms, names)) for change in changes)

        return (facts - changed(action.deletes)) | changed(action.adds)

    def steps(self) -> list[PlanStep]:
        return [
            PlanStep(action.name, chosen)
            for action in self.domain.actions.values()
            for chosen in product(*(self.of_type(parameter.type) for parameter in action.parameters))
        ]

    def solvable(self, facts: Facts, goal: Condition) -> bool:
        """By looking at every state that can be reached."""
        seen, waiting = {facts}, [facts]
        while waiting:
            state = waiting.pop()
            if self.true(goal, {}, state):
                return True
            for step in self.steps():
                try:
                    following = self.act(step, state)
                except AssertionError:
                    continue
                if following not in seen:
                    seen.add(following)
                    waiting.append(following)
        return False


def read(text: str) -> Domain:
    return parse_domain(text, Path("domain.pddl"))


def atom(text: str) -> Atom:
    name, *arguments = text.split()
    return Atom(name, tuple(arguments))


def words(facts: frozenset[Atom]) -> Facts:
    return frozenset((atom.predicate, *atom.arguments) for atom in facts)


def assert_reaches(
    result: PlanningResult, domain: Domain, objects: Objects, facts: frozenset[Atom], goal: Condition
) -> None:
    assert isinstance(result, tuple)
    simulator, state = Simulator(domain, objects), words(facts)
    for step in result:
        state = simulator.act(step, state)
    assert simulator.true(goal, {}, state)


def goal_of(*texts: str) -> Condition:
    parts: list[Condition] = []
    for text in texts:
        wanted = atom(text.removeprefix("not "))
        use = Holds(wanted.predicate, wanted.arguments)
        parts.append(Compound("not", (use,)) if text.startswith("not ") else use)
    return Compound("and", tuple(parts))


TOWERS = read("""(define (domain towers)
  (:requirements :typing :negative-preconditions)
  (:types cube)
  (:predicates (on ?a ?b - cube) (on_table ?a - cube) (hold ?a - cube) (hand_full) (covered ?a - cube))
  (:action pick :parameters (?a - cube)
    :precondition (and (on_table ?a) (not (covered ?a)) (not (hand_full)))
    :effect (and (hold ?a) (hand_full) (not (on_table ?a))))
  (:action place :parameters (?a - cube)
    :precondition (hold ?a)
    :effect (and (on_table ?a) (not (hand_full)) (not (hold ?a))))
  (:action stack :parameters (?a ?b - cube)
    :precondition (and (hold ?a) (not (covered ?b)) (not (hold ?b)))
    :effect (and (on ?a ?b) (covered ?b) (not (hand_full)) (not (hold ?a))))
  (:action unstack :parameters (?a ?b - cube)
    :precondition (and (on ?a ?b) (not (covered ?a)) (not (hand_full)))
    :effect (and (hold ?a) (hand_full) (not (covered ?b)) (not (on ?a ?b)))))""")


def towers(*stacks: str) -> frozenset[Atom]:
    """Facts of towers of cubes a, b, c, ..., each written from the bottom up."""
    facts = {Atom("on_table", (stack[0],)) for stack in stacks}
    for stack in stacks:
        for below, above in pairwise(stack):
            facts |= {Atom("on", (above, below)), Atom("covered", (below,))}
    return frozenset(facts)


def goal_towers(*stacks: str) -> Condition:
    uses = sorted(fact for fact in towers(*stacks) if fact.predicate != "covered")
    return Compound("and", tuple(Holds(fact.predicate, fact.arguments) for fact in uses))


def random_domain(rng: random.Random) -> str:
    """The text of a domain with negation, equality, disjunctions and quantifiers in its preconditions."""
    predicates = {"p": 1, "q": 1, "r": 2, "s": 0}

    def use(variables: list[str]) -> str:
        name = rng.choice(list(predicates))
        return f"({' '.join([name, *rng.choices(variables, k=predicates[name])])})"

    def condition(variables: list[str], depth: int) -> str:
        kind = rng.choice(
            ["atom", "atom", "not", "not", "or", "forall", "exists", "equal"] if depth else ["atom", "not"]
        )
        match kind:
            case "atom":
                return use(variables)
            case "not":
                return f"(not {use(variables)})"
            case "or":
                return f"(or {condition(variables, depth - 1)} {condition(variables, depth - 1)})"
            case "equal":
                return rng.choice(["(not (= {} {}))", "(= {} {})"]).format(*rng.choices(variables, k=2))
        return f"({kind} (?z{depth}) {condition([*variables, f'?z{depth}'], depth - 1)})"

    actions = []
    for number in range(rng.randint(2, 4)):
        variables = ["?x", "?y"][: rng.randint(1, 2)]
        needs = " ".join(condition(variables, 2) for _ in range(rng.randint(1, 3)))
        changes = {use(variables): rng.random() < 0.5 for _ in range(rng.randint(1, 3))}
        effect = " ".join(change if positive else f"(not {change})" for change, positive in changes.items())
        parameters = " ".join(variables)
        actions.append(
            f"(:action a{number} :parameters ({parameters}) :precondition (and {needs}) :effect (and {effect}))"
        )
    requirements = ":negative-preconditions :equality :disjunctive-preconditions :quantified-preconditions"
    head = f"(define (domain random) (:requirements {requirements}) (:predicates (p ?x) (q ?x) (r ?x ?y) (s))"
    return f"{head}\n" + "\n".join(actions) + ")"


@dataclass(frozen=True)
class Problem:
    """A domain as text with objects of type `object`, facts, and literals to reach, such as `not r m n`."""

    text: str
    objects: Objects
    facts: frozenset[Atom]
    literals: tuple[str, ...]

    @property
    def domain(self) -> Domain:
        return read(self.text)

    @property
    def goal(self) -> Condition:
        return goal_of(*self.literals)


def random_problem(seed: int) -> Problem:
    """A problem with two objects; about half of them can be solved."""
    rng = random.Random(seed)  # noqa: S311
    atoms = [Atom("s"), *(Atom(name, (x,)) for name in "pq" for x in "mn")]
    atoms += [Atom("r", (x, y)) for x in "mn" for y in "mn"]
    text = random_domain(rng)
    facts = frozenset(rng.sample(atoms, rng.randint(0, 5)))
    wanted = rng.sample(atoms, rng.randint(2, 4))
    literals = tuple("not " * rng.randint(0, 1) + " ".join([a.predicate, *a.arguments]) for a in wanted)
    return Problem(text, {name: frozenset({"object"}) for name in "mn"}, facts, literals)
