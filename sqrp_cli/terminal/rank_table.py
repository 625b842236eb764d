"""The ranked table of `sqrp rank`, the ways of candidates, and the sentences under it; also what is infeasible."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sqrp_cli.knowledge.camera.camera import assumed_latency
from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.programming.coverage.assessment import Assessment, WayFigures
from sqrp_cli.programming.coverage.robustness import DRAWS
from sqrp_cli.programming.coverage.verdict import NOTHING_MISSING
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.ranking import Criterion, Ranked, compared_quality, winners
from sqrp_cli.programming.task import in_words
from sqrp_cli.programming.ways.grips import way_in_words
from sqrp_cli.report import sentences
from sqrp_cli.report.documents.candidates import percentiles
from sqrp_cli.terminal.console import (
    Cell,
    Column,
    Share,
    Styled,
    delay,
    fits,
    joined,
    numbers,
    plain,
    print_table,
    say,
    seconds,
)

MOST_NAMED = 3
"""Most candidates that a line about ways names."""

SHORTEST_BLIND = 0.05
"""Blind ends of moves that cost less are not named [s]."""


def faster_ways(feasible: Sequence[Ranked], *, all_shown: bool) -> str:
    """A line about faster ways that are seen less; empty if there are none. all_shown: whether `print_ways` follows."""
    found = [(one.assessment.candidate.name, _fastest(one.assessment)) for one in feasible]
    faster = [f"{name} in {way.time:.1f} s ({_qualities(way)})" for name, way in found if way is not None]
    more = f", and {len(faster) - MOST_NAMED} more" if len(faster) > MOST_NAMED else ""
    named = ", ".join(faster[:MOST_NAMED])
    where = "below" if all_shown else "see --ways all"
    return f"Faster ways rank lower: {named}{more}; {where}." if faster else ""


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
                    delay(way.delay_worst, way.unseen),
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


MOST_ROWS = 20
"""A ranking of more candidates shows only some, unless all are asked for."""

_OPTIMAL = "* Pareto-optimal: none is as good in Q_eoi, Q_avg and time and better in one."
"""What the asterisk of the table means."""


def print_ranking(
    title: str,
    assignment: Assignment,
    ranking: Sequence[Ranked],
    by: Criterion,
    *,
    all_ways: bool = False,
    all_rows: bool = False,
) -> None:
    """The table with a row per feasible candidate, the infeasible ones with reasons, and a summary.

    all_ways: with a table of the Pareto-optimal ways of each. all_rows: however many there are; else of a long ranking
    only the best for each choice of objects.
    """
    feasible = [ranked for ranked in ranking if ranked.rank is not None]
    workspace = assignment.cell.workspace.name
    say(joined([(title, "bold"), f" in {workspace}: {sentences.summary(ranking, by)}\n"]))
    if feasible:
        shown = feasible if all_rows else _best_of_each(feasible)
        _print_feasible(feasible, shown)
        if feasible[0].assessment.faults and (assumed := assumed_latency(assignment.cell.observer.cameras)):
            say(f"Delays: {assumed}.")
        _print_calibration(assignment, feasible, by)
    for ranked in feasible:
        if ranked.assessment.remarks:
            say(f"{ranked.assessment.candidate.name}: {', '.join(ranked.assessment.remarks)}")
    blocked = [ranked.assessment for ranked in ranking if ranked.rank is None]
    print_infeasible((found.candidate, found.reasons[0]) for found in blocked)
    if feasible:
        say()
        for sentence in _sentences(feasible, by, all_ways=all_ways):
            say(sentence)
        say(_OPTIMAL, "dim")
        say(sentences.accuracy(assignment.sampling, feasible), "dim")
    if all_ways:
        print_ways([ranked.assessment for ranked in ranking])


def _sentences(feasible: Sequence[Ranked], by: Criterion, *, all_ways: bool) -> Iterator[str]:
    """Why the first is first and the last last, and what other ways there are."""
    yield sentences.why_first(feasible, by)
    last = feasible[-1].assessment
    all_seen = last.verdict == NOTHING_MISSING
    if len(feasible) > 1:
        beginning = f"Even in the last, {last.candidate.name}," if all_seen else f"Last is {last.candidate.name}:"
        yield f"{beginning} {last.verdict[0].lower()}{last.verdict[1:]}"
    elif not all_seen:
        yield last.verdict
    yield from filter(None, (faster_ways(feasible, all_shown=all_ways), blind_ends(feasible)))


def _print_calibration(assignment: Assignment, feasible: Sequence[Ranked], by: Criterion) -> None:
    """The effect of inexact camera poses on the qualities and on the first place."""
    calibration = assignment.calibration
    if calibration is None:
        return
    assessments = [ranked.assessment for ranked in feasible]
    first = winners(assessments, by)
    errors = f"{1000 * calibration.position:g} mm, {np.degrees(calibration.rotation):g} deg"
    say(f"\nIf every camera is off by {errors} (one standard deviation; {DRAWS} draws, 5th to 95th percentile):")
    rows = [
        (
            assessment.candidate.name,
            _span([q.q_eoi for q in assessment.recalibrated]),
            _span([q.q_avg for q in assessment.recalibrated]),
            f"{first[assessment.candidate.name]} of {DRAWS}",
        )
        for assessment in assessments
    ]
    titles = ("Q_eoi [%]", "Q_avg [%]", "first in")
    print_table([Column(""), *numbers(*titles)], rows)


def _span(values: Sequence[float | None]) -> str:
    ends = percentiles(values)
    return "-" if ends is None else f"{100 * ends[0]:.1f} to {100 * ends[1]:.1f}"


class _Figure(NamedTuple):
    """A column with a figure of each feasible candidate."""

    title: str
    cell: Callable[[Assessment], Cell]


_FIGURES = (
    _Figure("Q_eoi [%]", lambda found: Share(found.q_eoi)),
    _Figure("Q_avg [%]", lambda found: Share(found.q_avg)),
    _Figure("time\n[s]", lambda found: seconds(found.time)),
)
"""The columns that every ranking has, after place and parameters."""


_EXPECTED = _Figure("expected\n[%]", lambda found: Share(found.q_expected))
"""The column that is there if a detector says how likely it sees."""


_WAY = _Figure("way", sentences.way_of)
"""The column that is there if a candidate can be done in several ways."""


def _best_of_each(feasible: Sequence[Ranked]) -> Sequence[Ranked]:
    """All candidates of a short ranking; of a long one those that sentences name, and the best of each objects."""
    if len(feasible) <= MOST_ROWS:
        return feasible
    best: dict[tuple[str, ...], int] = {}
    for place, ranked in enumerate(feasible):
        best.setdefault(tuple(ranked.assessment.candidate.binding.values()), place)
    named = {0, 1, len(feasible) - 1}
    return [feasible[place] for place in sorted(named.union(list(best.values())[:MOST_ROWS]))]


def _print_feasible(feasible: Sequence[Ranked], shown: Sequence[Ranked]) -> None:
    """The table of those that are shown, and how many are not."""
    differing = sentences.differing_parameters([ranked.assessment.candidate for ranked in feasible])
    figures = [*_FIGURES, *_fault_figures(feasible[0].assessment)]
    if any(ranked.assessment.q_expected is not None for ranked in feasible):
        figures.insert(2, _EXPECTED)
    if any(ranked.assessment.has_choice for ranked in feasible):
        figures = [_WAY, *figures]
    ends = [Column(figure.title, right=figure is not _WAY, shrink=figure is _WAY) for figure in figures]
    columns = [Column("#"), *map(Column, differing), *ends]
    rows = [_row(ranked, differing, figures) for ranked in shown]
    if not fits(columns, rows):
        objects = [name for name in differing if name in feasible[0].assessment.candidate.binding]
        settings = [name for name in differing if name not in objects]
        columns = [Column("#"), *map(Column, objects), Column("with", shrink=True), *ends]
        rows = [
            [*row[: 1 + len(objects)], _settings(ranked, settings), *row[1 + len(differing) :]]
            for row, ranked in zip(rows, shown, strict=True)
        ]
    print_table(columns, rows)
    if len(shown) < len(feasible):
        say(f"... and {len(feasible) - len(shown)} more (--all)", "dim")
    _print_about_faults([ranked.assessment for ranked in shown])


def _print_about_faults(shown: Sequence[Assessment]) -> None:
    """Which faults the last columns are about, and which of them no image may show."""
    faults, retried = list(shown[0].faults), _retried(shown[0])
    if len(faults) > 1:
        about = f"seen, at worst: the longest of {', '.join(faults)}"
        done = f"; all done: after a retry of {', '.join(retried)}" if retried else ""
        say(plain(f"{about}{done}.", "dim"))
    unseen = [said for name in faults if (said := _unseen(name, shown))]
    if unseen:
        say(f"Never noticed, as no image is sure to show it: {', '.join(unseen)}.")


def _unseen(fault: str, shown: Sequence[Assessment]) -> str | None:
    """Of which candidates a fault may be seen in no image, and how often; None if it is always seen."""
    blind = sorted((one for one in shown if one.faults[fault].unseen > 0), key=lambda one: -one.faults[fault].unseen)
    if not blind:
        return None
    first, *others = (one.candidate.name for one in blind)
    whose = f" of {first}{f' and {len(others)} more' if others else ''}" if len(shown) > 1 else ""
    return f"{fault}{whose} in {'up to ' if others else ''}{100 * blind[0].faults[fault].unseen:.3g} % of cases"


def _settings(ranked: Ranked, names: Sequence[str]) -> str:
    """Values of parameters in one cell."""
    words = in_words(ranked.assessment.candidate.skill, ranked.assessment.candidate.all_parameters)
    return ", ".join(f"{name} {words[name]}" for name in names)


def _row(ranked: Ranked, differing: Sequence[str], figures: Sequence[_Figure]) -> list[Cell]:
    candidate = ranked.assessment.candidate
    words = in_words(candidate.skill, candidate.all_parameters)
    place = f"{ranked.rank}{' *' if ranked.pareto else ''}"
    return [place, *(words[name] for name in differing), *(figure.cell(ranked.assessment) for figure in figures)]


def _fault_figures(assessment: Assessment) -> Iterator[_Figure]:
    """The columns for the worst fault: its delays, and the time until all is done after a retry."""
    faults = list(assessment.faults)
    if faults:
        title = faults[0] if len(faults) == 1 else "fault"
        yield _Figure(f"{title}\nseen [s]", lambda found: _worst(found, "delay_mean"))
        yield _Figure("at\nworst", lambda found: _worst(found, "delay_worst"))
    retried = _retried(assessment)
    if retried:
        yield _Figure("all\ndone", lambda found: _worst(found, "expected_time", retried, "{:.1f}"))


def _retried(assessment: Assessment) -> list[str]:
    """The faults of a candidate after which it is tried again."""
    return [name for name in assessment.faults if name in assessment.candidate.skill.retried_faults]


def _worst(assessment: Assessment, name: str, faults: Iterable[str] = (), pattern: str = "{:.2f}") -> Styled:
    """A figure of the worst of some faults, or of all, in red if one may never be noticed."""
    values = [getattr(assessment.faults[fault], name) for fault in faults or assessment.faults]
    style = "red" if assessment.unseen else ""
    return plain("never" if None in values else pattern.format(max(values)), style)


NAMED = 3
"""Most choices of objects that a line names."""


def print_infeasible(found: Iterable[tuple[Candidate, str]]) -> None:
    """A line for each reason.

    Candidates share one if theirs differ in nothing but their own objects; then it names parameters, as `<object>`.
    """
    groups: dict[str, list[tuple[Candidate, str]]] = {}
    for candidate, reason in found:
        groups.setdefault(_in_general(candidate, reason), []).append((candidate, reason))
    for general, group in groups.items():
        reasons = {reason for _, reason in group}
        shared = general if len(reasons) > 1 else reasons.pop()
        say(joined([("infeasible ", "red"), f"{_who([candidate for candidate, _ in group])}: {shared}"]), indent=2)


def _in_general(candidate: Candidate, reason: str) -> str:
    """A reason with a candidate's objects replaced by the parameters that they stand for."""
    for parameter, name in candidate.binding.items():
        reason = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", f"<{parameter}>", reason)
    return reason


def _who(candidates: list[Candidate]) -> str:
    if len(candidates) == 1:
        return candidates[0].name
    objects = list(dict.fromkeys(" ".join(candidate.binding.values()) for candidate in candidates))
    named = ", ".join(objects[:NAMED]) + (f" and {len(objects) - NAMED} more" if len(objects) > NAMED else "")
    return named if len(candidates) == len(objects) else f"{named}, {len(candidates)} candidates"
