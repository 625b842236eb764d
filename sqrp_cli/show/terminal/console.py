"""What the terminal shows: tables, bars, progress and problems. The only module that knows Rich.

All text but JSON goes through here and is cleaned (`styled`, `_put`): names, paths and tasks come from files that
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

BAR_WIDTH = 8  # cells of a bar in a table
Styled = str | Text  # text with or without a style; only `styled`, `joined` and `percentage` make one, so it is clean
PROGRESS_WIDTH = 20  # cells of the progress bar
LEAST_WIDTH = 20  # least width that lines are laid out for, even in a narrower terminal [columns]
LONGEST_TITLE = 9  # words of a title up to this length are never broken
LEAST_FOLDED = 16  # least width of a column with folded text [cells]
_BEFORE_UNIT = re.compile(r"(?<=[0-9]) (?=(?:s|ms|%|m|mm|cm|deg|px|Hz|points?)(?![A-Za-z]))")
"""A space between a number and its unit, where no line is folded."""
_COMMAND = re.compile(r"\b(?:sqrp|pip|uv|git) [a-z]")  # Of a line that is copied, and so never folded
_KEPT = "\ue000"  # stands for that space meanwhile, as no text has it
SEVERITY_STYLES = {"error": "bold red", "warning": "yellow"}  # styles of errors and warnings


@dataclass(frozen=True)
class Column:
    """A column with a title of one line or several. shrink: whether long text may be folded to fit the terminal."""

    title: str
    right: bool = False
    shrink: bool = False


def numbers(*titles: str) -> list[Column]:
    """Columns of numbers."""
    return [Column(title, right=True) for title in titles]


def delay(worst: float | None, unseen: float | None) -> Styled:
    """A delay [s] as it stands in a column; unseen: the share of faults that may never be noticed."""
    return styled("never", "red") if unseen else seconds(worst)


def seconds(t: float | None, sign: str = "") -> str:
    """A time [s] as it stands in a column; sign: before it."""
    return "-" if t is None else f"{sign}{t:.2f}"


TableCell = Styled | float | None  # Text, or a share in 0..1: a bar and a number, or only the number if space is short
_captured: ContextVar[Console | None] = ContextVar("captured", default=None)
"""The console of results while they are captured as text."""
NOTEBOOK_WIDTH = 100  # columns of results in a notebook


def captured(show: Callable[[], None], *, html: bool = False) -> str:
    """The results that a function prints: as text as wide as the terminal, or with their colours for a notebook."""
    file = io.StringIO()
    console = Console(
        file=file, highlight=False, emoji=False, record=html, force_terminal=html or None, no_color=not html,
        color_system="truecolor" if html else "auto", width=NOTEBOOK_WIDTH if html else output().width,
    )  # fmt: skip
    token = _captured.set(console)
    try:
        show()
    finally:
        _captured.reset(token)
    code = '<pre style="line-height: 1.25">{code}</pre>'
    return console.export_html(inline_styles=True, code_format=code) if html else file.getvalue().rstrip("\n")


def output() -> Console:
    """The console of results: on stdout, unless they are captured as text."""
    captured = _captured.get()
    if captured is not None:
        return captured
    console = Console(highlight=False, soft_wrap=False, emoji=False)
    console.width = max(console.width, LEAST_WIDTH)
    return console


def diagnostics() -> Console:
    """The console of progress, warnings and errors, on stderr."""
    return Console(stderr=True, highlight=False, emoji=False)


def print_table(columns: Sequence[Column], rows: Iterable[Sequence[TableCell]]) -> None:
    """A table without frames, two spaces between columns.

    Without rows it says so. If the terminal is too narrow, bars are left out and titles broken; if that is not enough,
    each row becomes a paragraph of titles and values, in which no figure is folded.
    """
    console, lines = output(), list(rows)
    if not lines:
        say(f"{columns[0].title}: none")
        return
    for bars, broken in ((True, False), (False, False), (False, True)):
        titles, cells, width = _laid_out(columns, lines, bars=bars, broken=broken)
        if width > console.width:
            continue
        table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
        for column, title in zip(columns, titles, strict=True):
            justify: Literal["left", "right"] = "right" if column.right else "left"
            table.add_column(Text(title, style="bold"), justify=justify, no_wrap=not column.shrink, overflow="fold")
        for row in cells:
            table.add_row(*row)
        for segments in console.render_lines(table, pad=False):  # Rich would pad the last column with blanks
            line = Text.assemble(*((segment.text, segment.style or "") for segment in segments))
            line.rstrip()
            _put(console, line)
        return
    titles = [" ".join(title.split()) for title in titles]
    for head, *values in cells:
        named = [(title, value) for title, value in zip(titles[1:], values, strict=True) if str(value).strip()]
        pairs = [Text.assemble(*((title, " ") if title else ()), value) for title, value in named]
        name = Text.assemble(*((titles[0], " ") if titles[0] else ()), head, style="bold")
        say(Text.assemble(*((name, ": " if pairs else "") if head.plain.strip() else ()), unbroken(pairs)), indent=2)


def fits(columns: Sequence[Column], rows: Sequence[Sequence[TableCell]]) -> bool:
    """Whether the terminal is wide enough for these columns, bars left out, so that no row becomes a paragraph."""
    return _laid_out(columns, rows, bars=False, broken=True)[2] <= output().width


def _laid_out(
    columns: Sequence[Column], rows: Sequence[Sequence[TableCell]], *, bars: bool, broken: bool
) -> tuple[list[str], list[list[Text]], int]:
    """Titles, cells and least width of a table. bars: with them. broken: titles in lines that fit the columns."""
    cells = []
    for row in rows:
        shown = (cell if isinstance(cell, Styled) else percentage(cell, bar=bars) for cell in row)
        cells.append([cell if isinstance(cell, Text) else Text(one_line(cell)) for cell in shown])
        for column, cell in zip(columns, cells[-1], strict=True):
            cell.plain = _BEFORE_UNIT.sub(_KEPT, cell.plain) if column.shrink else cell.plain
    titles = ["\n".join(one_line(line) for line in column.title.split("\n")) for column in columns]
    total = 2 * (len(columns) - 1)
    for number, column in enumerate(columns):
        texts = [str(line[number]) for line in cells]
        if broken:
            width = max(map(cell_len, texts), default=0)
            words = [w if len(w) <= LONGEST_TITLE else w.replace("_", "_\n") for w in titles[number].split()]
            lines = words[:1]
            for word in words[1:]:
                longer = f"{lines[-1]} {word}"
                lines[-1:] = [longer] if len(longer) <= width else [lines[-1], word]
            titles[number] = "\n".join(lines)
        widest = max(cell_len(line) for text in (titles[number], *texts) for line in text.split("\n"))
        total += min(widest, LEAST_FOLDED) if column.shrink else widest
    return titles, cells, total


def _put(console: Console, line: Text) -> None:
    """Print a line as it is, unless a CI server would take it for a command."""
    line.plain = harmless(line.plain.replace(_KEPT, " "))
    console.print(line, soft_wrap=True)


def styled(text: Styled, style: str = "") -> Text:
    """Clean text in one style. One line break may begin and one may end it; any other comes from foreign data."""
    if isinstance(text, Text):
        return Text.assemble(text, style=style)
    shown = one_line(text)
    before, after = text[:1] == "\n", text[1:][-1:] == "\n"
    return Text("\n" * before + shown[before : len(shown) - after] + "\n" * after, style=style)


def say(text: Styled = "", style: str | None = None, *, indent: int = 0) -> None:
    """A paragraph of results, folded at the terminal's width. indent: of all lines but the first, if there is room."""
    console, whole = output(), styled(text, style or "")
    whole.plain = _BEFORE_UNIT.sub(_KEPT, whole.plain)
    _put_folded(console, whole, min(indent, console.width - LEAST_WIDTH))


def unbroken(parts: Iterable[Styled], between: str = ", ") -> Text:
    """Parts in a row, which `say` folds between them and not within one, save one that is too long for a line."""
    found = [styled(part) for part in parts]
    for part in found:
        if cell_len(part.plain) < output().width - 2:
            part.plain = part.plain.replace(" ", _KEPT)
    return Text(between).join(found)


def say_assumed(assumed: str) -> None:
    """What times assume of the cameras; nothing where all state their latency."""
    if assumed:
        say(f"For these times, {assumed}.")


def say_command(text: str, command: str, style: str | None = None) -> None:
    """A sentence that ends in a command, which is never folded, so that it can be copied; it may get its own line."""
    if cell_len(f"{text} {command}") <= output().width:
        say(f"{text} {command}", style)
        return
    say(text, style)
    say_line(command, style)


def say_line(text: Styled, style: str | None = None) -> None:
    """A line of results that is never folded."""
    _put(output(), styled(text, style or ""))


def say_raw(text: str) -> None:
    """Text for other programs, unchanged: only for JSON, which escapes control characters."""
    sys.stdout.write(text + "\n")


def note(text: str) -> None:
    """A line that is not part of the results."""
    if verbosity.get() is Verbosity.QUIET:
        return
    _tell(styled(text, "dim"))


def ask(question: str) -> str:
    """The user's answer without blanks around it, echoed from a pipe; raises EOFError if there is no more input."""
    answer = input(harmless(styled(question).plain)).strip()
    if not sys.stdin.isatty():
        sys.stdout.write(one_line(answer) + "\n")
    return answer


def print_problems(problems: Iterable[Problem]) -> None:
    """Problems on stderr: place, what was found and expected, the line with a caret, and how to mend it."""
    for problem in problems:
        if verbosity.get() is Verbosity.QUIET and problem.severity != "error":
            continue
        line = Text.assemble((f"{problem.severity}: ", SEVERITY_STYLES[problem.severity]))
        if problem.place is not None:
            line.append(f"{one_line(str(problem.place))}: ", style="bold")
        line.append(one_line(problem.message))
        _tell(line)
        if problem.excerpt and problem.excerpt.partition("\n")[0].strip():
            for part in problem.excerpt.split("\n"):
                _put(diagnostics(), styled(part.expandtabs(), "dim"))
        if problem.mend:
            _tell(Text.assemble(("  to mend it: ", "dim"), one_line(problem.mend)))


def _tell(line: Text) -> None:
    """A line on stderr, folded in a terminal; in a file it stays one, and so does a line with a command."""
    console = diagnostics()
    if not console.is_terminal or _COMMAND.search(line.plain):
        _put(console, line)
    else:
        _put_folded(console, line, 4)


def _put_folded(console: Console, line: Text, indent: int) -> None:
    """Print a line, folded between words; indent: of all lines but the first."""
    for number, part in enumerate(line.wrap(console, max(console.width, LEAST_WIDTH) - indent)):
        part.rstrip()
        _put(console, Text.assemble(" " * indent * bool(number), part))


def percentage(share: float | None, *, bar: bool) -> Text:
    """A share as a number, with a bar before it, in eighths of a cell: green from 90 %, red below 50 %."""
    if share is None:
        return Text("-".rjust(BAR_WIDTH + 6) if bar else "-", style="dim")
    style = "green" if share >= 0.9 else "yellow" if share >= 0.5 else "red"
    figure, (full, rest) = f"{100 * share:.1f}", divmod(round(share * BAR_WIDTH * 8), 8)
    blocks = ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(BAR_WIDTH)
    return Text(f"{blocks} {figure:>5}" if bar else figure, style=style)


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Advance]:
    """Progress on stderr, which vanishes when done; log files get a line now and then. total: None if unknown."""
    began, console = time.monotonic(), diagnostics()
    if verbosity.get() is Verbosity.QUIET:
        yield lambda count=1: None  # noqa: ARG005 - nobody is shown it
    elif not console.is_terminal:
        with progress_lines(title, total, note) as advance:
            yield advance
    else:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        bar, left = BarColumn(bar_width=PROGRESS_WIDTH), TimeRemainingColumn(compact=True)
        # Rich cuts the end of a long line first, but what follows the title matters more.
        rest, shown = PROGRESS_WIDTH + len(f" {total}/{total} -:--:-- "), styled(title)
        shown.truncate(max(console.width - rest - 1, LEAST_WIDTH), overflow="ellipsis")
        text = TextColumn("{task.description}", markup=False)
        with Progress(text, bar, MofNCompleteColumn(), left, console=console, transient=True) as bars:
            task = bars.add_task(shown.plain, total=total)
            yield lambda count=1: bars.advance(task, count)
    if verbosity.get() is Verbosity.VERBOSE:
        note(f"{title}: {time.monotonic() - began:.1f} s")


Show = Callable[[Styled], None]  # called with the new text to show: replaces what was shown


@contextmanager
def changing_text() -> Iterator[Show | None]:
    """Text on stderr that changes in place and vanishes when done; None if stderr is no terminal, or quiet."""
    console = diagnostics()
    if not console.is_terminal or verbosity.get() is Verbosity.QUIET:
        yield None
        return
    with Live(console=console, transient=True, auto_refresh=False) as screen:
        yield lambda text: screen.update(text, refresh=True)


def joined(parts: Sequence[Styled | tuple[str, str]]) -> Text:
    """Pieces of text in a row, each with its own style; styled ones have no line breaks."""
    return Text.assemble(*((one_line(part[0]), part[1]) if isinstance(part, tuple) else styled(part) for part in parts))
