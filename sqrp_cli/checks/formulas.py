"""Findings in formulas: against each other, against the action of their skill, and against its motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple, Protocol

from sqrp_cli.errors import Place, Problem
from sqrp_cli.logic.domain import Condition, Conjunction, Holds, Negation
from sqrp_cli.logic.formula import (
    Always,
    And,
    ArgumentLists,
    Eventually,
    Formula,
    Implies,
    Instant,
    Interval,
    Not,
    Or,
    Predicate,
    argument_lists,
    children,
    problem_at,
)
from sqrp_cli.logic.formula_time import operators
from sqrp_cli.logic.truth import Truth
from sqrp_cli.skill.skill import Requirement, Skill

if TYPE_CHECKING:
    from sqrp_cli.task.task import Candidate


Claim = tuple[str, tuple[str, ...] | None]
"""A predicate with the arguments that it has in the skill."""


class _Demand(NamedTuple):
    """An `always` operator that must hold."""

    interval: Interval
    true: set[Claim]
    """The formula that it makes true."""
    false: set[Claim]


def contradictions(skill: Skill) -> Iterator[Problem]:
    """Pairs of `always` formulas that claim a literal and its negation over a common stretch of time.

    Only what the order of the primitive actions decides is reported: intervals that merely touch do not contradict.
    """
    claims = [(requirement, claim) for requirement in skill.requirements for claim in _demands(skill, requirement)]
    names = [primitive.name for primitive in skill.primitives]
    found: list[tuple[Requirement, Requirement, set[Claim]]] = []
    for requirement, (interval, true, false) in claims:
        if _before(interval.start, interval.end, names):
            found.append((requirement, requirement, true & false))
    for (first, (one, yes, no)), (second, (two, also_yes, also_no)) in combinations(claims, 2):
        if all(_before(start, end, names) for start in (one.start, two.start) for end in (one.end, two.end)):
            found.append((second, first, (yes & also_no) | (no & also_yes)))
    for requirement, other, both in found:
        if both:
            literal = min(both)[0]
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
    lists, names = argument_lists(skill.action), [primitive.name for primitive in skill.primitives]
    plain = [(requirement, claim) for requirement in skill.requirements for claim in _demands(skill, requirement)]
    for fault in skill.requirements:
        if fault.name is None or not isinstance(fault.formula, Always | Eventually):
            continue
        whole, stretches = fault.formula.interval, [fault.formula.interval]
        if isinstance(fault.formula, Eventually):
            actions = [Interval(Instant(name, "start"), Instant(name, "end")) for name in names]
            stretches += [action for action in actions if _is_within(action, whole, names)]
        for stretch in stretches:
            required = [(other, yes, no) for other, (span, yes, no) in plain if _is_within(stretch, span, names)]
            yes = set[Claim]().union(*(yes for _, yes, _ in required))
            no = set[Claim]().union(*(no for _, _, no in required))
            if not yes & no and _truth(fault.formula.operand, yes, no, lists) == Truth.TRUE:
                message = (
                    f"skill `{skill.name}`: the fault `{fault.name}` is seen whenever all goes well: over {stretch}, "
                    f"{' and '.join(f'`{other.formula}`' for other, _, _ in required)} "
                    f"demand{'s' if len(required) == 1 else ''} what it looks for"
                )
                mend = "correct the literals or the interval of one of them"
                yield Problem("fault-of-the-plan", message, fault.place, mend=mend)
                break


def impossible_preconditions(skill: Skill) -> Iterator[Problem]:
    """Preconditions that demand a literal and its negation."""
    true, false = _literals(skill.action.precondition)
    place = Place(skill.domain.path, skill.action.place.line)
    for claim in sorted(true & false, key=str):
        message = f"skill `{skill.name}`: the precondition demands `{_text(claim)}` and `not {_text(claim)}`"
        yield Problem("contradictory-precondition", message, place, mend="remove one of them; it can never be done")


def formulas_against_the_action(skill: Skill) -> Iterator[Problem]:
    """`always` formulas that contradict the precondition at the skill's start, or its effect at the end."""
    names = [primitive.name for primitive in skill.primitives]
    needed = _literals(skill.action.precondition)
    made = set(map(_claimed, skill.action.effect.adds)), set(map(_claimed, skill.action.effect.deletes))
    for requirement in skill.requirements:
        for interval, true, false in _demands(skill, requirement):
            at_start = _boundary(interval.start, names) == 0 and interval.start.offset <= 0
            at_end = _boundary(interval.end, names) == len(names) and interval.end.offset >= 0
            for applies, (yes, no), what, code in (
                (at_start, needed, "the precondition", "against-the-precondition"),
                (at_end, made, "the effect", "against-the-effect"),
            ):
                both = ((true & no) | (false & yes)) - (true & false) if applies else set()
                for claim in sorted(both, key=str):
                    demanded = _text(claim) if claim in true else f"not {_text(claim)}"
                    message = f"skill `{skill.name}`: `{requirement.formula}` demands `{demanded}` against {what}"
                    mend = f"correct the formula or {what} in {skill.domain.path.name}"
                    yield Problem(code, message, requirement.place, mend=mend)


class Timed(Protocol):
    """A candidate with the duration of its motion: an `CandidateResult` or a `Feasibility`; None if infeasible."""

    @property
    def candidate(self) -> Candidate:
        """The candidate."""

    @property
    def time(self) -> float | None:
        """Duration of its motion [s]."""

    @property
    def outside(self) -> tuple[tuple[int, int], ...]:
        """Its temporal operators that are never checked."""


def intervals_outside(found: Iterable[Timed]) -> tuple[Problem, ...]:
    """One warning for each interval that lies outside the motion of some candidate."""
    feasible: dict[str, list[tuple[Timed, float]]] = {}
    for one in found:
        if one.time is not None:
            feasible.setdefault(one.candidate.skill.name, []).append((one, one.time))
    warnings: list[Problem] = []
    for members in feasible.values():
        skill = members[0][0].candidate.skill
        for index, requirement in enumerate(skill.requirements):
            fault = f"fault `{requirement.name}`, " if requirement.name is not None else ""
            for number, operator in enumerate(operators(requirement.formula)):
                times = [time for one, time in members if (index, number) in one.outside]
                if not times:
                    continue
                of = f" of {len(times)} of {len(members)} candidates" if len(times) < len(members) else ""
                lasts = " to ".join(dict.fromkeys((f"{min(times):.2f}", f"{max(times):.2f}")))
                message = (
                    f"skill `{skill.name}`: nothing of the interval {operator.interval} of {fault}"
                    f"`{requirement.formula}` lies in the motion, so it is never looked at: the motion{of} lasts "
                    f"{lasts} s"
                )
                first, last = skill.primitives[0].name, skill.primitives[-1].name
                mend = "give times in seconds, or from the start or end of a primitive, "
                mend += f"such as `[{first}.start, {last}.end]`"
                code, origin = "interval-outside-the-motion", operator.interval.start.origin
                problem = problem_at(origin, code, message, requirement.place)
                warnings.append(replace(problem, severity="warning", mend=mend))
    return tuple(warnings)


def predicates_of(formula: Formula) -> tuple[str, ...]:
    """Names of the predicates in a formula, once each, from left to right."""
    if isinstance(formula, Predicate):
        return (formula.name,)
    return tuple(dict.fromkeys(name for part in children(formula) for name in predicates_of(part)))


def _is_within(inner: Interval, outer: Interval, primitives: list[str]) -> bool:
    """Whether an interval surely lies within another, however long the primitive actions take."""

    def is_not_after(first: Instant, second: Instant) -> bool:
        return _boundary(first, primitives) <= _boundary(second, primitives) and first.offset <= second.offset

    return is_not_after(outer.start, inner.start) and is_not_after(inner.end, outer.end)


def _truth(formula: Formula, yes: set[Claim], no: set[Claim], lists: ArgumentLists) -> Truth:
    """The value of a formula without temporal operators where some claims are true and others false."""
    parts = [_truth(part, yes, no, lists) for part in children(formula)]
    match formula:
        case Predicate():
            claim = _claim(formula, lists)
            return Truth.TRUE if claim in yes else Truth.FALSE if claim in no else Truth.UNKNOWN
        case Not():
            return ~parts[0]
        case And():
            return min(parts)
        case Or():
            return max(parts)
        case Implies():
            return max(~parts[0], parts[1])
    return Truth.UNKNOWN


def _demands(skill: Skill, requirement: Requirement) -> Iterator[_Demand]:
    """The required `always` operators, each with the claims that it makes true and false."""
    if requirement.name is not None:
        return
    lists = argument_lists(skill.action)
    required = [requirement.formula]
    for operator in required:
        required += operator.operands if isinstance(operator, And) else ()
        if not isinstance(operator, Always):
            continue
        literals = [(_claim(atom, lists), truth) for atom, truth in _demanded(operator.operand, truth=True)]
        true, false = ({claim for claim, truth in literals if truth == value} for value in (True, False))
        yield _Demand(operator.interval, true, false)


def _demanded(formula: Formula, *, truth: bool) -> Iterator[tuple[Predicate, bool]]:
    """The predicates that must have one value, each with it, for a formula to have a value."""
    match formula:
        case Predicate():
            yield formula, truth
        case Not(operand):
            yield from _demanded(operand, truth=not truth)
        case And(operands) if truth:
            for operand in operands:
                yield from _demanded(operand, truth=True)
        case Or(operands) if not truth:
            for operand in operands:
                yield from _demanded(operand, truth=False)
        case Implies(premise, conclusion) if not truth:
            yield from _demanded(premise, truth=True)
            yield from _demanded(conclusion, truth=False)


def _claim(predicate: Predicate, lists: ArgumentLists) -> Claim:
    known = lists.get(predicate.name, ())
    return predicate.name, known[0] if predicate.arguments is None and len(known) == 1 else predicate.arguments


def _before(first: Instant, second: Instant, primitives: list[str]) -> bool:
    """Whether `first` surely comes before `second`, however long the primitive actions take."""
    start, end = _boundary(first, primitives), _boundary(second, primitives)
    return (start < end and first.offset <= second.offset) or (start == end and first.offset < second.offset)


def _boundary(instant: Instant, primitives: list[str]) -> int:
    """Number of primitive actions that are over at an instant without its offset."""
    if instant.primitive is None:
        return 0
    return primitives.index(instant.primitive) + (instant.edge == "end")


def _literals(condition: Condition) -> tuple[set[Claim], set[Claim]]:
    """The claims that a condition surely demands to be true, and those to be false."""
    match condition:
        case Holds():
            return {_claimed(condition)}, set()
        case Negation(Holds() as use):
            return set(), {_claimed(use)}
        case Conjunction(parts):
            found = [_literals(part) for part in parts]
            return set().union(*(true for true, _ in found)), set().union(*(false for _, false in found))
    return set(), set()


def _claimed(use: Holds) -> Claim:
    return use.predicate, tuple(term.name for term in use.terms)


def _text(claim: Claim) -> str:
    predicate, arguments = claim
    return f"{predicate}({', '.join(arguments)})" if arguments else predicate
