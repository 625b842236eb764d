"""Findings in a PDDL action, and between it and the formulas of its skill."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.checks.lint_formulas import Claim, boundary, demands
from sqrp_cli.errors import Place, Problem
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.logic.domain import Condition, Conjunction, Holds, Negation


def impossible_preconditions(skill: Skill) -> Iterator[Problem]:
    """Preconditions that demand a literal and its negation."""
    true, false = _literals(skill.action.precondition)
    place = _place(skill)
    for claim in sorted(true & false, key=str):
        message = f"skill `{skill.name}`: the precondition demands `{_text(claim)}` and `not {_text(claim)}`"
        yield Problem("contradictory-precondition", message, place, mend="remove one of them; it can never be done")


def formulas_against_the_action(skill: Skill) -> Iterator[Problem]:
    """`always` formulas over the start of a skill against its precondition, and over its end against its effect."""
    names = [primitive.name for primitive in skill.primitives]
    needed = _literals(skill.action.precondition)
    made = set(map(_claim, skill.action.effect.adds)), set(map(_claim, skill.action.effect.deletes))
    for requirement in skill.requirements:
        for interval, true, false in demands(skill, requirement):
            at_start = boundary(interval.start, names) == 0 and interval.start.offset <= 0
            at_end = boundary(interval.end, names) == len(names) and interval.end.offset >= 0
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


def _place(skill: Skill) -> Place:
    """The line of the skill's action in its PDDL file."""
    return Place(skill.domain.path, skill.action.place.line)


def _literals(condition: Condition) -> tuple[set[Claim], set[Claim]]:
    """What a condition surely demands to be true, and what to be false."""
    match condition:
        case Holds():
            return {_claim(condition)}, set()
        case Negation(Holds() as use):
            return set(), {_claim(use)}
        case Conjunction(parts):
            found = [_literals(part) for part in parts]
            return set().union(*(true for true, _ in found)), set().union(*(false for _, false in found))
    return set(), set()


def _claim(use: Holds) -> Claim:
    return use.predicate, tuple(term.name for term in use.terms)


def _text(claim: Claim) -> str:
    predicate, arguments = claim
    return f"{predicate}({', '.join(arguments)})" if arguments else predicate
