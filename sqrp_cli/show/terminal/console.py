"""What the terminal shows: tables, bars, progress and problems. The only module that knows Rich.

All text but JSON goes through here and is cleaned (`_text`, `_put`): names, paths and tasks come from files that
others wrote.
"""

from __future__ import annotations

import io
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

from rich.cells import cell_len
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from sqrp_cli.errors import Problem
from sqrp_cli.records import dataclass
from sqrp_cli.show.terminal.progress_lines import Advance, Verbosity, progress_lines, verbosity
from sqrp_cli.shown import harmless, one_line

BAR_WIDTH = 8
"""Cells of a bar in a table."""

Styled = str | Text
"""Text with or without a style; only `plain`, `joined` and `percentage` make a Text, so it is clean."""

PROGRESS_WIDTH = 20
"""Cells of the progress bar."""

LEAST_WIDTH = 20
"""Least width that lines are laid out for, even in a narrower terminal [columns]."""

LONGEST_TITLE = 9
"""Words of a title up to this length are never broken."""

LEAST_FOLDED = 16
"""Least width of a column with folded text [cells]."""

_BEFORE_UNIT = re.compile(r"(?<=[0-9]) (?=(?:s|ms|%|m|mm|cm|deg|px|Hz|points?)(?![A-Za-z]))")
"""A space between a number and its unit, where no line is folded."""

_KEPT = "\ue000"
"""Stands for that space meanwhile, as no text has it."""

SEVERITY_STYLES = {"error": "bold red", "warning": "yellow"}
"""Styles of errors and warnings."""


@dataclass(frozen=True)
class Column:
    """A column of a table. Its title may have several lines.

    Numbers are right-aligned. shrink: whether long text may be folded to fit the terminal.
    """

    title: str
    right: bool = False
    shrink: bool = False


def numbers(*titles: str) -> list[Column]:
    """Columns of numbers."""
    return [Column(title, right=True) for title in titles]


def percent(share: float | None) -> str:
    """A share in 0..1 as it stands in a column of per cent."""
    return "-" if share is None else f"{100 * share:.1f}"


def delay(worst: float | None, unseen: float | None) -> str:
    """A delay [s] as it stands in a column; unseen: the share of faults that may never be noticed."""
    return "never" if unseen else seconds(worst)


def seconds(t: float | None, sign: str = "") -> str:
    """A time [s] as it stands in a column; sign: before it."""
    return "-" if t is None else f"{sign}{t:.2f}"


@dataclass(frozen=True)
class Share:
    """A cell with a share in 0..1: a bar and a number, or only the number if space is short."""

    value: float | None


Cell = Styled | Share
"""What a table may hold."""


_captured: ContextVar[Console | None] = ContextVar("captured", default=None)
"""The console of results while they are captured as text."""

NOTEBOOK_WIDTH = 100
"""Columns of results in a notebook."""


def as_plain_text(show: Callable[[], None]) -> str:
    """The results that a function prints, without styles, in the width of the terminal."""
    console = Console(file=io.StringIO(), width=terminal_width(), highlight=False, emoji=False, no_color=True)
    with _instead(console):
        show()
    text = console.file.getvalue()  # type: ignore[attr-defined] # it is kept in memory
    return str(text).rstrip("\n")


def as_html(show: Callable[[], None]) -> str:
    """The results that a function prints, with their colours, for a notebook."""
    console = Console(
        file=io.StringIO(),
        width=NOTEBOOK_WIDTH,
        highlight=False,
        emoji=False,
        record=True,
        force_terminal=True,
        color_system="truecolor",
        no_color=False,
    )
    with _instead(console):
        show()
    return console.export_html(inline_styles=True, code_format='<pre style="line-height: 1.25">{code}</pre>')


@contextmanager
def _instead(console: Console) -> Iterator[None]:
    token = _captured.set(console)
    try:
        yield
    finally:
        _captured.reset(token)


def output() -> Console:
    """The console of results: on stdout, unless they are captured as text."""
    captured = _captured.get()
    if captured is not None:
        return captured
    console = Console(highlight=False, soft_wrap=False, emoji=False)
    console.width = max(console.width, LEAST_WIDTH)
    return console


def terminal_width() -> int:
    """Width of the terminal of results [columns]."""
    return output().width


def diagnostics() -> Console:
    """The console of progress, warnings and errors, on stderr."""
    return Console(stderr=True, highlight=False, emoji=False)


def print_table(columns: Sequence[Column], rows: Iterable[Sequence[Cell]]) -> None:
    """A table without frames, two spaces between columns.

    If the terminal is too narrow, bars are left out and titles broken; if that is not enough, each row becomes a
    paragraph of titles and values, in which no figure is folded.
    """
    console, lines = output(), list(rows)
    for narrow in (False, True):
        cells = [[_styled(cell, bar=not narrow) for cell in line] for line in lines]
        titles = [_title(column) for column in columns]
        if narrow:
            widest = [max((cell_len(str(line[number])) for line in cells), default=0) for number in range(len(columns))]
            titles = [_broken(title, width) for title, width in zip(titles, widest, strict=True)]
        if _width(columns, titles, cells) <= console.width:
            _print_grid(console, _grid(columns, titles, cells))
            return
    for line in lines:
        head, *values = (_styled(cell, bar=False) for cell in line)
        named = zip([_title(column) for column in columns[1:]], values, strict=True)
        pairs = [Text.assemble(*_named(title), value) for title, value in named if str(value).strip()]
        name = Text.assemble(*_named(_title(columns[0])), head, style="bold")
        say(Text.assemble(*((name, ": " if pairs else "") if head.plain.strip() else ()), unbroken(pairs)), indent=2)


def fits(columns: Sequence[Column], rows: Sequence[Sequence[Cell]]) -> bool:
    """Whether the terminal is wide enough for these columns, bars left out, so that no row becomes a paragraph."""
    cells = [[_styled(cell, bar=False) for cell in row] for row in rows]
    widest = [max((cell_len(str(line[number])) for line in cells), default=0) for number in range(len(columns))]
    titles = [_broken(_title(column), width) for column, width in zip(columns, widest, strict=True)]
    return _width(columns, titles, cells) <= output().width


def _styled(cell: Cell, *, bar: bool) -> Text:
    if isinstance(cell, Share):
        return percentage(cell.value, bar=bar)
    return cell if isinstance(cell, Text) else Text(one_line(cell))


def _title(column: Column) -> str:
    return "\n".join(one_line(line) for line in column.title.split("\n"))


def _named(title: str) -> tuple[str, ...]:
    return (" ".join(title.split()), " ") if title else ()


def _broken(title: str, width: int) -> str:
    """A title in lines that fit its column, or else are as short as possible."""
    words = [word if len(word) <= LONGEST_TITLE else word.replace("_", "_\n") for word in title.split()]
    lines = words[:1]
    for word in words[1:]:
        longer = f"{lines[-1]} {word}"
        lines[-1:] = [longer] if len(longer) <= width else [lines[-1], word]
    return "\n".join(lines)


def _width(columns: Sequence[Column], titles: Sequence[str], cells: Sequence[Sequence[Text]]) -> int:
    """Least width of a table."""
    total = 2 * (len(columns) - 1)
    for column, title, values in zip(columns, titles, zip(*cells, strict=True) if cells else titles, strict=True):
        widest = max(cell_len(line) for text in (title, *map(str, values)) for line in text.split("\n"))
        total += min(widest, LEAST_FOLDED) if column.shrink else widest
    return total


def _grid(columns: Sequence[Column], titles: Sequence[str], cells: Sequence[Sequence[Text]]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    for column, title in zip(columns, titles, strict=True):
        justify: Literal["left", "right"] = "right" if column.right else "left"
        table.add_column(Text(title, style="bold"), justify=justify, no_wrap=not column.shrink, overflow="fold")
    for line in cells:
        table.add_row(*line)
    return table


def _print_grid(console: Console, grid: Table) -> None:
    """Print a table without the blanks that pad its last column; Rich has no option for this."""
    for segments in console.render_lines(grid, pad=False):
        line = Text.assemble(*((segment.text, segment.style or "") for segment in segments))
        line.rstrip()
        _put(console, line)


def _put(console: Console, line: Text) -> None:
    """Print a line as it is, unless a CI server would take it for a command."""
    line.plain = harmless(line.plain)
    console.print(line, soft_wrap=True)


def _text(text: Styled, style: str = "") -> Text:
    """Clean text. One line break may begin and one may end it; any other comes from foreign data."""
    if isinstance(text, Text):
        return Text.assemble(text, style=style)
    shown = one_line(text)
    before, after = text[:1] == "\n", text[1:][-1:] == "\n"
    return Text("\n" * before + shown[before : len(shown) - after] + "\n" * after, style=style)


def say(text: Styled = "", style: str | None = None, *, indent: int = 0) -> None:
    """A paragraph of results, folded at the terminal's width. indent: of all lines but the first, if there is room."""
    console = output()
    indent = min(indent, console.width - LEAST_WIDTH)
    whole = _text(text, style or "")
    whole.plain = _BEFORE_UNIT.sub(_KEPT, whole.plain)
    for number, line in enumerate(whole.wrap(console, console.width - indent)):
        line.plain = line.plain.replace(_KEPT, " ")
        line.rstrip()
        _put(console, Text.assemble(" " * indent if number else "", line))


def unbroken(parts: Iterable[Styled], between: str = ", ") -> Text:
    """Parts in a row, which `say` folds between them and not within one, save one that is too long for a line."""
    found = [_text(part) for part in parts]
    for part in found:
        if cell_len(part.plain) < terminal_width() - 2:
            part.plain = part.plain.replace(" ", _KEPT)
    return Text(between).join(found)


def say_command(text: str, command: str, style: str | None = None) -> None:
    """A sentence that ends in a command. The command is never folded, so that it can be copied.

    If the terminal is too narrow for both, the command gets its own line.
    """
    if cell_len(f"{text} {command}") <= output().width:
        say(f"{text} {command}", style)
        return
    say(text, style)
    say_line(command, style)


def say_line(text: Styled, style: str | None = None) -> None:
    """A line of results that is never folded."""
    _put(output(), _text(text, style or ""))


def say_raw(text: str) -> None:
    """Text for other programs, unchanged: only for JSON, which escapes control characters."""
    sys.stdout.write(text + "\n")


def note(text: str) -> None:
    """A line that is not part of the results."""
    if verbosity.get() is Verbosity.QUIET:
        return
    _put(diagnostics(), _text(text, "dim"))


def ask(question: str) -> str:
    """The user's answer, without blanks around it; raises EOFError if there is no more input.

    An answer from a pipe is echoed, since no terminal shows it.
    """
    answer = input(harmless(_text(question).plain)).strip()
    if not sys.stdin.isatty():
        sys.stdout.write(one_line(answer) + "\n")
    return answer


def print_problems(problems: Iterable[Problem]) -> None:
    """Problems on stderr: place, what was found and expected, the line with a caret, and how to mend it."""
    console, quiet = diagnostics(), verbosity.get() is Verbosity.QUIET
    for problem in problems:
        if quiet and problem.severity != "error":
            continue
        line = Text.assemble((f"{problem.severity}: ", SEVERITY_STYLES[problem.severity]))
        if problem.place is not None:
            line.append(f"{one_line(str(problem.place))}: ", style="bold")
        line.append(one_line(problem.message))
        _put(console, line)
        if problem.excerpt and problem.excerpt.partition("\n")[0].strip():
            for part in problem.excerpt.split("\n"):
                _put(console, _text(part.expandtabs(), "dim"))
        if problem.mend:
            _put(console, Text.assemble(("  to mend it: ", "dim"), one_line(problem.mend)))


def percentage(share: float | None, *, bar: bool) -> Text:
    """A share as a number, with a bar before it: green from 90 %, red below 50 %."""
    if share is None:
        return Text("-".rjust(BAR_WIDTH + 6) if bar else "-", style="dim")
    style = "green" if share >= 0.9 else "yellow" if share >= 0.5 else "red"
    figure = f"{100 * share:.1f}"
    return Text(f"{blocks(share)} {figure:>5}" if bar else figure, style=style)


def blocks(share: float) -> str:
    """A horizontal bar of `BAR_WIDTH` cells in eighths of a cell."""
    eighths = round(share * BAR_WIDTH * 8)
    full, rest = divmod(eighths, 8)
    return ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(BAR_WIDTH)


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Advance]:
    """Progress on stderr with done/total and time left, which vanishes when done; log files get a line now and then.

    total: None if it is not known beforehand.
    """
    began = time.monotonic()
    with _progress(title, total) as advance:
        yield advance
    if verbosity.get() is Verbosity.VERBOSE:
        note(f"{title}: {time.monotonic() - began:.1f} s")


@contextmanager
def _progress(title: str, total: int | None) -> Iterator[Advance]:
    console = diagnostics()
    if verbosity.get() is Verbosity.QUIET:
        yield _nothing
        return
    if not console.is_terminal:
        with progress_lines(title, total, note) as advance:
            yield advance
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = [
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=PROGRESS_WIDTH),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
    ]
    # Rich cuts the end of a long line first, but what follows the title matters more.
    rest = PROGRESS_WIDTH + len(f" {total}/{total} -:--:-- ")
    shown = _text(title)
    shown.truncate(max(console.width - rest - 1, LEAST_WIDTH), overflow="ellipsis")
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task(shown.plain, total=total)
        yield lambda count=1: bars.advance(task, count)


def _nothing(count: int = 1) -> None:
    """Progress that nobody is shown."""


Show = Callable[[Styled], None]
"""Called with the new text to show: replaces what was shown."""


@contextmanager
def live() -> Iterator[Show | None]:
    """Text on stderr that changes in place and vanishes when done; None if stderr is no terminal, or quiet."""
    console = diagnostics()
    if not console.is_terminal or verbosity.get() is Verbosity.QUIET:
        yield None
        return
    with Live(console=console, transient=True, auto_refresh=False) as screen:
        yield lambda text: screen.update(text, refresh=True)


def plain(text: Styled, style: str = "") -> Text:
    """Text in one style."""
    return _text(text, style)


def joined(parts: Sequence[Styled | tuple[str, str]]) -> Text:
    """Pieces of text in a row, each with its own style; styled ones have no line breaks."""
    return Text.assemble(*((one_line(part[0]), part[1]) if isinstance(part, tuple) else _text(part) for part in parts))
