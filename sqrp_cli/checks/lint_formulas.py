"""Findings in the formulas of a skill, decided from the order of its primitive actions alone."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.frames import FrameName
from sqrp_cli.knowledge.skill.skill import Grasp, Requirement, Skill
from sqrp_cli.logic.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Instant,
    Interval,
    Not,
    Or,
    Predicate,
    children,
)
from sqrp_cli.logic.formula_check import ArgumentLists, argument_lists
from sqrp_cli.logic.truth import Truth

Claim = tuple[str, tuple[str, ...] | None]
"""A predicate with the arguments that it has in the skill."""


def predicates_of(formula: Formula) -> tuple[str, ...]:
    """Names of the predicates in a formula, once each, from left to right."""
    if isinstance(formula, Predicate):
        return (formula.name,)
    return tuple(dict.fromkeys(name for part in children(formula) for name in predicates_of(part)))


def fault_boxes_that_move(skill: Skill) -> Iterator[Problem]:
    """Boxes of fault literals that move with an object that the skill grasps, and so still do once it is lost."""
    grasped = {primitive.object for primitive in skill.primitives if isinstance(primitive, Grasp)}
    reported: set[tuple[str, str]] = set()
    for requirement in skill.requirements:
        if requirement.name is None:
            continue
        for predicate in predicates_of(requirement.formula):
            boxes = skill.targets[predicate].boxes if predicate in skill.targets else ()
            for index, box in enumerate(boxes):
                if box.frame not in grasped or (predicate, box.name) in reported:
                    continue
                reported.add((predicate, box.name))
                message = (
                    f"skill `{skill.name}`: fault `{requirement.name}` is seen by box `{box.name}` of `{predicate}`, "
                    f"which moves with `{box.frame}`; once that is lost, the box is where it fell"
                )
                mend = f"give the box a frame that stays: `tool`, or `{FrameName.at_start_of(box.frame)}`"
                place = skill.place("targets", predicate, "boxes", index, "name")
                yield Problem("box-moves-with-lost-object", message, place, mend=mend)


def contradictions(skill: Skill) -> Iterator[Problem]:
    """Pairs of `always` formulas that claim a literal and its negation over a common stretch of time.

    Only what the order of the primitive actions decides is reported: intervals that merely touch do not contradict.
    """
    claims = [(requirement, claim) for requirement in skill.requirements for claim in demands(skill, requirement)]
    names = [primitive.name for primitive in skill.primitives]
    for requirement, (interval, positive, negative) in claims:
        both = positive & negative
        if both and _before(interval.start, interval.end, names):
            yield _contradiction(skill, requirement, requirement, min(both))
    for (first, (one, yes, no)), (second, (other, also_yes, also_no)) in combinations(claims, 2):
        both = (yes & also_no) | (no & also_yes)
        starts, ends = (one.start, other.start), (one.end, other.end)
        if both and all(_before(start, end, names) for start in starts for end in ends):
            yield _contradiction(skill, second, first, min(both))


def _contradiction(skill: Skill, requirement: Requirement, other: Requirement, claim: Claim) -> Problem:
    message = (
        f"skill `{skill.name}`: `{requirement.formula}` demands `{claim[0]}` and `not {claim[0]}` at the same time"
    )
    if other is not requirement:
        message = (
            f"skill `{skill.name}`: `{requirement.formula}` and `{other.formula}` (line {other.place.line}) demand "
            f"`{claim[0]}` and `not {claim[0]}` over a common stretch"
        )
    mend = "let one interval end where the other starts, or correct the literal"
    return Problem("contradictory-formulas", message, requirement.place, mend=mend)


def faults_of_the_plan(skill: Skill) -> Iterator[Problem]:
    """Faults that are seen whenever all goes well, since the formulas demand what they look for.

    They do so throughout the fault's interval or, of an `eventually`, in some primitive action; only what the order of
    the primitive actions decides is reported.
    """
    lists, names = argument_lists(skill.action), [primitive.name for primitive in skill.primitives]
    plain = [(requirement, claim) for requirement in skill.requirements for claim in demands(skill, requirement)]
    for fault in skill.requirements:
        if fault.name is None or not isinstance(fault.formula, Always | Eventually):
            continue
        whole, stretches = fault.formula.interval, [fault.formula.interval]
        if isinstance(fault.formula, Eventually):
            actions = [Interval(Instant(name, "start"), Instant(name, "end")) for name in names]
            stretches += [action for action in actions if _is_within(action, whole, names)]
        for stretch in stretches:
            asked = [(other, yes, no) for other, (span, yes, no) in plain if _is_within(stretch, span, names)]
            yes = set[Claim]().union(*(yes for _, yes, _ in asked))
            no = set[Claim]().union(*(no for _, _, no in asked))
            if not yes & no and _truth(fault.formula.operand, yes, no, lists) == Truth.TRUE:
                message = (
                    f"skill `{skill.name}`: the fault `{fault.name}` is seen whenever all goes well: over {stretch}, "
                    f"{' and '.join(f'`{other.formula}`' for other, _, _ in asked)} "
                    f"demand{'s' if len(asked) == 1 else ''} what it looks for"
                )
                mend = "correct the literals or the interval of one of them"
                yield Problem("fault-of-the-plan", message, fault.place, mend=mend)
                break


def _is_within(inner: Interval, outer: Interval, primitives: list[str]) -> bool:
    """Whether an interval surely lies within another, however long the primitive actions take."""
    return _is_not_after(outer.start, inner.start, primitives) and _is_not_after(inner.end, outer.end, primitives)


def _is_not_after(first: Instant, second: Instant, primitives: list[str]) -> bool:
    return boundary(first, primitives) <= boundary(second, primitives) and first.offset <= second.offset


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


def demands(skill: Skill, requirement: Requirement) -> Iterator[tuple[Interval, set[Claim], set[Claim]]]:
    """The `always` operators that must hold, each with the claims that it makes true and false."""
    lists = argument_lists(skill.action)

    def demanded(formula: Formula, truth: bool) -> Iterator[tuple[Claim, bool]]:
        match formula:
            case Predicate():
                yield _claim(formula, lists), truth
            case Not(operand):
                yield from demanded(operand, not truth)
            case And(operands) if truth:
                for operand in operands:
                    yield from demanded(operand, True)
            case Or(operands) if not truth:
                for operand in operands:
                    yield from demanded(operand, False)
            case Implies(premise, conclusion) if not truth:
                yield from demanded(premise, True)
                yield from demanded(conclusion, False)

    def operators(formula: Formula) -> Iterator[Always]:
        if isinstance(formula, Always):
            yield formula
        elif isinstance(formula, And):
            for operand in formula.operands:
                yield from operators(operand)

    if requirement.name is not None:
        return
    for operator in operators(requirement.formula):
        literals = list(demanded(operator.operand, True))
        yield operator.interval, {c for c, truth in literals if truth}, {c for c, truth in literals if not truth}


def _claim(predicate: Predicate, lists: ArgumentLists) -> Claim:
    known = lists.get(predicate.name, ())
    return predicate.name, known[0] if predicate.arguments is None and len(known) == 1 else predicate.arguments


def _before(first: Instant, second: Instant, primitives: list[str]) -> bool:
    """Whether `first` surely comes before `second`, however long the primitive actions take."""
    start, end = boundary(first, primitives), boundary(second, primitives)
    return (start < end and first.offset <= second.offset) or (start == end and first.offset < second.offset)


def boundary(instant: Instant, primitives: list[str]) -> int:
    """Number of primitive actions that are over at an instant without its offset."""
    if instant.primitive is None:
        return 0
    return primitives.index(instant.primitive) + (instant.edge == "end")
