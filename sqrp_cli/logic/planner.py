"""Planning with Fast-Forward: enforced hill climbing on the length of relaxed plans, then a complete search.

After Hoffmann and Nebel, "The FF Planning System: Fast Plan Generation Through Heuristic Search", Journal of Artificial
Intelligence Research 14, 2001. Negative preconditions are treated as facts of their own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from typing import TypeAlias

from sqrp_cli.logic.conditions import Binding, Objects, UnmetPart
from sqrp_cli.logic.domain import Condition, Domain
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.logic.planning_task import (
    BUDGET,
    NEVER,
    Budget,
    GaveUp,
    GroundAction,
    Need,
    PlanningTask,
    PlanStep,
    planning_task,
)
from sqrp_cli.records import dataclass

Plan: TypeAlias = tuple[PlanStep, ...]  # Steps that lead from the facts to the goal; none if it holds already


@dataclass(frozen=True)
class ProvenImpossible:
    """No plan exists."""

    never: tuple[UnmetPart, ...]
    """The parts of the goal that no sequence of actions can make true.

    Empty if each can be made true, but not all together, or if the budget did not suffice to tell them apart.
    """


_PLATEAU = 500  # States that hill climbing explores for an improvement before it counts as stuck
PlanningResult: TypeAlias = Plan | ProvenImpossible | GaveUp
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
            return ()
        search = _Search(task, budget, task.actions)
        layers, _ = search.relaxed(task.initial, NEVER)
        reachable = layers[-1]  # no other literals are
    except GaveUp as gave_up:
        return gave_up
    never = [part for part, need in task.goal_parts if not need.holds(reachable)]
    if task.goal.holds(reachable):
        search.actions = tuple(action for action in task.actions if action.need.holds(reachable))
        result = search.run(task.goal)
        if not isinstance(result, ProvenImpossible):
            return result
        again = _Search(task, budget, search.actions)
        never = [part for part, need in task.goal_parts if isinstance(again.run(need), ProvenImpossible)]
    texts = (part if isinstance(part, Literal) else part.text for part in never)
    return ProvenImpossible(tuple(dict.fromkeys(texts)))


_Estimate: TypeAlias = tuple[int, tuple[GroundAction, ...]]
"""Number of steps of a relaxed plan, and its helpful actions."""


@dataclass(eq=False)
class _Search:
    """Searches for plans from one state, until the budget for all of them is spent."""

    task: PlanningTask
    budget: Budget
    actions: tuple[GroundAction, ...] = ()
    states: int = 0
    trials: int = 0

    def try_actions(self, count: int) -> None:
        """Counts how many actions are tried in a state."""
        self.trials += count * (1 + self.task.initial.bit_length() // 500)
        if self.trials > self.budget.trials:
            raise GaveUp(f"{self.states:,} states and {len(self.task.actions):,} ground actions")

    def run(self, goal: Need) -> PlanningResult:
        """A plan for a goal."""
        try:
            found = self.climb(goal)
            if found is None:
                found = self.best_first(goal)
        except GaveUp as gave_up:
            return gave_up
        if found is None:
            return ProvenImpossible(())
        index = 0
        while index < len(found):  # each step that the goal does not need goes, with those that depend on it
            state, kept = self.task.initial, []
            for action in (*found[:index], *found[index + 1 :]):
                if action.need.holds(state):
                    state = action.after(state)
                    kept.append(action)
            found, index = (tuple(kept), index) if goal.holds(state) else (found, index + 1)
        return tuple(action.step for action in found)

    def climb(self, goal: Need) -> tuple[GroundAction, ...] | None:
        """Enforced hill climbing along helpful actions, always to the nearest better state; None at a dead end."""
        state, done = self.task.initial, tuple[GroundAction, ...]()
        best = self.estimate(state, goal)
        while best is not None and best[0] > 0:
            seen, queue, last = {state}, deque([(state, done, best)]), self.states + _PLATEAU
            better: tuple[int, tuple[GroundAction, ...], _Estimate] | None = None
            while queue and better is None and self.states <= last:
                state, done, (_, helpful) = queue.popleft()
                for action in helpful:
                    following = action.after(state)
                    found = self.estimate(following, goal) if following not in seen else None
                    seen.add(following)
                    if found is not None:
                        queue.append((following, (*done, action), found))
                        if found[0] < best[0]:
                            better = queue[-1]
                            break
            if better is None:
                return None
            state, done, best = better
        return None if best is None else done

    def best_first(self, goal: Need) -> tuple[GroundAction, ...] | None:
        """Greedy best-first search over all actions, helpful ones first among equals.

        None once every state that may lead to the goal was explored.
        """
        start = self.task.initial
        estimate = self.estimate(start, goal)
        came_from: dict[int, tuple[int, GroundAction] | None] = {start: None}
        queue = [(estimate[0], False, 0, start, estimate[1])] if estimate is not None else []
        while queue:
            steps, _, _, state, helpful = heappop(queue)
            if steps == 0:
                path: list[GroundAction] = []
                while (link := came_from[state]) is not None:
                    state, action = link
                    path.append(action)
                return tuple(reversed(path))
            self.try_actions(len(self.actions))
            for action in self.actions:
                if not action.need.holds(state) or (following := action.after(state)) in came_from:
                    continue
                came_from[following] = (state, action)
                if (found := self.estimate(following, goal)) is not None:
                    heappush(queue, (found[0], action not in helpful, len(came_from), following, found[1]))
        return None

    def estimate(self, state: int, goal: Need) -> _Estimate | None:
        """The relaxed plan from a state; None if there is none, which proves a dead end."""
        if self.states >= self.budget.states:
            raise GaveUp(f"{self.states:,} states")
        self.states += 1
        layers, new_actions = self.relaxed(state, goal)
        return _extract(goal, layers, new_actions) if goal.holds(layers[-1]) else None

    def relaxed(self, state: int, goal: Need) -> tuple[list[int], list[list[GroundAction]]]:
        """Literals after 0, 1, ... rounds in which nothing becomes false, until the goal holds or none of them is new.

        And the actions that became applicable in each round.
        """
        layers, new_actions = [state], list[list[GroundAction]]()
        waiting: Sequence[GroundAction] = self.actions
        while not goal.holds(layers[-1]):
            literals = layers[-1]
            self.try_actions(len(waiting))
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
                break
            layers.append(literals)
            new_actions.append(applicable)
        return layers, new_actions


def _extract(goal: Need, layers: list[int], new_actions: list[list[GroundAction]]) -> _Estimate:
    """A relaxed plan, backwards from the goal, by what `_Search.relaxed` gives."""

    def chosen(need: Need) -> int:
        """The literals that satisfy a condition earliest: its own, and those of the easiest alternatives."""
        bits = need.bits
        for choice in need.choices:
            possible = [alternative for alternative in choice if alternative.holds(layers[-1])]
            bits |= chosen(min(possible, key=lambda one: next(n for n, layer in enumerate(layers) if one.holds(layer))))
        return bits

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
            possible = [(chosen(one.need), one) for one in new_actions[level - 1] if one.gains & bit]
            # The easiest: by the sum, over the literals that it needs, of the layers in which they first appear.
            _, action = min(possible, key=lambda one: sum((one[0] & ~literals).bit_count() for literals in layers))
            steps += 1
            for done in range(level + 1):
                wanted[done] &= ~action.gains
            want(action.need)
    return steps, helpful
