"""The output of `sqrp score`, with and without `--vary`, and `sqrp diff`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from sqrp_cli.knowledge.text.yaml_edit import from_here
from sqrp_cli.scoring.scorecard import ComparedScore, Scorecard, listed
from sqrp_cli.scoring.sweep import ScoredVariant, Sweep
from sqrp_cli.terminal.console import (
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

ROWS = 20
"""Variants in the table; the document has all."""

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst", "can be\ndone", "tasks\npassed")


def print_report(findings: Scorecard) -> None:
    """The table with a row per task, then a sentence for every failure."""
    if findings.results:
        print_results(findings.results)
    for result in findings.results:
        score = result.score
        for reason in score.reasons:
            named = score.task is None or reason.startswith(score.task)
            where = score.workspace if named else result.score.named
            say(joined(["\n", (score.status, _STYLES[score.status]), f" {where}: {reason}"]))
    print_comparison(findings)
    if findings.results:
        say()
    if findings.results or findings.interrupted:
        say(verdict(findings))


def print_results(results: Sequence[ComparedScore]) -> None:
    """The table with a row per task."""
    columns = [Column("workspace", shrink=True), Column("task", shrink=True), Column("best", shrink=True)]
    columns += numbers("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nat worst")
    print_table([*columns, Column("")], [_row(result) for result in results])


def print_comparison(findings: Scorecard) -> None:
    """Improvements, new and vanished tasks, and what changed where nothing got worse."""
    for result in findings.results:
        comparison = result.comparison
        if comparison is None:
            continue
        for change in comparison.ways:
            if not change.worse:
                say(joined(["\n", ("improved", "green"), f" {result.score.named} for {change}"]))
        if comparison.verdict == "new":
            say(joined(["\n", ("new", "yellow"), f" {result.score.named} is not in the baseline"]))
        for way in comparison.gone:
            say(joined(["\n", ("gone", "yellow"), f" {result.score.named} for {way}: there is no such way any more"]))
    for name, before in findings.renamed.items():
        say(joined(["\n", ("renamed", "yellow"), f" {name} is {before} of the baseline"]))
    style = "yellow" if findings.may_vanish else "red"
    for gone in findings.vanished:
        say(joined(["\n", ("vanished", style), f" {gone.workspace}, {gone.task} is only in the baseline"]))
    missing = findings.vanished or any(one.comparison and one.comparison.gone for one in findings.results)
    if missing and not findings.may_vanish:
        say("\nWhat is gone fails: --allow-missing lets it pass, --save-baseline makes a new baseline.")
    worse = {result.score.workspace for result in findings.results if result.comparison and result.comparison.ways}
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
    ways = [(result, change) for result in findings.results if result.comparison for change in result.comparison.ways]
    say("\nWhat that does:" if ways else "\nNo task gets better or worse.")
    for result, way in ways:
        mark = ("better", "green") if not way.worse else ("mixed ", "yellow") if way.better else ("worse ", "red")
        say(joined(["  ", mark, f"  {result.score.task} for {way}"]), indent=10)
    for result in findings.results:
        if result.comparison and result.comparison.verdict == "new":
            say(joined(["  ", ("new   ", "yellow"), f"  {result.score.task}"]), indent=10)
        for name in result.comparison.gone if result.comparison else ():
            say(joined(["  ", ("gone  ", "yellow"), f"  {result.score.task} for {name}"]), indent=10)
    for vanished in findings.vanished:
        say(joined(["  ", ("gone  ", "yellow"), f"  {vanished.task}"]), indent=10)
    if changes:
        say("Compared are the best ways of both versions; what changes by less than --allow is left out.")


def verdict(findings: Scorecard) -> str:
    """The sentence that ends a run."""
    total = len(findings.results) + findings.unfinished
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


def print_sweep(sweep: Sweep, patch: Path) -> None:
    """The table of variants, the best first, and how to apply it. patch: the file with the best variant."""
    paths = [path for path, _ in max((scored.variant.values for scored in sweep.variants), key=len)]
    columns = [Column("#", right=True), *(Column(name, right=True, shrink=True) for name in column_titles(paths))]
    columns += numbers(*_FIGURES)
    shown = list(enumerate(sweep.variants[:ROWS], 1))
    shown += [
        (rank, scored) for rank, scored in enumerate(sweep.variants, 1) if rank > ROWS and not scored.variant.values
    ]
    print_table(columns, [_variant_row(rank, scored, paths) for rank, scored in shown])
    for reason, ranks in _reasons(shown).items():
        say(f"{', '.join(f'#{rank}' for rank in ranks)}: {reason}")
    if len(sweep.variants) > len(shown):
        say(plain(f"{len(sweep.variants) - len(shown)} more are in the document of --json.", "dim"))
    say(plain("Figures are means over the choices of objects, of every task, that can be done.", "dim"))
    say()
    _conclude(sweep, patch)


def column_titles(paths: list[str]) -> list[str]:
    """Titles: the end of each path under the name of its owner, such as a camera; whole paths if two look alike."""
    titles = ["\n".join(_owner_and_end(path.split("."))) for path in paths]
    return titles if len(set(titles)) == len(titles) else paths


def _row(result: ComparedScore) -> list[Styled]:
    score = result.score
    status = plain(score.status, _STYLES[score.status])
    if score.best is None:
        return [score.workspace, score.task or "", "", "", "", "", "", status]
    best = score.best
    figures = [percent(best.q_eoi), percent(best.q_avg), seconds(best.time), delay(best.delay_worst, best.unseen)]
    return [score.workspace, score.task or "", best.candidate.name, *figures, status]


def _conclude(found: Sweep, patch: Path) -> None:
    """Which values are best, and the command that sets them."""
    if not found.patch:
        say("None is better than the workspace as it is.")
        return
    values = ", ".join(f"{path} = {value}" for path, value in found.best.variant.values)
    among = "" if found.equals == 1 else f" Of {found.equals} that are as good it has the most room around it."
    say(f"Best is {values}.{among} To have it:")
    say_line(f"  patch {shlex.quote(from_here(found.document.path))} < {shlex.quote(str(patch))}")


def _variant_row(rank: int, scored: ScoredVariant, paths: list[str]) -> list[Styled]:
    values = dict(scored.variant.values)
    cells: list[Styled] = [str(rank), *(values.get(path, "as it is") for path in paths)]
    figures = [percent(scored.q_eoi), percent(scored.q_avg), seconds(scored.time), delay(scored.delay, scored.unseen)]
    figures.append(f"{scored.feasible} of {scored.choices}")
    errors = scored.findings.count("error")
    passed = f"{scored.passed} of {len(scored.findings.results)}"
    return [*cells, *figures, plain("error", "bold red") if errors else passed]


def _reasons(shown: list[tuple[int, ScoredVariant]]) -> dict[str, list[int]]:
    """Why variants cannot be scored: each reason with the ranks of its variants."""
    found: dict[str, list[int]] = {}
    for rank, scored in shown:
        errors = [result.score for result in scored.findings.results if result.score.status == "error"]
        if errors:
            found.setdefault(errors[0].reasons[0], []).append(rank)
    return found


def _owner_and_end(words: list[str]) -> list[str]:
    named = words[0] in ("cameras", "objects", "detectors")
    owner, rest = (words[1:2], words[2:]) if named else (words[:1], words[1:])
    return [*owner, ".".join(rest[-2:])] if rest else owner
