"""Warnings about intervals of formulas that lie outside the motion, so that they are never looked at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Protocol

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.skill.skill import Requirement, Skill
from sqrp_cli.logic.formula_time import operators
from sqrp_cli.programming.task import Candidate


class Timed(Protocol):
    """What is known of one candidate: an `Assessment` or a `Feasibility`; time is None where it is infeasible."""

    @property
    def candidate(self) -> Candidate:
        """The candidate."""

    @property
    def time(self) -> float | None:
        """Duration of its motion [s]."""

    @property
    def outside(self) -> tuple[tuple[int, int], ...]:
        """Its temporal operators that are never looked at."""


def intervals_outside(found: Iterable[Timed]) -> tuple[Problem, ...]:
    """One warning for each interval of which the motion of some candidate leaves nothing."""
    feasible: dict[str, list[tuple[Timed, float]]] = {}
    for one in found:
        if one.time is not None:
            feasible.setdefault(one.candidate.skill.name, []).append((one, one.time))
    return tuple(
        warning for members in feasible.values() for warning in _warnings(members[0][0].candidate.skill, members)
    )


def _warnings(skill: Skill, members: list[tuple[Timed, float]]) -> Iterator[Problem]:
    for index, requirement in enumerate(skill.requirements):
        for number, operator in enumerate(operators(requirement.formula)):
            times = [time for one, time in members if (index, number) in one.outside]
            if not times:
                continue
            of = f" of {len(times)} of {len(members)} candidates" if len(times) < len(members) else ""
            message = (
                f"skill `{skill.name}`: nothing of the interval {operator.interval} of {_what(requirement)} lies in "
                f"the motion, so it is never looked at: the motion{of} lasts {_span(times)} s"
            )
            first, last = skill.primitives[0].name, skill.primitives[-1].name
            mend = (
                f"give times in seconds, or from the start or end of a primitive, such as `[{first}.start, {last}.end]`"
            )
            code, origin = "interval-outside-the-motion", operator.interval.start.origin
            problem = origin.problem(code, message) if origin else Problem(code, message, requirement.place)
            yield replace(problem, severity="warning", mend=mend)


def _what(requirement: Requirement) -> str:
    fault = f"fault `{requirement.name}`, " if requirement.name is not None else ""
    return f"{fault}`{requirement.formula}`"


def _span(times: list[float]) -> str:
    shortest, longest = f"{min(times):.2f}", f"{max(times):.2f}"
    return shortest if shortest == longest else f"{shortest} to {longest}"
