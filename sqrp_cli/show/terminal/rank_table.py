"""The ranked table of `sqrp rank`, the ways of candidates, and the sentences under it; also what is infeasible."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING

from sqrp_cli.show import sentences
from sqrp_cli.show.terminal.console import (
    Column,
    TableCell,
    delay,
    fits,
    joined,
    numbers,
    print_table,
    say,
    say_assumed,
    seconds,
    styled,
)
from sqrp_cli.show.terminal.progress_lines import Verbosity, verbosity
from sqrp_cli.study.ranking import compared_quality
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult, Ranking

if TYPE_CHECKING:
    from sqrp_cli.search.planned_step import CheckedCandidate

SHORTEST_BLIND = 0.05  # blind ends of moves that cost less are not named [s]
MOST_ROWS = 20  # a ranking of more candidates shows only some, unless all are asked for


def print_ranking(found: Ranking, *, all_rows: bool = False) -> None:
    """What to do, the table, reasons and details. all_rows: however many; else the best for each choice of objects."""
    feasible, all_ways = found.feasible, found.ways == "all"
    if feasible:
        say(sentences.first_answer(feasible[0], worst=found.worst_first), "bold")
        say_assumed(found.assumed if feasible[0].faults else "")
        say()
    summary = sentences.summary(found.candidates, found.by, worst=found.worst_first)
    say(joined([(found.task, "bold"), f" in {found.workspace}: {summary}\n"]))
    if feasible:
        shown: Sequence[CandidateResult] = feasible
        if len(feasible) > MOST_ROWS and not all_rows:
            named = {one.name for one in (*feasible[:2], feasible[-1])} | first_of_each(feasible)
            shown = [one for one in feasible if one.name in named]
        _print_feasible(feasible, shown)
        if (drawn := found.calibration) is not None:
            errors = f"{1000 * drawn.position:g} mm, {degrees(drawn.rotation):g} deg (one standard deviation"
            say(f"\nIf every camera is off by {errors}; {drawn.draws} draws, 5th to 95th percentile):")
            of = {tuple(one.parameters.items()): one for one in drawn.candidates}
            pairs = [(one.name, of[tuple(one.parameters.items())]) for one in feasible]

            def span(ends: Sequence[float] | None) -> str:
                return "-" if ends is None else f"{100 * ends[0]:.1f} to {100 * ends[1]:.1f}"

            rows = [(name, span(o.q_eoi), span(o.q_avg), f"{o.first} of {drawn.draws}") for name, o in pairs]
            print_table([Column(""), *numbers("critical time seen [%]", "time seen [%]", "first in")], rows)
    for one in feasible:
        if one.remarks:
            say(f"{one.name}: {', '.join(one.remarks)}")
    print_infeasible((one.name, one.objects, one.why[0]) for one in found.candidates if not one.feasible)
    if feasible:
        say()
        for sentence in sentences.never_noticed(feasible):
            say(sentence, "red")
        for sentence in _sentences(feasible, found):
            say(sentence)
        if any("arm position" in one.choice for one in feasible):
            say("Arm positions are numbered: the same place of the tool, with the joints otherwise.", "dim")
        if len(feasible) > 1:
            say("* No other row is better in everything.", "dim")
        say(sentences.accuracy(found.sampling, feasible, short=verbosity.get() is not Verbosity.VERBOSE), "dim")
    if all_ways:
        print_ways(found.candidates)
    if found.interrupted:
        done = f"{len(found.candidates)} of {found.of} candidate{'s' * (found.of != 1)}"
        say(f"Interrupted at {done}: another one may be better.", "yellow")


def first_of_each(found: Iterable[CandidateResult | CheckedCandidate]) -> set[str]:
    """The names of the first candidate for each choice of objects, at most `MOST_ROWS`."""
    first: dict[tuple[str, ...], str] = {}
    for one in found:
        first.setdefault(tuple(one.objects.values()), one.name)
    return set(list(first.values())[:MOST_ROWS])


def _sentences(feasible: Sequence[CandidateResult], found: Ranking) -> Iterator[str]:
    """Why the last is last, what faster ways there are, and where no path helps."""
    last = feasible[0 if found.worst_first else -1]
    all_seen = last.verdict == f"{NOTHING_MISSING}."
    if len(feasible) > 1:
        beginning = f"Even with {last.name}, the last," if all_seen else f"Why {last.name} is last:"
        yield f"{beginning} {last.verdict[0].lower()}{last.verdict[1:]}"
    elif not all_seen:
        yield last.verdict
    faster, blind = [], []
    for one in feasible:
        first, *others = one.ways.pareto if one.ways is not None and one.ways.pareto else (None,)
        way = min(others, key=lambda other: other.time, default=None)
        # The fastest way that none beats, if it sees less than the best, as qualities are compared.
        if (
            first is not None
            and way is not None
            and f"{way.time:.1f}" != f"{first.time:.1f}"
            and way.time < first.time
            and any(
                compared_quality(own) < compared_quality(other)
                for own, other in ((way.q_eoi, first.q_eoi), (way.q_avg, first.q_avg))
            )
        ):
            faster.append(f"{one.name} {way.time:.1f} s instead of {first.time:.1f} s")
        total: dict[str, float] = {}
        for end in one.ways.blind_ends if one.ways is not None else ():
            total[end.at] = total.get(end.at, 0.0) + end.seconds
        if places := " and ".join(f"`{at}` {of:.1f} s" for at, of in total.items() if of >= SHORTEST_BLIND):
            blind.append(f"{one.name} {places}")
    if faster:
        where = "below" if found.ways == "all" else "--ways all"
        yield f"Faster, but seen worse: {sentences.first_few(faster, ', and')} ({where})."
    if blind:
        yield f"No path helps at ends of moves that the cameras do not see: {sentences.first_few(blind)}."


def print_ways(candidates: Iterable[CandidateResult]) -> None:
    """A table of the ways that no other beats, of each candidate that has several."""
    for one in candidates:
        if one.ways is not None and one.ways.pareto:
            known = f"{one.ways.feasible} of {one.ways.tried} ways can be done"
            say(f"\n{one.name}: {known}; none is better than these in everything:")
            titles = "critical\ntime\nseen [%]", "time\nseen\n[%]", "takes\n[s]", "noticed\nat the\nlatest [s]"
            rows = [
                (way.words, way.q_eoi, way.q_avg, seconds(way.time), delay(way.delay_worst, way.unseen))
                for way in one.ways.pareto
            ]
            print_table([Column("way"), *numbers(*titles)], rows)


_Filled = tuple[Column, Sequence[TableCell]]  # A column with the cells of all rows


def _print_feasible(feasible: Sequence[CandidateResult], shown: Sequence[CandidateResult]) -> None:
    """The table of those that are shown, how many are not, and which faults it is about."""
    first, faults = feasible[0], list(feasible[0].faults)

    def worst(column: Column, name: str, faults: Sequence[str], pattern: str = "{:.2f}") -> _Filled:
        """A figure of the worst of some faults, in red if one may never be noticed."""
        cells: list[TableCell] = []
        for one in shown:
            values = [getattr(one.faults[fault], name) for fault in faults]
            cells.append(styled("never" if None in values else pattern.format(max(values)), "red" * bool(one.unseen)))
        return column, cells

    mean, latest, q_eoi, q_avg, likely, takes, done = numbers(
        "noticed\nafter\n[s]", "at the\nlatest\n[s]", "critical\ntime\nseen [%]", "time\nseen\n[%]",
        "likely\nseen\n[%]", "takes\n[s]", "done\nafter a\nretry\n[s]",
    )  # fmt: skip
    figures: list[_Filled] = []
    if any(one.has_choice for one in feasible):
        figures.append((Column("way", shrink=True), [one.choice for one in shown]))
    if faults:
        figures += [worst(mean, "delay_mean", faults), worst(latest, "delay_worst", faults)]
    figures += [(q_eoi, [one.q_eoi for one in shown]), (q_avg, [one.q_avg for one in shown])]
    if any(one.q_expected is not None for one in feasible):
        figures.append((likely, [one.q_expected for one in shown]))
    figures.append((takes, [seconds(one.time) for one in shown]))
    if first.phases:
        figures.append((Column("seen least\nin", shrink=True), [one.worst_phase for one in shown]))
    if first.retried:
        figures.append(worst(done, "expected_time", first.retried, "{:.1f}"))

    star, differing = " *" * (len(feasible) > 1), sentences.differing_parameters(feasible)
    settings = [name for name in differing if name not in first.objects]
    begins: list[_Filled] = [(Column("#"), [f"{one.rank}{star * one.pareto}" for one in shown])]
    begins += [(Column(name), [one.objects[name] for one in shown]) for name in differing if name in first.objects]
    apart: list[_Filled] = [(Column(name), [one.settings[name] for one in shown]) for name in settings]
    in_one = [", ".join(f"{name} {one.settings[name]}" for name in settings) for one in shown]
    for middle in (apart, [(Column("with", shrink=True), in_one)]):  # where there is no room, one column for all
        filled = [*begins, *middle, *figures]
        columns, rows = [column for column, _ in filled], [*zip(*(cells for _, cells in filled), strict=True)]
        if fits(columns, rows):
            break
    print_table(columns, rows)
    if len(shown) < len(feasible):
        say(f"... and {len(feasible) - len(shown)} more (--all)", "dim")
    if len(faults) > 1:
        say(styled(f"Noticed: whichever takes longest, if {' or if '.join(map(first.happening, faults))}.", "dim"))


def print_infeasible(found: Iterable[tuple[str, Mapping[str, str], str]]) -> None:
    """A line for each reason that candidates share but for their objects; found: name, objects, reason of each."""
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for name, objects, reason in found:
        general = reason
        for parameter, bound in objects.items():
            general = re.sub(rf"(?<![\w-]){re.escape(bound)}(?![\w-])", f"<{parameter}>", general)
        groups.setdefault(general, []).append((name, " ".join(objects.values()) or name, reason))
    for general, group in groups.items():
        named, reasons = list(dict.fromkeys(each for _, each, _ in group)), {reason for _, _, reason in group}
        who = sentences.first_few(named) + (f", {len(group)} candidates" if len(group) > len(named) else "")
        who = group[0][0] if len(group) == 1 else who
        say(joined([("cannot be done: ", "red"), f"{who}: {general if len(reasons) > 1 else reasons.pop()}"]), indent=2)
