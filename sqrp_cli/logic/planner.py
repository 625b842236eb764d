"""Planning with Fast-Forward: enforced hill climbing on the length of relaxed plans, then a complete search.

After Hoffmann and Nebel, "The FF Planning System: Fast Plan Generation Through Heuristic Search", Journal of Artificial
Intelligence Research 14, 2001. Negative preconditions are treated as facts of their own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field
from heapq import heappop, heappush
from typing import NamedTuple, TypeAlias

from sqrp_cli.logic.conditions import Binding, Objects, Some, UnmetPart
from sqrp_cli.logic.domain import Condition, Domain
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.planning_task import (
    BUDGET,
    Budget,
    GroundAction,
    Need,
    OutOfBudgetError,
    PlanningTask,
    PlanStep,
    planning_task,
)
from sqrp_cli.records import dataclass


@dataclass(frozen=True)
class Plan:
    """Steps that lead from the facts to the goal."""

    steps: tuple[PlanStep, ...]


@dataclass(frozen=True)
class AlreadySatisfied:
    """The goal holds; nothing needs to be done."""


@dataclass(frozen=True)
class ProvenImpossible:
    """No plan exists."""

    never: tuple[UnmetPart, ...]
    """The parts of the goal that no sequence of actions can make true.

    Empty if each can be made true, but not all together, or if the budget did not suffice to tell them apart.
    """

    @classmethod
    def of(cls, parts: Iterable[Literal | Some]) -> ProvenImpossible:
        """With these parts of the ground goal, each once."""
        return cls(tuple(dict.fromkeys(part if isinstance(part, Literal) else part.text for part in parts)))


@dataclass(frozen=True)
class GaveUp:
    """Neither a plan nor a proof was found."""

    within: str
    """The spent budget, such as `20,000 states`."""
    why: str = field(default="", compare=False)
    """Why that is too little, if known, and how to change it."""


_PLATEAU = 500
"""States that hill climbing explores for an improvement before it counts as stuck."""

PlanningResult: TypeAlias = Plan | AlreadySatisfied | ProvenImpossible | GaveUp


Planner = Callable[[Domain, Objects, frozenset[Atom], Condition, Binding], PlanningResult]
"""Finds plans, as `find_plan` does."""


def find_plan(
    domain: Domain,
    objects: Objects,
    facts: frozenset[Atom],
    goal: Condition,
    binding: Binding,
    budget: Budget = BUDGET,
) -> PlanningResult:
    """A plan that makes the goal true, such as the precondition of a skill for one binding of its parameters.

    domain: with the usable actions, see `merge_domains`. facts: the atoms that hold now; every other atom is false.
    binding: objects for the free variables of the goal. The same input gives the same plan.
    """
    try:
        task = planning_task(domain, objects, facts, goal, binding, budget)
        if task.goal.holds(task.initial):
            return AlreadySatisfied()
        meter = _Meter(budget, task)
        reachable = _reachable(task, meter)
    except OutOfBudgetError as error:
        return GaveUp(error.within, error.why)
    if not task.goal.holds(reachable):
        return ProvenImpossible.of(part for part, need in task.goal_parts if not need.holds(reachable))
    actions = tuple(action for action in task.actions if action.need.holds(reachable))
    result = _Search(task.initial, task.goal, actions, meter).run()
    if not isinstance(result, ProvenImpossible):
        return result
    meter = _Meter(budget, task)
    alone = [(part, _Search(task.initial, need, actions, meter).run()) for part, need in task.goal_parts]
    return ProvenImpossible.of(part for part, outcome in alone if isinstance(outcome, ProvenImpossible))


@dataclass
class _Meter:
    """Counts the work, and ends it when the budget is spent."""

    budget: Budget
    task: PlanningTask
    states: int = 0
    trials: int = 0

    def look_at_state(self) -> None:
        if self.states >= self.budget.states:
            raise OutOfBudgetError(f"{self.states:,} states")
        self.states += 1

    def try_actions(self, count: int) -> None:
        self.trials += count * (1 + self.task.initial.bit_length() // 500)
        if self.trials > self.budget.trials:
            raise OutOfBudgetError(f"{self.states:,} states and {len(self.task.actions):,} ground actions")


def _reachable(task: PlanningTask, meter: _Meter) -> int:
    """The literals reachable in the relaxed problem, in which nothing becomes false; no others are reachable."""
    literals, waiting = task.initial, list(task.actions)
    while True:
        before = literals
        meter.try_actions(len(waiting))
        for action in waiting:
            if action.need.holds(before):
                literals |= action.gains
        if literals == before:
            return literals
        waiting = [action for action in waiting if not action.need.holds(before)]


class _Estimate(NamedTuple):
    """Number of steps of a relaxed plan, and its helpful actions."""

    steps: int
    helpful: tuple[GroundAction, ...]


@dataclass(frozen=True, eq=False)
class _Search:
    """One search for a plan."""

    initial: int
    goal: Need
    actions: tuple[GroundAction, ...]
    meter: _Meter

    def run(self) -> PlanningResult:
        try:
            found = self.climb()
            if found is None:
                found = self.best_first()
        except OutOfBudgetError as error:
            return GaveUp(error.within)
        if found is None:
            return ProvenImpossible(())
        index = 0
        while index < len(found):  # each step that the goal does not need goes, with those that depend on it
            state, kept = self.initial, []
            for action in (*found[:index], *found[index + 1 :]):
                if action.need.holds(state):
                    state = action.after(state)
                    kept.append(action)
            found, index = (tuple(kept), index) if self.goal.holds(state) else (found, index + 1)
        return Plan(tuple(action.step for action in found))

    def climb(self) -> tuple[GroundAction, ...] | None:
        """Enforced hill climbing along helpful actions, always to the nearest better state; None at a dead end."""
        best, state, done = self.estimate(self.initial), self.initial, tuple[GroundAction, ...]()
        while best is not None and best.steps > 0:
            seen, queue, last = {state}, deque([(state, done, best)]), self.meter.states + _PLATEAU
            better: tuple[int, tuple[GroundAction, ...], _Estimate] | None = None
            while queue and better is None and self.meter.states <= last:
                state, done, estimate = queue.popleft()
                for action in estimate.helpful:
                    following = action.after(state)
                    found = self.estimate(following) if following not in seen else None
                    seen.add(following)
                    if found is not None:
                        queue.append((following, (*done, action), found))
                        if found.steps < best.steps:
                            better = queue[-1]
                            break
            if better is None:
                return None
            state, done, best = better
        return None if best is None else done

    def best_first(self) -> tuple[GroundAction, ...] | None:
        """Greedy best-first search over all actions, helpful ones first among equals.

        None once every state that may lead to the goal was explored.
        """
        start = self.initial
        estimate = self.estimate(start)
        if estimate is None:
            return None
        came_from: dict[int, tuple[int, GroundAction] | None] = {start: None}
        queue = [(estimate.steps, False, 0, start, estimate.helpful)]
        while queue:
            steps, _, _, state, helpful = heappop(queue)
            if steps == 0:
                path: list[GroundAction] = []
                while (link := came_from[state]) is not None:
                    state, action = link
                    path.append(action)
                return tuple(reversed(path))
            self.meter.try_actions(len(self.actions))
            for action in self.actions:
                if not action.need.holds(state):
                    continue
                following = action.after(state)
                if following in came_from:
                    continue
                came_from[following] = (state, action)
                found = self.estimate(following)
                if found is not None:
                    unhelpful = action not in helpful
                    heappush(queue, (found.steps, unhelpful, len(came_from), following, found.helpful))
        return None

    def estimate(self, state: int) -> _Estimate | None:
        """The relaxed plan from a state; None if there is none, which proves a dead end."""
        self.meter.look_at_state()
        layers, new_actions = [state], []
        waiting: Sequence[GroundAction] = self.actions
        while not self.goal.holds(layers[-1]):
            literals = layers[-1]
            self.meter.try_actions(len(waiting))
            missing = ~literals
            applicable, later = [], []
            for action in waiting:
                need = action.need
                if need.bits & missing or (need.choices and not need.holds(literals)):
                    later.append(action)
                else:
                    applicable.append(action)
            waiting = later
            for action in applicable:
                literals |= action.gains
            if literals == layers[-1]:
                return None
            layers.append(literals)
            new_actions.append(applicable)
        return _extract(self.goal, layers, new_actions)


def _extract(goal: Need, layers: list[int], new_actions: list[list[GroundAction]]) -> _Estimate:
    """A relaxed plan, backwards from the goal.

    layers: literals after 0, 1, ... rounds of relaxed actions. new_actions: those that became applicable in each layer.
    """

    def chosen(need: Need) -> int:
        """The literals that satisfy a condition earliest: its own, and those of the easiest alternatives."""
        bits = need.bits
        for choice in need.choices:
            possible = [alternative for alternative in choice if alternative.holds(layers[-1])]
            bits |= chosen(min(possible, key=lambda one: next(n for n, layer in enumerate(layers) if one.holds(layer))))
        return bits

    def difficulty(action: GroundAction) -> int:
        """Sum over the literals that it needs of the layers in which they first appear."""
        bits = chosen(action.need)
        return sum((bits & ~literals).bit_count() for literals in layers)

    def want(need: Need) -> None:
        bits = chosen(need)
        for level, literals in enumerate(layers):
            wanted[level] |= bits & literals
            bits &= ~literals

    wanted, steps, helpful = [0] * len(layers), 0, tuple[GroundAction, ...]()
    want(goal)
    for level in range(len(layers) - 1, 0, -1):
        if level == 1:
            helpful = tuple(action for action in new_actions[0] if action.gains & wanted[1])
        while wanted[level]:
            bit = wanted[level] & -wanted[level]
            action = min((one for one in new_actions[level - 1] if one.gains & bit), key=difficulty)
            steps += 1
            for done in range(level + 1):
                wanted[done] &= ~action.gains
            want(action.need)
    return _Estimate(steps, helpful)
