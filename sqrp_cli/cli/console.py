"""What the terminal shows: tables, bars, progress and problems. The only module that knows Rich."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from sqrp_cli.errors import Problem

BAR_WIDTH = 8
"""Cells of a bar in a table."""

Styled = str | Text
"""Text with or without a style."""

_SEVERITY_STYLES = {"error": "bold red", "warning": "yellow"}


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Numbers are set to the right. shrink: whether long text may be folded to fit the terminal.
    """

    title: str
    right: bool = False
    shrink: bool = False


class _Output(Console):
    """A console that leaves it to its caller what a closed pipe means."""

    def on_broken_pipe(self) -> None:
        """Raise what Rich would turn into an exit."""
        raise BrokenPipeError


def output() -> Console:
    """The console of results, on stdout."""
    return _Output(highlight=False, soft_wrap=False, emoji=False)


def terminal_width() -> int:
    """Columns of the terminal that results go to."""
    return output().width


def diagnostics() -> Console:
    """The console of progress, warnings and errors, on stderr."""
    return Console(stderr=True, highlight=False, emoji=False)


def print_table(columns: Sequence[Column], rows: Iterable[Sequence[Styled]]) -> None:
    """A table without frames, two spaces between columns; where it does not fit, all columns are folded."""
    console, lines = output(), list(rows)
    widths = [
        max((cell_len(line) for cell in cells for line in str(cell).splitlines()), default=0)
        for cells in zip([column.title for column in columns], *lines, strict=True)
    ]
    fits = sum(width + 2 for column, width in zip(columns, widths, strict=True) if not column.shrink) <= console.width
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    for column in columns:
        table.add_column(
            Text(column.title, style="bold"),
            justify="right" if column.right else "left",
            no_wrap=not column.shrink and fits,
            overflow="fold",
        )
    for cells in lines:
        # Leading blanks, as of an empty bar, would take the place that a folded number needs.
        table.add_row(*(cell if fits else cell[len(str(cell)) - len(str(cell).lstrip()) :] for cell in cells))
    console.print(table)


def say(text: Styled = "", style: str | None = None) -> None:
    """A paragraph of results, folded at the terminal's width."""
    output().print(text, style=style, markup=False)


def say_raw(text: str) -> None:
    """Text for other programs, unchanged."""
    sys.stdout.write(text + "\n")


def note(text: str) -> None:
    """A line that is not part of the results."""
    diagnostics().print(text, style="dim", markup=False, soft_wrap=True)


def ask(question: str) -> str:
    """What the user answers, without blanks around it; raises EOFError if there is no more input.

    An answer that no terminal shows, as from a pipe, is repeated.
    """
    answer = input(question).strip()
    if not sys.stdin.isatty():
        say_raw(answer)
    return answer


def print_problems(problems: Iterable[Problem]) -> None:
    """Problems on stderr: place, what was found and expected, the line with a caret, and what mends it."""
    console = diagnostics()
    for problem in problems:
        line = Text.assemble((f"{problem.severity}: ", _SEVERITY_STYLES[problem.severity]))
        if problem.place is not None:
            line.append(f"{problem.place}: ", style="bold")
        line.append(problem.message)
        console.print(line, soft_wrap=True)
        if problem.excerpt:
            console.print(Text(problem.excerpt, style="dim"), soft_wrap=True)
        if problem.mend:
            console.print(Text.assemble(("  to mend it: ", "dim"), problem.mend), soft_wrap=True)


def percentage(share: float | None) -> Text:
    """A share as a bar and a number: green from 90 %, red below 50 %."""
    if share is None:
        return Text("-".rjust(BAR_WIDTH + 6), style="dim")
    style = "green" if share >= 0.9 else "yellow" if share >= 0.5 else "red"
    filled = bar(share)
    return Text.assemble((filled, style), (f"{100 * share:6.1f}", style))


def bar(share: float) -> str:
    """A horizontal bar of `BAR_WIDTH` cells in eighths of a cell."""
    eighths = round(share * BAR_WIDTH * 8)
    full, rest = divmod(eighths, 8)
    return ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(BAR_WIDTH)


class Step(Protocol):
    """Called when more parts of the work are done."""

    def __call__(self, count: int = 1) -> None:
        """Count them."""


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Step]:
    """Progress on stderr with done/total and time left; it vanishes when done, and log files get none.

    total: None where it is not known beforehand.
    """
    console = diagnostics()
    columns = [
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
    ]
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        task = bars.add_task(title, total=total)
        yield lambda count=1: bars.advance(task, count)


def plain(text: str, style: str = "") -> Text:
    """Text in one style."""
    return Text(text, style=style)


def joined(parts: Sequence[Styled | tuple[str, str]]) -> Text:
    """Pieces of text, each with its own style, in a row."""
    return Text.assemble(*parts)
