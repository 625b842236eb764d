"""Findings in formulas: against each other, against the action of their skill, and against its motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, TypeAlias

from sqrp_cli.errors import Place, Problem
from sqrp_cli.logic.domain import EQUAL, Compound, Condition, Holds, nested
from sqrp_cli.logic.formula import (
    Formula,
    Instant,
    Interval,
    Operation,
    Predicate,
    argument_lists,
    bind,
    problem_at,
)
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth, joined
from sqrp_cli.skill.skill import Requirement, Skill

if TYPE_CHECKING:
    from sqrp_cli.search.planned_step import CheckedCandidate
    from sqrp_cli.study.result import CandidateResult

_Demand: TypeAlias = tuple[Requirement, Interval, set[Atom], set[Atom]]
"""A requirement with the interval of an `always` operator that must hold, and the atoms that it makes true and false.

The atoms are about the parameters of the skill.
"""


def contradictions(skill: Skill) -> Iterator[Problem]:
    """Pairs of `always` formulas that claim a literal and its negation over a common stretch of time.

    Only what the order of the primitive actions decides is reported: intervals that merely touch do not contradict.
    """
    demands = _demands(skill)
    names = [primitive.name for primitive in skill.primitives]
    found: list[tuple[Requirement, Requirement, set[Atom]]] = []
    for requirement, interval, true, false in demands:
        if _before(interval.start, interval.end, names):
            found.append((requirement, requirement, true & false))
    for (first, one, yes, no), (second, two, also_yes, also_no) in combinations(demands, 2):
        if all(_before(start, end, names) for start in (one.start, two.start) for end in (one.end, two.end)):
            found.append((second, first, (yes & also_no) | (no & also_yes)))
    for requirement, other, both in found:
        if both:
            literal = min(both).predicate
            formulas, when = f"`{requirement.formula}` demands", "at the same time"
            if other is not requirement:
                formulas = f"`{requirement.formula}` and `{other.formula}` (line {other.place.line}) demand"
                when = "over a common stretch"
            message = f"skill `{skill.name}`: {formulas} `{literal}` and `not {literal}` {when}"
            mend = "let one interval end where the other starts, or correct the literal"
            yield Problem("contradictory-formulas", message, requirement.place, mend=mend)


def faults_of_the_plan(skill: Skill) -> Iterator[Problem]:
    """Faults that are seen in every successful run, because other formulas demand their literals.

    These hold throughout the fault's interval or, for an `eventually`, during some primitive action; only what the
    order of the primitive actions decides is reported.
    """
    demands, names = _demands(skill), [primitive.name for primitive in skill.primitives]
    for fault in skill.requirements:
        formula = bind(fault.formula, {}, argument_lists(skill.action))
        if fault.name is None or not isinstance(formula, Operation) or formula.interval is None:
            continue
        whole, stretches = formula.interval, [formula.interval]
        if formula.operator == "eventually":
            actions = [Interval(Instant(name, "start"), Instant(name, "end")) for name in names]
            stretches += [action for action in actions if _is_within(action, whole, names)]
        for stretch in stretches:
            required = [(other, yes, no) for other, span, yes, no in demands if _is_within(stretch, span, names)]
            yes = set[Atom]().union(*(yes for _, yes, _ in required))
            no = set[Atom]().union(*(no for _, _, no in required))
            if not yes & no and _truth(formula.parts[0], yes, no) == Truth.TRUE:
                message = (
                    f"skill `{skill.name}`: the fault `{fault.name}` is seen whenever all goes well: over {stretch}, "
                    f"{' and '.join(f'`{other.formula}`' for other, _, _ in required)} "
                    f"demand{'s' if len(required) == 1 else ''} what it looks for"
                )
                mend = "correct the literals or the interval of one of them"
                yield Problem("fault-of-the-plan", message, fault.place, mend=mend)
                break


def formulas_against_the_action(skill: Skill) -> Iterator[Problem]:
    """Preconditions that demand a literal and its negation.

    And `always` formulas that contradict the precondition at the skill's start, or its effect at the end.
    """
    names = [primitive.name for primitive in skill.primitives]
    asked, denied = list[Holds](), list[Holds]()
    conditions: list[Condition] = [skill.action.precondition]
    for condition in conditions:
        match condition:
            case Holds() if condition.predicate != EQUAL:
                asked.append(condition)
            case Compound("not", (Holds() as use,)) if use.predicate != EQUAL:
                denied.append(use)
            case Compound("and", parts):
                conditions += parts
    needed, made = (  # the atoms that are true before and after it, and those that are false
        [{Atom(use.predicate, tuple(term.removeprefix("?") for term in use.terms)) for use in uses} for uses in both]
        for both in ((asked, denied), (skill.action.adds, skill.action.deletes))
    )
    for atom in sorted(needed[0] & needed[1], key=str):
        message = f"skill `{skill.name}`: the precondition demands `{atom}` and `not {atom}`"
        place, mend = Place(skill.domain.path, skill.action.place.line), "remove one of them; it can never be done"
        yield Problem("contradictory-precondition", message, place, mend=mend)
    for requirement, interval, true, false in _demands(skill):
        at_start = interval.start.boundary(names) == 0 and interval.start.offset <= 0
        at_end = interval.end.boundary(names) == len(names) and interval.end.offset >= 0
        for applies, (yes, no), what, code in (
            (at_start, needed, "the precondition", "against-the-precondition"),
            (at_end, made, "the effect", "against-the-effect"),
        ):
            for atom in sorted(((true & no) | (false & yes)) - (true & false), key=str) if applies else ():
                demanded = str(atom) if atom in true else f"not {atom}"
                message = f"skill `{skill.name}`: `{requirement.formula}` demands `{demanded}` against {what}"
                mend = f"correct the formula or {what} in {skill.domain.path.name}"
                yield Problem(code, message, requirement.place, mend=mend)


def intervals_outside(found: Iterable[CandidateResult | CheckedCandidate]) -> tuple[Problem, ...]:
    """One warning for each interval that lies outside the motion of some candidate."""
    feasible: dict[str, list[tuple[CandidateResult | CheckedCandidate, float]]] = {}
    for one in found:
        if one.time is not None:
            feasible.setdefault(one.candidate.skill.name, []).append((one, one.time))
    warnings: list[Problem] = []
    for members in feasible.values():
        skill = members[0][0].candidate.skill
        for index, requirement in enumerate(skill.requirements):
            fault = f"fault `{requirement.name}`, " if requirement.name is not None else ""
            for number, interval in enumerate(one.interval for one in nested(requirement.formula) if one.interval):
                times = [time for one, time in members if (index, number) in one.outside]
                if not times:
                    continue
                of = f" of {len(times)} of {len(members)} candidates" if len(times) < len(members) else ""
                lasts = " to ".join(dict.fromkeys((f"{min(times):.2f}", f"{max(times):.2f}")))
                message = (
                    f"skill `{skill.name}`: nothing of the interval {interval} of {fault}"
                    f"`{requirement.formula}` lies in the motion, so it is never looked at: the motion{of} lasts "
                    f"{lasts} s"
                )
                first, last = skill.primitives[0].name, skill.primitives[-1].name
                mend = "give times in seconds, or from the start or end of a primitive, "
                mend += f"such as `[{first}.start, {last}.end]`"
                code, origin = "interval-outside-the-motion", interval.start.origin
                problem = problem_at(origin, code, message, requirement.place)
                warnings.append(replace(problem, severity="warning", mend=mend))
    return tuple(warnings)


def _is_within(inner: Interval, outer: Interval, primitives: list[str]) -> bool:
    """Whether an interval surely lies within another, however long the primitive actions take."""
    return all(
        first.boundary(primitives) <= second.boundary(primitives) and first.offset <= second.offset
        for first, second in ((outer.start, inner.start), (inner.end, outer.end))
    )


def _before(first: Instant, second: Instant, primitives: list[str]) -> bool:
    """Whether `first` surely comes before `second`, however long the primitive actions take."""
    start, end = first.boundary(primitives), second.boundary(primitives)
    return (start < end and first.offset <= second.offset) or (start == end and first.offset < second.offset)


def _truth(formula: Formula, yes: set[Atom], no: set[Atom]) -> Truth:
    """The value of a formula where some atoms are true and others false; unknown of a temporal operator."""
    if isinstance(formula, Predicate):
        return Truth.TRUE if formula.atom in yes else Truth.FALSE if formula.atom in no else Truth.UNKNOWN
    if formula.interval is not None:
        return Truth.UNKNOWN
    return joined(formula.operator, [_truth(part, yes, no) for part in formula.parts])


def _demands(skill: Skill) -> list[_Demand]:
    lists, found = argument_lists(skill.action), list[_Demand]()
    for requirement in skill.requirements:
        required = [bind(requirement.formula, {}, lists)] if requirement.name is None else []
        for formula in required:
            if isinstance(formula, Operation) and formula.operator == "and":
                required += formula.parts
            elif isinstance(formula, Operation) and formula.operator == "always" and formula.interval is not None:
                literals = list(_demanded(formula.parts[0], truth=True))
                true, false = ({atom for atom, truth in literals if truth == value} for value in (True, False))
                found.append((requirement, formula.interval, true, false))
    return found


def _demanded(formula: Formula, *, truth: bool) -> Iterator[tuple[Atom, bool]]:
    """The atoms that must have one value, each with it, for a formula to have a value."""
    if isinstance(formula, Predicate):
        yield formula.atom, truth
    elif formula.operator == "not" or (formula.operator, truth) in (("and", True), ("or", False), ("implies", False)):
        for number, part in enumerate(formula.parts):
            opposite = formula.operator == "not" or (formula.operator == "implies" and number == 0)
            yield from _demanded(part, truth=truth != opposite)
