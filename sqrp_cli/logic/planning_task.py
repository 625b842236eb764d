"""A ground planning problem, with sets of literals as bits of an integer.

Atom number i has two bits: bit 2 i for the atom, bit 2 i + 1 for its negation. A state has one of the two set for every
atom; a relaxed state, in which nothing becomes false, may have both.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import field
from math import prod

from sqrp_cli.logic import conditions
from sqrp_cli.logic.domain import EQUAL, Action, Compound, Condition, Domain, Holds
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.records import dataclass


@dataclass(frozen=True)
class PlanStep:
    """An action with the objects of its parameters, in order."""

    action: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.action}({', '.join(self.arguments)})"


@dataclass(frozen=True)
class Need:
    """A condition on sets of literals: all of `bits`, and one alternative of each choice."""

    bits: int
    choices: tuple[tuple[Need, ...], ...] = ()

    def holds(self, literals: int) -> bool:
        """Whether a set of literals satisfies it."""
        return not self.bits & ~literals and (
            not self.choices
            or all(any(alternative.holds(literals) for alternative in choice) for choice in self.choices)
        )


NEVER = Need(0, ((),))  # Holds for no set of literals


def joined(needs: Iterable[Need]) -> Need:
    """The conjunction."""
    bits = 0
    choices: list[tuple[Need, ...]] = []
    for need in needs:
        bits |= need.bits
        choices += need.choices
    return Need(bits, tuple(choices))


@dataclass(frozen=True, eq=False)
class GroundAction:
    """A step with its precondition and the literals that it makes true (`gains`) and false (`losses`)."""

    step: PlanStep
    need: Need
    gains: int
    losses: int

    def after(self, state: int) -> int:
        """The state after the step."""
        return state & ~self.losses | self.gains


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """The input of the search."""

    initial: int
    goal: Need
    goal_parts: tuple[tuple[conditions.GroundCondition, Need], ...]  # The conjuncts of the goal, each as bits
    actions: tuple[GroundAction, ...]


@dataclass(eq=False)
class GaveUp(Exception):  # noqa: N818 - an answer of planning, not its failure
    """Neither a plan nor a proof was found, as a limit is exceeded; raised on the way, and what planners return."""

    within: str
    """The spent budget, such as `20,000 states`."""
    why: str = ""
    """Why that is too little, if known, and how to change it."""


@dataclass(frozen=True)
class Budget:
    """Limits of the work, first of making the task, then of the search."""

    actions: int = 50_000  # Ground actions
    tried: int = 500_000  # Choices of objects that are tried, partial ones included
    literals: int = 1_000_000  # In all ground conditions together
    bits: int = 1_000_000_000  # Of all actions together, two for each atom
    states: int = 20_000  # That are explored
    trials: int = 20_000_000
    """Of an action in a state; one counts once more for every 500 bits of a state, because its time grows with them."""


BUDGET = Budget()  # What is usually spent


def planning_task(
    domain: Domain,
    objects: conditions.Objects,
    facts: frozenset[Atom],
    goal: Condition,
    binding: conditions.Binding,
    budget: Budget = BUDGET,
) -> PlanningTask:
    """Grounds actions and goal for the given objects.

    Actions with a precondition that contradicts unchangeable facts are left out. Raises GaveUp.
    """
    objects = {name: frozenset([type_name]) for name, type_name in domain.constants.items()} | dict(objects)
    sizes = {
        name: max(1, conditions.literal_count(action.precondition, objects, domain))
        for name, action in domain.actions.items()
    }
    largest = max([conditions.literal_count(goal, objects, domain), *sizes.values()])
    if largest > conditions.MAX_LITERALS:
        raise GaveUp(f"{conditions.MAX_LITERALS:,} literals", f"a single condition stands for {largest:,}")
    changeable = {use.predicate for action in domain.actions.values() for use in (*action.adds, *action.deletes)}
    grounder = _Grounder(objects, facts, changeable, domain, budget.tried)
    # All actions with all choices of objects are counted before one is grounded, which takes longer.
    bound_actions, literals = list[tuple[Action, conditions.Binding]](), 0
    for action in domain.actions.values():
        for bound in grounder.choices(action):
            bound_actions.append((action, bound))
            literals += sizes[action.name]
            if len(bound_actions) > budget.actions:
                raise GaveUp(f"{budget.actions:,} ground actions", grounder.why(action))
            if literals > budget.literals:
                raise GaveUp(f"{budget.literals:,} literals of ground actions", grounder.why(action))
    waiting = [conditions.ground_condition(goal, binding, objects, domain)]
    parts = list[tuple[conditions.GroundCondition, Need]]()
    while waiting:  # the conjuncts of the goal, from left to right
        part = waiting.pop(0)
        if isinstance(part, conditions.Joined) and part.every:
            waiting[:0] = part.parts
        else:
            parts.append((part, grounder.need(part, keep=True) or NEVER))
    actions = list[GroundAction]()
    for action, bound in bound_actions:
        if 2 * len(grounder.numbers) * len(actions) > budget.bits:
            raise GaveUp(f"{budget.bits:,} bits of ground actions", grounder.why(action))
        condition = conditions.ground_condition(action.precondition, bound, objects, domain)
        precondition = grounder.need(condition, keep=False)
        if precondition is not None:
            adds, deletes = (
                grounder.bits(Literal(conditions.ground_atom(use, bound)) for use in uses)
                for uses in (action.adds, action.deletes)
            )
            deletes &= ~adds
            step = PlanStep(action.name, tuple(bound[parameter.name] for parameter in action.parameters))
            actions.append(GroundAction(step, precondition, adds | deletes << 1, adds << 1 | deletes))
    initial = sum(1 << (2 * number + (atom not in facts)) for atom, number in grounder.numbers.items())
    return PlanningTask(initial, joined(need for _, need in parts), tuple(parts), tuple(actions))


@dataclass
class _Grounder:
    """Finds the bindings of actions, and puts conditions into bits: atoms are numbered in the order of their use."""

    objects: conditions.Objects
    facts: frozenset[Atom]
    changeable: Collection[str]
    domain: Domain
    limit: int  # How often an object may be tried for a parameter
    tried: int = 0
    numbers: dict[Atom, int] = field(default_factory=dict)

    def bits(self, literals: Iterable[Literal]) -> int:
        bits = 0
        for literal in literals:
            number = self.numbers.setdefault(literal.atom, len(self.numbers))
            bits |= 1 << (2 * number + (not literal.positive))
        return bits

    def need(self, condition: conditions.GroundCondition, keep: bool) -> Need | None:
        """The condition in bits, None if it can never hold.

        Literals that no action changes are decided at once, unless `keep`.
        """
        if isinstance(condition, Literal):
            if keep or condition.atom.predicate in self.changeable:
                return Need(self.bits([condition]))
            return Need(0) if (condition.atom in self.facts) == condition.positive else None
        possible = [need for part in condition.parts if (need := self.need(part, keep)) is not None]
        if condition.every:
            return joined(possible) if len(possible) == len(condition.parts) else None
        if any(need == Need(0) for need in possible):
            return Need(0)
        return Need(0, (tuple(possible),)) if len(possible) > 1 else next(iter(possible), None)

    def choices(self, action: Action) -> Iterator[conditions.Binding]:
        """The bindings of an action, without those in which an unchangeable fact contradicts the precondition."""
        names = [parameter.name for parameter in action.parameters]
        fitting = [conditions.fitting_objects(parameter, self.objects, self.domain) for parameter in action.parameters]
        # Of each parameter, the conjuncts that it decides and no action changes, and whether they are positive.
        ready: list[list[tuple[Holds, bool]]] = [[] for _ in names]
        conjuncts = [(action.precondition, True)]
        for part, positive in conjuncts:
            if isinstance(part, Compound):
                if part.kind == "not" or (part.kind == "and" and positive):
                    conjuncts += [(inner, positive != (part.kind == "not")) for inner in part.parts]
            elif part.predicate not in self.changeable and any(term.startswith("?") for term in part.terms):
                last = max(names.index(term[1:]) for term in part.terms if term.startswith("?"))
                ready[last].append((part, positive))

        def extend(bound: dict[str, str], index: int) -> Iterator[conditions.Binding]:
            if index == len(names):
                yield dict(bound)
                return
            for name in fitting[index]:
                self.tried += 1
                if self.tried > self.limit:
                    raise GaveUp(f"{self.limit:,} choices of objects", self.why(action))
                bound[names[index]] = name
                # No fact is an equality, which holds of one object and itself.
                pairs = ((conditions.ground_atom(part, bound), positive) for part, positive in ready[index])
                if all((one in self.facts or one == Atom(EQUAL, (name, name))) == positive for one, positive in pairs):
                    yield from extend(bound, index + 1)
            bound.pop(names[index], None)

        return extend({}, 0)

    def why(self, action: Action) -> str:
        """Why the task is large, and how to make it smaller."""
        count = prod(len(conditions.fitting_objects(one, self.objects, self.domain)) for one in action.parameters)
        return (
            f"the {len(action.parameters)} parameters of `{action.name}` ({action.place}) have {count:,} choices of"
            " objects; give them types that fewer objects have, or make several actions of it"
        )
