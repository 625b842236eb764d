"""Ends of joint moves that no camera can follow, whatever the path: what is lost there is lost on every path."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from sqrp_cli.geometry import Indices
from sqrp_cli.knowledge.skill.skill import HOME
from sqrp_cli.programming.coverage.assessment import BlindEnd, Study
from sqrp_cli.programming.seen.open_moves import open_moves


def blind_ends(study: Study, names: Collection[str]) -> tuple[BlindEnd, ...]:
    """The ends of the named joint moves at which the state itself is not covered, in the order of time."""
    return tuple(end for move in open_moves(study, names) for end in _ends_of(study, move.primitive))


def _ends_of(study: Study, primitive: int) -> Iterator[BlindEnd]:
    timeline = study.timeline
    within = np.array([piece.primitive == primitive for piece in timeline.pieces])[timeline.samples.piece]
    rows = np.flatnonzero(within)
    move = study.candidate.skill.primitives[primitive]
    stops = [getattr(action, "to", None) for action in study.candidate.skill.primitives[:primitive]]
    begin = next((stop for stop in reversed(stops) if stop is not None), HOME)
    whole = float(timeline.samples.t[rows[-1]] - timeline.samples.t[rows[0]])
    for at, in_order in ((begin, rows), (str(getattr(move, "to", "")), rows[::-1])):
        if seconds := _blind_from(study, in_order):
            yield BlindEnd(primitive=move.name, at=at, seconds=seconds)
        if seconds == whole:
            break  # It is not covered anywhere: once is enough.


def _blind_from(study: Study, rows: Indices) -> float:
    """How long the state is not covered from the first of some samples in a row to the first that is covered [s]."""
    timeline = study.timeline
    blind = timeline.monitored[rows] & ~timeline.covered[rows]
    seen = np.flatnonzero(~blind)
    last = int(seen[0]) if len(seen) else len(rows) - 1
    return float(abs(timeline.samples.t[rows[last]] - timeline.samples.t[rows[0]])) if blind[0] else 0.0
