"""Joint paths around obstacles by random sampling. The only module that knows OMPL.

The planner: J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to single-query path planning, 2000.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array

MARGIN = np.pi
"""How far beyond both ends of a way its joints may go, within their limits [rad or m]."""

LONGEST_EDGE = 0.6
"""Longest straight piece that the planner adds at once, in the units of the scaled joints [m]."""


def plan_polyline(
    q0: Array,
    q1: Array,
    bounds: tuple[Array, Array],
    scale: Array,
    is_free: Callable[[Array, Array], bool],
    tries: int,
    seed: int,
) -> Array | None:
    """Corners of a polyline from q0 to q1, shape (n,), whose pieces are all free, ends included, shape (k, n).

    bounds: lower and upper limits of the joints, shape (n,) each. scale: what makes joints comparable, shape (n,):
    distances are those of q * scale. is_free: whether the straight line between two joint positions can be taken; it
    is asked about `tries` times at most. None if no polyline was found by then, which does not prove that there is
    none. The result depends on the arguments alone.
    """
    from ompl import base, geometric, util

    util.noOutputHandler()
    util.RNG.setSeed(seed + 1)  # OMPL takes 0 for no seed; what is made from here on is seeded by it
    asked = 0

    def asked_is_free(first: Array, second: Array) -> bool:
        nonlocal asked
        asked += 1
        return is_free(first / scale, second / scale)

    space = _space(q0 * scale, q1 * scale, bounds[0] * scale, bounds[1] * scale, MARGIN * scale)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    validator = _validator(information, lambda first, second: asked < tries and asked_is_free(first, second), len(q0))
    information.setMotionValidator(validator)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, q0 * scale), _state(space, q1 * scale))
    planner = geometric.RRTConnect(information)
    planner.setRange(LONGEST_EDGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: asked >= tries))
    if not problem.hasExactSolution():
        return None
    corners = np.stack([_values(state, len(q0)) for state in problem.getSolutionPath().getStates()]) / scale
    corners[0], corners[-1] = q0, q1
    return corners


def _space(start: Array, goal: Array, lower: Array, upper: Array, margin: Array) -> Any:  # noqa: ANN401
    """The box of scaled joint positions within the limits, up to a margin around start and goal, which it contains."""
    from ompl import base

    low = np.minimum(np.maximum(lower, np.minimum(start, goal) - margin), np.minimum(start, goal))
    high = np.maximum(np.minimum(upper, np.maximum(start, goal) + margin), np.maximum(start, goal))
    space = base.RealVectorStateSpace(len(start))
    limits = base.RealVectorBounds(len(start))
    for j, (least, most) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        limits.setLow(j, least)
        limits.setHigh(j, most)
    space.setBounds(limits)
    return space


def _validator(information: Any, is_free: Callable[[Array, Array], bool], n: int) -> Any:  # noqa: ANN401
    """What tells OMPL whether a straight line between two states of n values can be taken."""
    from ompl import base

    class Validator(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, first: base.State, second: base.State) -> bool:
            return is_free(_values(first, n), _values(second, n))

    return Validator(information)


def _state(space: Any, values: Array) -> Any:  # noqa: ANN401
    """A state of OMPL with these values, shape (n,)."""
    state = space.allocState()
    for j, value in enumerate(values.tolist()):
        state[j] = value
    return state


def _values(state: Any, n: int) -> Array:  # noqa: ANN401
    """The values of a state of OMPL, shape (n,)."""
    return np.array([state[j] for j in range(n)])
