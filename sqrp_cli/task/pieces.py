"""Pieces of a motion in which the same literals must be observable: the symbolic side of skill states."""

from __future__ import annotations

from collections.abc import Sequence

from sqrp_cli.logic.formula_time import SAME_INSTANT, GroundOperator, TimeInterval, merge
from sqrp_cli.logic.literal import Literal
from sqrp_cli.records import dataclass


@dataclass(frozen=True)
class Piece(TimeInterval):
    """A piece of the motion within one primitive in which the same formulas apply throughout.

    It ends where it starts where a formula applies at one instant only.
    """

    primitive: int
    """Index of the primitive."""
    literals: tuple[Literal, ...]
    """The literals that must be observable, in the order of the formulas."""
    of_interest: bool
    """Inside an event of interest."""


def cut_into_pieces(spans: Sequence[tuple[float, float]], formulas: Sequence[GroundOperator]) -> tuple[Piece, ...]:
    """Cut a motion wherever a primitive or the interval of a formula begins or ends.

    spans: start and end of each primitive [s], one after the other. Neighbouring pieces share an instant, which is
    sampled once as the end of one and once as the start of the other. A formula that applies at a single instant makes
    a piece of length 0. There is at least one piece.
    """
    edges = _distinct([edge for one in formulas for edge in (one.start, one.end)])
    moments = _distinct([one.start for one in formulas if one.end - one.start < SAME_INSTANT])
    cuts = list[tuple[int, float, float]]()  # of each piece its primitive, start and end
    for primitive, (start, end) in enumerate(spans):
        inner = [t for t in edges if start + SAME_INSTANT < t < end - SAME_INSTANT]
        for left, right in zip([start, *inner], [*inner, end], strict=True):
            if right - left >= SAME_INSTANT:
                cuts += [(primitive, t, t) for t in moments if abs(t - left) < SAME_INSTANT]
                cuts.append((primitive, left, right))
    last, end = len(spans) - 1, spans[-1][1]
    cuts += [(last, t, t) for t in moments if abs(t - end) < SAME_INSTANT]
    pieces = list[Piece]()
    for primitive, start, stop in cuts or [(last, end, end)]:
        middle = 0.5 * (start + stop)
        applying = [one for one in formulas if one.start - SAME_INSTANT <= middle <= one.end + SAME_INSTANT]
        literals = tuple(dict.fromkeys(literal for one in applying for literal in one.literals))
        interest = any(one.operator == "eventually" for one in applying)
        pieces.append(Piece(start=start, end=stop, primitive=primitive, literals=literals, of_interest=interest))
    return tuple(pieces)


def monitored_times(formulas: Sequence[GroundOperator]) -> tuple[float, float]:
    """T and T_eoi: durations of the union of all intervals, and of those of the events of interest [s]."""
    events = [one for one in formulas if one.operator == "eventually"]
    return sum(one.length for one in merge(formulas)), sum(one.length for one in merge(events))


def fault_literals(formulas: Sequence[GroundOperator]) -> dict[str, tuple[Literal, ...]]:
    """All literals of each fault, by its name."""
    found: dict[str, dict[Literal, None]] = {}
    for one in formulas:
        if one.fault is not None and one.literals:
            found.setdefault(one.fault, {}).update(dict.fromkeys(one.literals))
    return {fault: tuple(literals) for fault, literals in found.items()}


def fault_intervals(formulas: Sequence[GroundOperator], fault: str) -> tuple[TimeInterval, ...]:
    """When a fault may happen: the union of the intervals of its operators that have literals."""
    return merge(one for one in formulas if one.fault == fault and one.literals)


def _distinct(instants: list[float]) -> list[float]:
    """The instants in order, without repetitions."""
    kept: list[float] = []
    for t in sorted(instants):
        if not kept or t - kept[-1] >= SAME_INSTANT:
            kept.append(t)
    return kept
