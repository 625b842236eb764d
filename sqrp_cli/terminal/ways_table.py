"""The ways of candidates: the column of the ranked table, and the table of all that are Pareto-optimal."""

from __future__ import annotations

from collections.abc import Sequence

from sqrp_cli.programming.coverage.assessment import Assessment, WayFigures
from sqrp_cli.programming.ranking import Ranked, compared_quality
from sqrp_cli.programming.ways.words import way_in_words
from sqrp_cli.terminal.console import Column, Share, numbers, print_table, say, seconds

MOST_NAMED = 3
"""Most candidates that a line about ways names."""

SHORTEST_BLIND = 0.05
"""Blind ends of moves that cost less are not named [s]."""


def faster_ways(feasible: Sequence[Ranked], *, all_shown: bool) -> str:
    """A line about faster ways that see less; empty if there are none. all_shown: whether `print_ways` follows."""
    found = [(one.assessment.candidate.name, _fastest(one.assessment)) for one in feasible]
    faster = [f"{name} in {way.time:.1f} s ({_qualities(way)})" for name, way in found if way is not None]
    more = f", and {len(faster) - MOST_NAMED} more" if len(faster) > MOST_NAMED else ""
    named = ", ".join(faster[:MOST_NAMED])
    where = "below" if all_shown else "see --ways all"
    return f"Faster ways see less: {named}{more}; {where}." if faster else ""


def blind_ends(feasible: Sequence[Ranked]) -> str:
    """A line about the ends of moves that no path can make seen; empty if there are none."""
    named = []
    for one in feasible:
        seconds: dict[str, float] = {}
        for end in one.assessment.ways.blind_ends if one.assessment.ways is not None else ():
            seconds[end.at] = seconds.get(end.at, 0.0) + end.seconds
        places = " and ".join(f"`{at}` {total:.1f} s" for at, total in seconds.items() if total >= SHORTEST_BLIND)
        named += [f"{one.assessment.candidate.name} {places}"] if places else []
    more = f", and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    line = f"No path helps at ends of moves that the cameras do not see: {', '.join(named[:MOST_NAMED])}{more}."
    return line if named else ""


def print_ways(assessments: Sequence[Assessment]) -> None:
    """A table of the Pareto-optimal ways of each candidate that has several."""
    for assessment in assessments:
        if assessment.ways is not None and assessment.ways.pareto:
            found, name = assessment.ways, assessment.candidate.name
            say(f"\n{name}: {found.feasible} of {found.tried} ways can be done; Pareto-optimal are")
            rows = [
                (
                    _words(assessment, way),
                    Share(way.q_eoi),
                    Share(way.q_avg),
                    seconds(way.time),
                    seconds(way.delay_worst),
                )
                for way in found.pareto
            ]
            titles = ("Q_eoi [%]", "Q_avg [%]", "time\n[s]", "at\nworst")
            print_table([Column("way"), *numbers(*titles)], rows)


def _fastest(assessment: Assessment) -> WayFigures | None:
    """The fastest Pareto-optimal way of a candidate, if it sees less than its best."""
    if assessment.ways is None or len(assessment.ways.pareto) < 2:
        return None
    first, *others = assessment.ways.pareto
    fastest = min(others, key=lambda way: way.time)
    return fastest if fastest.time < first.time and _sees_less(fastest, first) else None


def _sees_less(way: WayFigures, other: WayFigures) -> bool:
    """Whether one of a way's qualities is below that of another way, as they are compared."""
    pairs = ((way.q_eoi, other.q_eoi), (way.q_avg, other.q_avg))
    return any(compared_quality(own) < compared_quality(of_other) for own, of_other in pairs)


def _words(assessment: Assessment, way: WayFigures) -> str:
    candidate = assessment.candidate
    return way_in_words(candidate.skill, candidate.parameters, way.parameters)


def _qualities(way: WayFigures) -> str:
    named = (("Q_eoi", way.q_eoi), ("Q_avg", way.q_avg))
    return ", ".join(f"{name} {100 * quality:.1f} %" for name, quality in named if quality is not None)
