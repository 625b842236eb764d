"""The output of `sqrp score`, with and without `--vary`, and `sqrp diff`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from sqrp_cli.score.result import Scorecard, Sweep, TaskScore, listed
from sqrp_cli.show.terminal.console import (
    Column,
    Styled,
    delay,
    joined,
    numbers,
    percent,
    plain,
    print_table,
    say,
    say_line,
    seconds,
)

_STYLES = {"passed": "green", "failed": "red", "error": "bold red"}

ROWS = 20  # variants in the table; the document has all

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst", "can be\ndone", "tasks\npassed")


def print_scorecard(findings: Scorecard) -> None:
    """The table with a row per task, then a sentence for every failure; of two versions what differs."""
    if findings.document == "diff":
        print_difference(findings)
        return
    if findings.results:
        print_results(findings.results)
    for score in findings.results:
        for reason in score.reasons:
            named = score.task is None or reason.startswith(score.task)
            where = score.workspace if named else score.named
            say(joined(["\n", (score.status, _STYLES[score.status]), f" {where}: {reason}"]))
    print_comparison(findings)
    if findings.results:
        say()
    if findings.results or findings.interrupted:
        say(verdict(findings))


def print_results(results: Sequence[TaskScore]) -> None:
    """The table with a row per task."""
    columns = [Column("workspace", shrink=True), Column("task", shrink=True), Column("best", shrink=True)]
    columns += numbers("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst")
    print_table([*columns, Column("")], [_row(result) for result in results])


def print_comparison(findings: Scorecard) -> None:
    """Improvements, new and vanished tasks, and what changed where nothing got worse."""
    for result in findings.results:
        comparison = result.baseline
        if comparison is None:
            continue
        for change in comparison.ways:
            if not change.worse:
                say(joined(["\n", ("improved", "green"), f" {result.named} for {change}"]))
        if comparison.verdict == "new":
            say(joined(["\n", ("new", "yellow"), f" {result.named} is not in the baseline"]))
        for way in comparison.gone:
            say(joined(["\n", ("gone", "yellow"), f" {result.named} for {way}: there is no such way any more"]))
    for name, before in findings.renamed.items():
        say(joined(["\n", ("renamed", "yellow"), f" {name} is {before} of the baseline"]))
    style = "yellow" if findings.may_vanish else "red"
    for gone in findings.vanished:
        say(joined(["\n", ("vanished", style), f" {gone.workspace}, {gone.task} is only in the baseline"]))
    missing = findings.vanished or any(one.baseline and one.baseline.gone for one in findings.results)
    if missing and not findings.may_vanish:
        say("\nWhat is gone fails: --allow-missing lets it pass, --save-baseline makes a new baseline.")
    worse = {result.workspace for result in findings.results if result.baseline and result.baseline.ways}
    for workspace, changes in findings.changes.items():
        if changes and workspace not in worse:
            say(joined(["\n", ("changed", "dim"), f" {workspace}, with no effect: {listed(changes)}"]))


def print_difference(findings: Scorecard) -> None:
    """What differs between two versions, and the effect on every way of doing a task."""
    if findings.interrupted:
        say("Interrupted before the two versions could be compared.")
        return
    changes = [change for changes in findings.changes.values() for change in changes]
    say("What differs in the workspace:" if changes else "Nothing that matters differs in the workspace.")
    for change in changes:
        say(f"  {change}", indent=4)
    ways = [(result, change) for result in findings.results if result.baseline for change in result.baseline.ways]
    say("\nWhat that does:" if ways else "\nNo task gets better or worse.")
    for result, way in ways:
        mixed = any(not shift.worse for shift in way.shifts)
        mark = ("better", "green") if not way.worse else ("mixed ", "yellow") if mixed else ("worse ", "red")
        say(joined(["  ", mark, f"  {result.task} for {way}"]), indent=10)
    for result in findings.results:
        if result.baseline and result.baseline.verdict == "new":
            say(joined(["  ", ("new   ", "yellow"), f"  {result.task}"]), indent=10)
        for name in result.baseline.gone if result.baseline else ():
            say(joined(["  ", ("gone  ", "yellow"), f"  {result.task} for {name}"]), indent=10)
    for vanished in findings.vanished:
        say(joined(["  ", ("gone  ", "yellow"), f"  {vanished.task}"]), indent=10)
    if changes:
        say("Compared are the best ways of both versions; what changes by less than --allow is left out.")


def verdict(findings: Scorecard) -> str:
    """The sentence that ends a run."""
    total = len(findings.results) + (findings.unfinished or 0)
    of_all = f"of {total} task{'s' if total != 1 else ''}"
    counts = [f"{findings.count('passed')} {of_all} passed"]
    if findings.interrupted:
        done = len(findings.results)
        were = "was" if 1 in (done, total) else "were"
        counts = [f"Interrupted: {done} {of_all} {were} finished", f"{findings.count('passed')} passed"]
    counts += [f"{findings.count('failed')} failed"] if findings.count("failed") else []
    errors = findings.count("error")
    counts += [f"{errors} could not be scored"] if errors else []
    counts += [f"{len(findings.vanished)} vanished"] if findings.vanished and not findings.may_vanish else []
    return ", ".join(counts) + "."


def print_sweep(found: Sweep) -> None:
    """The table of variants, the best first, and the command that applies the best."""
    paths = max((list(one.values) for one in found.variants), key=len)
    columns = [Column("#", right=True), *(Column(name, right=True, shrink=True) for name in column_titles(paths))]
    columns += numbers(*_FIGURES)
    shown = [one for one in found.variants if one.rank <= ROWS or not one.values]
    rows: list[list[Styled]] = []
    reasons: dict[str, list[int]] = {}
    for one in shown:
        errors = [result for result in one.results if result.status == "error"]
        if errors:
            reasons.setdefault(errors[0].reasons[0], []).append(one.rank)
        passed = f"{sum(result.status == 'passed' for result in one.results)} of {len(one.results)}"
        rows.append(
            [
                str(one.rank),
                *(one.values.get(path, "as it is") for path in paths),
                *(percent(one.q_eoi), percent(one.q_avg), seconds(one.time), delay(one.delay, one.unseen)),
                f"{one.feasible} of {one.choices}",
                plain("error", "bold red") if errors else passed,
            ]
        )
    print_table(columns, rows)
    for reason, ranks in reasons.items():
        say(f"{', '.join(f'#{rank}' for rank in ranks)}: {reason}")
    if len(found.variants) > len(shown):
        say(plain(f"{len(found.variants) - len(shown)} more are in the document of --json.", "dim"))
    say(plain("Figures are means over the choices of objects, of every task, that can be done.", "dim"))
    say()
    if found.patch is None:
        say("None is better than the workspace as it is.")
        return
    values = ", ".join(f"{path} = {value}" for path, value in found.best.items())
    among = "" if found.equals == 1 else f" Of {found.equals} that are as good it has the most room around it."
    say(f"Best is {values}.{among} To have it:")
    say_line(f"  patch {shlex.quote(found.file)} < {shlex.quote(found.patch)}")


def column_titles(paths: list[str]) -> list[str]:
    """Titles: the end of each path under the name of its owner, such as a camera; whole paths if two look alike."""
    titles = ["\n".join(_owner_and_end(path.split("."))) for path in paths]
    return titles if len(set(titles)) == len(titles) else paths


def _row(score: TaskScore) -> list[Styled]:
    status = plain(score.status, _STYLES[score.status])
    if score.best is None:
        return [score.workspace, score.task or "", "", "", "", "", "", status]
    best = score.best
    figures = [percent(best.q_eoi), percent(best.q_avg), seconds(best.time), delay(best.delay_worst, best.unseen)]
    return [score.workspace, score.task or "", best.name, *figures, status]


def _owner_and_end(words: list[str]) -> list[str]:
    named = words[0] in ("cameras", "objects", "detectors")
    owner, rest = (words[1:2], words[2:]) if named else (words[:1], words[1:])
    return [*owner, ".".join(rest[-2:])] if rest else owner
