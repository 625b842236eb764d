"""`--watch`: a command again whenever a file that it has read is saved, old and new side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sqrp_cli.cli.command import line
from sqrp_cli.errors import ExitCode, bad_option
from sqrp_cli.platform.files import stamp_of

if TYPE_CHECKING:
    from sqrp_cli.document import Document
    from sqrp_cli.figures import Figures

execute: ContextVar[Callable[[list[str]], int]] = ContextVar("execute")  # the function that runs a command line
INTERVAL = 0.2  # time between two looks at the files [s]
MOST_ROWS = 20  # of more rows, only those are shown that differ


class AnswerView(NamedTuple):
    """What is compared: a table, and what is said under it."""

    columns: tuple[str, ...]  # titles; the first is that of the rows' names
    rows: Mapping[str, tuple[str, ...]]  # by their names, a text for each column but the first
    said: str = ""


last_shown: ContextVar[list[AnswerView] | None] = ContextVar("shown", default=None)
"""While a command runs again and again: the last answer, once there is one."""


def is_shown_again(answer: Document) -> bool:
    """Whether a command runs again and again, and has shown this answer: the first as it does, then what differs."""
    shown = last_shown.get()
    if shown is None:
        return False
    now = view_of(answer)
    if shown:
        print_changes(shown[0], now)
    else:
        answer.show()
    shown[:] = [now]
    return True


def watched(refused: Mapping[str, object]) -> ExitCode:
    """Run a command, and again whenever a file that it has read is saved, until Ctrl-C.

    refused: options that are senseless with `--watch`, by name, with their values.
    What is wrong with a file is told, and the command waits for it to be saved again. Raises KeyboardInterrupt.
    """
    from sqrp_cli.files.input_file import noted_files
    from sqrp_cli.show.terminal.console import note, say

    if given := [name for name, value in refused.items() if value]:
        raise bad_option(f"--watch and {given[0]} exclude each other; give one of them")
    again = [word for word in line.get() if word != "--watch"]
    stamps: dict[Path, tuple[int, ...]] = {}
    told = False
    shown = last_shown.set([])
    try:
        while True:
            # As files were before the command reads them: what is saved meanwhile is not missed.
            stamps = {path: stamp_of(path) for path in stamps}
            with noted_files() as read:
                code = execute.get()(again)
            if code == ExitCode.INTERRUPTED:
                return ExitCode.INTERRUPTED
            stamps = {path: stamp_of(path) for path in read} | stamps
            if not told or code not in (ExitCode.OK, ExitCode.NONE_FEASIBLE):
                note(f"watching {len(stamps)} files; Ctrl-C ends")
            told = True
            saved: set[Path] = set()
            while True:  # until files that were saved stay as they are for a moment
                changed = {path: now for path, stamp in stamps.items() if (now := stamp_of(path)) != stamp}
                if saved and not changed:
                    break
                saved.update(changed)
                stamps |= changed
                time.sleep(INTERVAL)
            say(f"\n{', '.join(sorted(path.name for path in saved))} saved", "dim")
    finally:
        last_shown.reset(shown)


def print_changes(before: AnswerView, now: AnswerView) -> None:
    """The table again, with what was before an arrow where it differs; rows that are gone come last."""
    from sqrp_cli.show.terminal.console import Column, print_table, say, styled

    if before == now:
        say("No figure has changed.")
        return

    def against(old: Iterable[str], new: Iterable[str]) -> list[str]:
        return [one if one == was else f"{was}{_ARROW}{one}" for was, one in zip(old, new, strict=True)]

    names = {**now.rows, **before.rows}
    shown = [name for name in names if len(names) <= MOST_ROWS or before.rows.get(name) != now.rows.get(name)]
    nothing = ("–",) * (len(now.columns) - 1)
    cells = ((name, against(before.rows.get(name, nothing), now.rows.get(name, nothing))) for name in shown)
    titles = against(before.columns, now.columns)
    columns = [Column(title, right=title in _TITLES, shrink=title in _TEXTS) for title in titles]
    print_table(columns, [[name, *(styled(text, "bold" * (_ARROW in text)) for text in row)] for name, row in cells])
    if left := len(names) - len(shown):
        say(f"... and {left} as before", "dim")
    if before.said != now.said:
        say(f"\nwas: {before.said}\nnow: {now.said}")


_ARROW = " → "
_TEXTS = ("finding", "verdict")  # titles of columns that may be folded
_TITLES = ("critical time seen [%]", "time seen [%]", "takes [s]", "noticed after [s]", "at the latest [s]")


def view_of(answer: Document) -> AnswerView:
    """What of an answer is compared."""
    from sqrp_cli.score.result import Scorecard
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.documents.explanation import ExplainedAll, Explanation
    from sqrp_cli.show.terminal.timeline_chart import covered_share
    from sqrp_cli.study.result import Ranking

    columns: tuple[str, ...] = ("candidate", "#", *_TITLES)
    rows: dict[str, tuple[str, ...]] = {}
    first = None
    match answer:
        case Ranking() | ExplainedAll():
            for one in answer.candidates:
                rows[one.name] = ("cannot be done" if one.rank is None else f"{one.rank}", *_figures(one))
            first = next(iter(answer.candidates), None) if isinstance(answer, Ranking) else None
        case Explanation():
            columns, first = ("", answer.name), answer
            rows |= {title: (text,) for title, text in zip(_TITLES, _figures(answer), strict=True)}
            for atom in answer.says:
                for camera in answer.cameras:  # for which share of the time it sees the literal
                    seen = [None if one is None else one.cameras[camera].covered for one in answer.found_of(atom)]
                    share = covered_share(answer.samples, seen)
                    rows[f"{atom}, {camera} [%]"] = ("–" if share is None else f"{100 * share:.1f}",)
        case Check():
            columns = ("candidate" if answer.task else "finding", "verdict")
            rows |= {one.name: ("can be done" if one.feasible else one.reasons[0],) for one in answer.candidates}
            rows |= {f"{one.place or answer.workspace} {one.message}": (one.severity,) for one in answer.findings}
        case Scorecard():
            columns = ("task", "status", *_TITLES)
            for task in answer.results:
                figures = ("–",) * len(_TITLES) if task.best is None else _figures(task.best)
                rows[f"{task.workspace}: {task.task}"] = (task.status, *figures)
    why = "" if first is None else first.verdict if first.feasible else first.reasons[0]
    return AnswerView(columns, rows, why)


def _figures(found: Figures) -> tuple[str, ...]:
    """The figures of a candidate, of its faults the worst."""
    means = [fault.delay_mean for fault in found.faults.values()]
    late = max((mean for mean in means if mean is not None), default=None)
    figures = [None if q is None else f"{100 * q:.1f}" for q in (found.q_eoi, found.q_avg)]
    figures += [None if t is None else f"{t:.2f}" for t in (found.time, late, found.delay_worst)]
    figures[3:] = ["never" if None in means else figures[3], "never" if found.unseen else figures[4]]
    return tuple(text or "–" for text in figures)
