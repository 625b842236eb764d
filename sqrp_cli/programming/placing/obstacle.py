"""Why no cameras can be chosen at all, with figures."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, Indices
from sqrp_cli.programming.placing.problem import Demand, Placing


def obstacle(problem: Placing, demand: Demand, *, blind: bool) -> str:
    """Why not even the fewest cameras that are needed can be chosen, in one sentence.

    blind: whether some can, but see nothing that counts.
    """
    if blind:
        fails = ", if one of them fails" if demand.survive else ""
        return f"all qualities of all candidates would stay 0.0 %{fails}"
    free = np.array([option for option in range(problem.count) if option not in problem.kept], dtype=np.int64)
    places = len(np.unique(problem.spot[free]))
    if not len(free):
        return "at none of the mounts is there a direction for a camera to look in"
    usable = _usable(problem, free)
    if not len(usable):
        mounts = "the only mount is" if places == 1 else f"all {places} mounts are"
        return f"{mounts} in the way: a camera there would touch something"
    needed = max(problem.at_least(demand), 1)
    prices = _cheapest(problem, usable)
    for count, total in enumerate(np.cumsum(prices[:needed]).tolist(), 1):
        if demand.budget is not None and total > demand.budget + 1e-9:
            cheapest = "the cheapest camera costs" if count == 1 else f"the cheapest {count} cameras cost"
            return f"{cheapest} {total:g}, the budget is {demand.budget:g}"
    reason = "" if demand.floor is None else f", and {demand.floor.reason}"
    if len(prices) < needed:
        return f"of {places} mounts only {len(prices)} can be used{reason}"
    return f"no {needed} of the mounts can be used together: cameras there touch or hide each other{reason}"


def unusable(problem: Placing) -> frozenset[int]:
    """The places where a camera is in the way of a candidate in all of its ways."""
    every = [{place for place, way in problem.blocked if way == number} for number in range(len(problem.cover.ways))]
    return frozenset(
        place for of_one in problem.candidates for place in set.intersection(*(every[number] for number in of_one))
    )


def _usable(problem: Placing, free: Indices) -> Indices:
    found: Indices = free[~np.isin(problem.spot[free], sorted(unusable(problem)))]
    return found


def _cheapest(problem: Placing, usable: Indices) -> Array:
    """The price of the cheapest camera at each place, the least first, shape (places,)."""
    places = problem.spot[usable]
    return np.sort([problem.price[usable][places == place].min() for place in np.unique(places)])
