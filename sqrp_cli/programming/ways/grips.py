"""The choices of what a candidate leaves free, other than branches: sides, yaws, and stops at home."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import gcd

import numpy as np

from sqrp_cli.knowledge.skill.settings import ANY, DIRECT, FIRST_NUMBER, FIRST_SIDE, MotionValue, Reference, side_of
from sqrp_cli.knowledge.skill.skill import HOME, GraspWaypoint, PutWaypoint, Skill
from sqrp_cli.knowledge.text.entries import Entry
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.motion.waypoints import setting_value
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.symmetry import ROUND, equal_sides, equal_turns, part_turns, tool_turns
from sqrp_cli.programming.whole_task import whole_candidate

_Values = Mapping[str, MotionValue]


def first_grip(candidate: Candidate) -> Candidate:
    """The candidate with the first choice of all that it leaves free, other than branches and paths."""
    if candidate.steps:
        return whole_candidate(candidate.skill, [first_grip(step) for step in candidate.steps])
    first = {
        parameter: choice
        for setting, choice in (("side", FIRST_SIDE), ("yaw", FIRST_NUMBER), ("via", DIRECT))
        for parameter in _free(candidate.skill, setting, candidate.values)
    }
    return _with(candidate, first) if first else candidate


def grips(cell: Cell, candidate: Candidate, world: World) -> tuple[Candidate, ...]:
    """The candidate with each combination of the sides, yaws and stops that it leaves free, the first choices first.

    A side or a yaw is a choice if the object looks there to the tool as it does at the first one: by the symmetry of
    the part, and for a round tool at every yaw. A stop at home is none for a robot that is there.
    """
    found = [candidate]
    found = [_with(one, values) for one in found for values in _sides(cell, one)]
    found = [_with(one, values) for one in found for values in _yaws(cell, one)]
    return tuple(_with(one, values) for one in found for values in _stops(cell, one, world))


def _sides(cell: Cell, candidate: Candidate) -> Iterator[_Values]:
    """The sides of a grasped object that look the same."""
    objects = cell.workspace.objects
    return _combined(
        {
            parameter: _common(
                equal_sides(objects[candidate.binding[part.object]])
                for part in parts
                if isinstance(part, GraspWaypoint)
            )
            for parameter, parts in _free(candidate.skill, "side", candidate.values).items()
        }
    )


def _yaws(cell: Cell, candidate: Candidate) -> Iterator[_Values]:
    """The yaws at which what is grasped or put looks the same."""

    def turns(part: Entry) -> int:
        objects, binding = cell.workspace.objects, candidate.binding
        if isinstance(part, GraspWaypoint):
            side = side_of(setting_value(part.side, candidate.values))
            return ROUND if tool_turns(cell.model) == ROUND else part_turns(objects[binding[part.object]], side)
        return part_turns(objects[binding[part.object]], FIRST_SIDE) if isinstance(part, PutWaypoint) else 1

    free = _free(candidate.skill, "yaw", candidate.values)
    return _combined({parameter: equal_turns(gcd(*map(turns, parts))) for parameter, parts in free.items()})


def _stops(cell: Cell, candidate: Candidate, world: World) -> Iterator[_Values]:
    """With and without a stop at home."""
    begin, first = cell.model.arm_positions(world.joints), candidate.skill.primitives[0]
    is_home = np.allclose(begin, cell.model.home, rtol=0.0, atol=1e-9)

    def choices(moves: Sequence[Entry]) -> list[MotionValue]:
        return [DIRECT] if is_home and list(moves) == [first] else [DIRECT, HOME]

    free = _free(candidate.skill, "via", candidate.values)
    return _combined({parameter: choices(moves) for parameter, moves in free.items()})


def _free(skill: Skill, setting: str, values: _Values) -> dict[str, list[Entry]]:
    """The parameters that leave a setting free, each with the waypoints or joint moves that it is for."""
    found: dict[str, list[Entry]] = {}
    for part in (*skill.waypoints.values(), *skill.primitives):
        stated = getattr(part, setting, None)
        if isinstance(stated, Reference) and values[stated.parameter] == ANY:
            found.setdefault(stated.parameter, []).append(part)
    return found


def _common(choices: Iterable[Sequence[str]]) -> list[str]:
    """What all of some lists contain, in the order of the first."""
    first, *others = choices
    return [choice for choice in first if all(choice in other for other in others)]


def _combined(choices: Mapping[str, Sequence[MotionValue]]) -> Iterator[_Values]:
    """Every combination of the choices of some parameters, the first ones first."""
    return (dict(zip(choices, values, strict=True)) for values in product(*choices.values()))


def _with(candidate: Candidate, values: _Values) -> Candidate:
    return replace(candidate, values={**candidate.values, **values})
