"""Planning with any engine of the unified-planning library in place of the search in `planner`.

The engine gets the ground planning task, so it needs neither types nor quantifiers; its plan is checked. The library
comes with the extra `planners`, engines with their own packages.
"""

from __future__ import annotations

import contextlib
import tempfile
from typing import Any

from sqrp_cli.errors import bad_input, expected_names, needed
from sqrp_cli.logic.conditions import Binding, Objects
from sqrp_cli.logic.domain import Condition, Domain
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import Planner, PlanningResult, ProvenImpossible
from sqrp_cli.logic.planning_task import GaveUp, Need, PlanningTask, planning_task

TIME_LIMIT = 60.0  # Time limit of an engine [s]


def engine_planner(name: str) -> Planner:
    """A planner that uses the engine `name`.

    Raises InputError if the library is not installed or knows no such engine.
    """
    with needed("other planners need the extra `planners`", "pip install unified-planning up-fast-downward"):
        from unified_planning.engines import PlanGenerationResultStatus as Status
        from unified_planning.environment import get_environment
    environment = get_environment()
    environment.credits_stream = None
    engines = [
        engine
        for engine in environment.factory.engines
        if ("[" not in engine and bool(environment.factory.engine(engine).is_oneshot_planner()))
    ]
    if name not in engines:
        mend = None if engines else "pip install up-fast-downward, which brings `fast-downward`"
        message = f"there is no planner `{name}`; {expected_names(name, engines) if engines else 'none is installed'}"
        raise bad_input("unknown-planner", message, mend=mend)

    def plan(
        domain: Domain, objects: Objects, facts: frozenset[Atom], goal: Condition, binding: Binding
    ) -> PlanningResult:
        try:
            task = planning_task(domain, objects, facts, goal, binding)
        except GaveUp as gave_up:
            return gave_up
        if task.goal.holds(task.initial):
            return ()
        problem = _problem(environment, task)
        with environment.factory.OneshotPlanner(name=name) as planner:
            if not planner.supports(problem.kind):
                message = f"the planner `{name}` cannot plan with negative or disjunctive conditions, as needed here"
                raise bad_input("planner-too-weak", message, mend="leave --planner out")
            # Engines write files in the working folder; two at once would read each other's.
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                result = planner.solve(problem, timeout=TIME_LIMIT)
        if result.plan is not None:
            numbers = (int(instance.action.name.removeprefix("a")) for instance in result.plan.actions)
            # The plan of these steps. Raises InputError for one that is wrong.
            steps = [task.actions[number] for number in numbers]
            state = task.initial
            for step in steps:
                if not step.need.holds(state):
                    raise bad_input("wrong-plan", f"`{name}` returned a plan whose step {step.step} is impossible")
                state = step.after(state)
            if not task.goal.holds(state):
                message = f"the planner `{name}` returned a plan that is wrong: it does not reach the goal"
                raise bad_input("wrong-plan", message, mend="leave --planner out")
            return tuple(step.step for step in steps)
        match result.status:
            case Status.UNSOLVABLE_PROVEN:
                return ProvenImpossible(())
            case Status.UNSOLVABLE_INCOMPLETELY:
                return GaveUp(f"the incomplete search of `{name}`")
            case Status.TIMEOUT | Status.MEMOUT:
                return GaveUp(f"{TIME_LIMIT:g} s by `{name}`")
        message = f"the planner `{name}` failed: {result.status.name.lower().replace('_', ' ')}"
        raise bad_input("planner-failed", message, mend="leave --planner out")

    return plan


def _problem(environment: Any, task: PlanningTask) -> Any:  # noqa: ANN401
    """The task as a problem of the library; action number i is called `a<i>`."""
    from unified_planning.model import InstantaneousAction, Problem
    from unified_planning.shortcuts import BoolType

    problem = Problem("task", environment)
    fluents = []
    for number in range(task.initial.bit_count()):
        holds = bool(task.initial >> 2 * number & 1)
        fluents.append(problem.add_fluent(f"f{number}", BoolType(), default_initial_value=holds))
    manager = environment.expression_manager
    every = [one for fluent in fluents for one in (fluent(), manager.Not(fluent()))]  # the literals, by bit

    def expression(need: Need) -> Any:  # noqa: ANN401
        literals = [one for bit, one in enumerate(every) if need.bits >> bit & 1]
        choices = [manager.Or(map(expression, choice)) for choice in need.choices]
        return manager.And([*literals, *choices])

    for index, action in enumerate(task.actions):
        added = InstantaneousAction(f"a{index}", _env=environment)
        added.add_precondition(expression(action.need))
        for bit in range(len(every)):
            if action.gains >> bit & 1:
                added.add_effect(fluents[bit // 2], bit % 2 == 0)
        problem.add_action(added)
    problem.add_goal(expression(task.goal))
    return problem
