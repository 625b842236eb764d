"""Joint paths around obstacles by random sampling. The only module that knows OMPL.

The planner: J. J. Kuffner, S. M. LaValle, RRT-Connect: An efficient approach to single-query path planning, 2000.
"""

from __future__ import annotations

from collections.abc import Callable

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
    n, asked = len(q0), 0
    lower = np.maximum(bounds[0], np.minimum(q0, q1) - MARGIN) * scale
    upper = np.minimum(bounds[1], np.maximum(q0, q1) + MARGIN) * scale

    def joints(state: base.State) -> Array:
        return np.array([state[j] for j in range(n)]) / scale

    class Validator(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, first: base.State, second: base.State) -> bool:
            nonlocal asked
            if asked >= tries:
                return False
            asked += 1
            return is_free(joints(first), joints(second))

    space = base.RealVectorStateSpace(n)
    limits = base.RealVectorBounds(n)
    for j in range(n):
        limits.setLow(j, float(min(lower[j], q0[j] * scale[j], q1[j] * scale[j])))
        limits.setHigh(j, float(max(upper[j], q0[j] * scale[j], q1[j] * scale[j])))
    space.setBounds(limits)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    validator = Validator(information)
    information.setMotionValidator(validator)
    information.setup()
    problem = base.ProblemDefinition(information)
    ends = [space.allocState(), space.allocState()]
    for state, q in zip(ends, (q0, q1), strict=True):
        for j in range(n):
            state[j] = float(q[j] * scale[j])
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(LONGEST_EDGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: asked >= tries))
    if not problem.hasExactSolution():
        return None
    corners = np.array([joints(state) for state in problem.getSolutionPath().getStates()])
    corners[0], corners[-1] = q0, q1
    return corners
