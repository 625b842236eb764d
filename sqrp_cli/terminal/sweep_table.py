"""What `sqrp score --vary` prints."""

from __future__ import annotations

import shlex
from pathlib import Path

from sqrp_cli.scoring.sweep import ScoredVariant, Sweep, from_here
from sqrp_cli.terminal.console import Column, Styled, plain, print_table, say, say_line

ROWS = 20
"""Variants that the table shows; the document has all."""

_FIGURES = ("Q_eoi\n[%]", "Q_avg\n[%]", "time\n[s]", "seen\nafter", "can be\ndone", "tasks\npassed")


def print_sweep(sweep: Sweep, patch: Path) -> None:
    """The table of variants, the best first, and what to do with it. patch: the file that makes the best of it."""
    paths = [path for path, _ in max((scored.variant.values for scored in sweep.variants), key=len)]
    columns = [Column("#", right=True), *(Column(name, right=True, shrink=True) for name in column_titles(paths))]
    columns += [Column(title, right=True) for title in _FIGURES]
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
    figures = [_figure(scored.q_eoi, 100, 1), _figure(scored.q_avg, 100, 1), _figure(scored.time, 1, 2)]
    figures += [_figure(scored.delay, 1, 2), f"{scored.feasible} of {scored.choices}"]
    errors = scored.findings.count("error")
    passed = f"{scored.passed} of {len(scored.findings.results)}"
    return [*cells, *figures, plain("error", "bold red") if errors else passed]


def _reasons(shown: list[tuple[int, ScoredVariant]]) -> dict[str, list[int]]:
    """Why variants cannot be scored, each reason with the ranks of those that it keeps."""
    found: dict[str, list[int]] = {}
    for rank, scored in shown:
        errors = [result.score for result in scored.findings.results if result.score.status == "error"]
        if errors:
            found.setdefault(errors[0].reasons[0], []).append(rank)
    return found


def _figure(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def column_titles(paths: list[str]) -> list[str]:
    """The end of each path under the name of what it belongs to, such as a camera; whole paths if two look alike."""
    titles = ["\n".join(_owner_and_end(path.split("."))) for path in paths]
    return titles if len(set(titles)) == len(titles) else paths


def _owner_and_end(words: list[str]) -> list[str]:
    named = words[0] in ("cameras", "objects", "detectors")
    owner, rest = (words[1:2], words[2:]) if named else (words[:1], words[1:])
    return [*owner, ".".join(rest[-2:])] if rest else owner
