"""The output of `sqrp advise`: the changes that meet the wish, what they cost, and what to do."""

from __future__ import annotations

from itertools import groupby

from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.report.documents import advice
from sqrp_cli.report.sentences import KIND_WORDS, shown_size
from sqrp_cli.terminal.console import (
    Column,
    Styled,
    joined,
    numbers,
    percent,
    plain,
    print_table,
    say,
    say_command,
    seconds,
)

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nafter", "up to")


def print_advice(found: advice.AdviceDocument, wish: Wish, *, fastest: bool, fixed: bool) -> None:
    """The table with a row for each change that meets the wish, why other kinds do not, and what to do.

    fastest: whether the figures of before are those with `--ways fastest`, else of the best way. fixed: whether the
    motion stays as it is.
    """
    say(joined([(found.task, "bold"), f" in {found.workspace}: {found.candidate} is to have {wish}\n"]))
    as_it_is = "As it moves with --ways fastest" if fastest else "In its best way, as rank takes it"
    say(f"{as_it_is}, it has {_figures(found.before)}.")
    if found.met:
        say("\nThat is met already: nothing has to change.")
        return
    if found.advice:
        say()
        columns = [*numbers("#"), Column("change", shrink=True), *numbers(*_FIGURES)]
        print_table(columns, [_row(number, one) for number, one in enumerate(found.advice, 1)])
    for number, one in enumerate(found.advice, 1):
        for cost in advice.costs(one.tasks):
            say(joined([(f"#{number} costs", "red"), f" {cost}"]), indent=4)
    if held := advice.held_ways(found.advice, fixed=fixed):
        say(held)
    for why, same in groupby((one for one in found.kinds if not one.found), key=lambda one: one.why):
        outcomes = list(same)
        names = ", ".join(KIND_WORDS[outcome.kind] for outcome in outcomes)
        say(joined([("no   ", "dim"), f" {names}: {why}"]), indent=6)
        for outcome in outcomes:
            _print_nearest(outcome)
    say()
    _conclude(found)


def _conclude(found: advice.AdviceDocument) -> None:
    """One sentence that says what to do."""
    if found.interrupted:
        say("Interrupted before all kinds were searched.")
    if not found.advice:
        _conclude_without(found)
        return
    motion = ("way", "path")
    number = next((n for n, one in enumerate(found.advice, 1) if one.kind in motion or not one.worse), 1)
    one = found.advice[number - 1]
    cost = "no task gets worse" if not one.worse else "what it costs is said above"
    words = one.words
    say(f"{words[0].upper()}{words[1:]}: {found.candidate} then has {_figures(one)}, and {cost}.")
    if one.patch:
        say_command("To have it, add", f"--apply {number}")
    elif one.unwritten:
        say(f"No patch: {one.unwritten}.")


def _conclude_without(found: advice.AdviceDocument) -> None:
    """What comes nearest, and what has to be done before, where nothing was found."""
    nothing = "Nothing that was searched so far" if found.interrupted else "Nothing"
    if found.nearest is not None:
        say(f"{nothing} meets the wish. {advice.nearest_in_words(found.nearest)}.")
    elif found.first:
        say(f"No change helps: {found.first}.")
        say_command("These steps as a program:", "sqrp check WORKSPACE TASK --program FILE")
    elif found.kinds:
        say("Nothing that was tried meets the wish.")


def _row(number: int, one: advice.AdviceFound) -> list[Styled]:
    room = "-" if one.margin is None else shown_size(one.size + one.margin.more, one.unit)
    figures = [percent(one.q_eoi), percent(one.q_avg), seconds(one.time), seconds(one.delay_worst)]
    return [str(number), one.words, *figures, room]


def _print_nearest(outcome: advice.KindOutcome) -> None:
    nearest = outcome.nearest
    if nearest is not None:
        then = f"nearest: {nearest.words}, then {'; '.join(nearest.missing)}"
        near = then if nearest.nearer else "nothing comes nearer"
        limit = f" ({nearest.limit})" if nearest.limit else ""
        say(plain(f"      {near}{limit}", "dim"), indent=6)


def _figures(found: advice.AdvisedFigures) -> str:
    parts = [f"Q_eoi {100 * found.q_eoi:.1f} %"] if found.q_eoi is not None else []
    parts += [f"Q_avg {100 * found.q_avg:.1f} %"] if found.q_avg is not None else []
    if found.time is None:
        return "no feasible motion"
    return ", ".join([*parts, f"{found.time:.1f} s"])
