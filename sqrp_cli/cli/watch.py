"""`--watch`: a command again whenever a file that it has read is saved, old and new side by side."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sqrp_cli.cli.command import line
from sqrp_cli.errors import ExitCode, bad_option
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from sqrp_cli.document import Document
    from sqrp_cli.figures import Figures
    from sqrp_cli.show.documents.explanation import CandidateStudy, Sample
    from sqrp_cli.study.result import CandidateResult

execute: ContextVar[Callable[[list[str]], int]] = ContextVar("execute")
"""The function that runs a command line."""

INTERVAL = 0.2
"""Time between two looks at the files [s]."""

MOST_ROWS = 20
"""Of more rows, only those are shown that differ."""


class AnswerView(NamedTuple):
    """What is compared: a table, and what is said under it."""

    columns: tuple[str, ...]
    """Titles; the first is that of the rows' names."""
    rows: Mapping[str, tuple[str, ...]]
    """By their names, a text for each column but the first."""
    said: str = ""


@dataclass
class _Watcher:
    """Shows the first answer as the command does, and each later one against the one before."""

    before: AnswerView | None = None

    def show(self, answer: Document) -> None:
        """Show an answer."""
        now = view_of(answer)
        if self.before is None:
            answer.show()
        else:
            print_changes(self.before, now)
        self.before = now


_watcher: ContextVar[_Watcher | None] = ContextVar("watcher", default=None)


def is_shown_again(answer: Document) -> bool:
    """Whether a command runs again and again, and has shown this answer."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher.show(answer)
    return watcher is not None


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
    files: set[Path] = set()
    told = False
    shown = _watcher.set(_Watcher())
    try:
        while True:
            stamps = _Stamps(files)
            with noted_files() as read:
                code = execute.get()(again)
            if code == ExitCode.INTERRUPTED:
                return ExitCode.INTERRUPTED
            stamps.add(read)
            files |= read
            if not told or code not in (ExitCode.OK, ExitCode.NONE_FEASIBLE):
                note(f"watching {len(files)} files; Ctrl-C ends")
            told = True
            saved = stamps.wait()
            say(f"\n{', '.join(sorted(path.name for path in saved))} saved", "dim")
    finally:
        _watcher.reset(shown)


@dataclass
class _Stamps:
    """How files were before a command read them: what is saved meanwhile is not missed."""

    files: Iterable[Path]
    stamps: dict[Path, tuple[int, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.add(self.files)

    def add(self, files: Iterable[Path]) -> None:
        """Watch further files."""
        for path in files:
            self.stamps.setdefault(path, _stamp(path))

    def wait(self) -> list[Path]:
        """The files that were saved, once they stay as they are for a moment."""
        saved: set[Path] = set()
        while True:
            changed = [path for path, stamp in self.stamps.items() if _stamp(path) != stamp]
            if saved and not changed:
                return sorted(saved)
            saved.update(changed)
            self.stamps.update((path, _stamp(path)) for path in changed)
            time.sleep(INTERVAL)


def _stamp(path: Path) -> tuple[int, ...]:
    """What changes when a file is saved; empty where there is none."""
    try:
        found = os.stat(path)  # noqa: PTH116 # `Path` takes longer, a thousand times per second
    except OSError:
        return ()
    return found.st_mtime_ns, found.st_size, found.st_ino


def print_changes(before: AnswerView, now: AnswerView) -> None:
    """The table again, with what was before an arrow where it differs; rows that are gone come last."""
    from sqrp_cli.show.terminal.console import Column, plain, print_table, say

    if before == now:
        say("No figure has changed.")
        return
    names = {**now.rows, **before.rows}
    shown = [name for name in names if len(names) <= MOST_ROWS or before.rows.get(name) != now.rows.get(name)]
    cells = ((name, [_against(*pair) for pair in _pairs(before, now, name)]) for name in shown)
    titles = [_against(*pair) for pair in zip(before.columns, now.columns, strict=True)]
    columns = [Column(title, right=title in _TITLES, shrink=title in _TEXTS) for title in titles]
    print_table(columns, [[name, *(plain(text, "bold" * (_ARROW in text)) for text in row)] for name, row in cells])
    if left := len(names) - len(shown):
        say(f"... and {left} as before", "dim")
    if before.said != now.said:
        say(f"\nwas: {before.said}\nnow: {now.said}")


_ARROW = " → "
_TEXTS = ("finding", "verdict")
"""Titles of columns that may be folded."""


def _pairs(before: AnswerView, now: AnswerView, name: str) -> Iterator[tuple[str, str]]:
    """The cells of a row, old and new."""
    nothing = ("–",) * (len(now.columns) - 1)
    return zip(before.rows.get(name, nothing), now.rows.get(name, nothing), strict=True)


def _against(old: str, new: str) -> str:
    return new if old == new else f"{old}{_ARROW}{new}"


def view_of(answer: Document) -> AnswerView:
    """What of an answer is compared."""
    from sqrp_cli.score.result import Scorecard
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.documents.explanation import ExplainedAll, Explanation
    from sqrp_cli.study.result import Ranking

    match answer:
        case Ranking():
            rows = {one.name: _candidate(one) for one in answer.candidates}
            return AnswerView(
                ("candidate", "#", *_TITLES), rows, _why(answer.candidates[0]) if answer.candidates else ""
            )
        case ExplainedAll():
            return AnswerView(("candidate", "#", *_TITLES), {one.name: _candidate(one) for one in answer.candidates})
        case Explanation():
            return AnswerView(("", answer.name), _study(answer), _why(answer))
        case Check():
            verdicts = {one.name: ("can be done" if one.feasible else one.reasons[0],) for one in answer.candidates}
            said = {f"{one.place or answer.workspace} {one.message}": (one.severity,) for one in answer.findings}
            return AnswerView(("candidate" if answer.task else "finding", "verdict"), {**verdicts, **said})
        case Scorecard():
            rows = {
                f"{one.workspace}: {one.task}": (one.status, *(_SHOWN_NONE if one.best is None else _figures(one.best)))
                for one in answer.results
            }
            return AnswerView(("task", "status", *_TITLES), rows)
        case _:
            raise TypeError(type(answer).__name__)


_TITLES = ("Q_eoi [%]", "Q_avg [%]", "time [s]", "seen [s]", "at worst")
_SHOWN_NONE = ("–",) * len(_TITLES)


def _candidate(found: CandidateResult) -> tuple[str, ...]:
    """Place and figures."""
    return ("infeasible" if found.rank is None else f"{found.rank}", *_figures(found))


def _figures(found: Figures) -> tuple[str, ...]:
    """The figures of a candidate, of its faults the worst."""
    means = [fault.delay_mean for fault in found.faults.values()]
    late = _seconds(max((mean for mean in means if mean is not None), default=None))
    mean, worst = ("never" if None in means else late), ("never" if found.unseen else _seconds(found.delay_worst))
    return (_percent(found.q_eoi), _percent(found.q_avg), _seconds(found.time), mean, worst)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _why(found: CandidateResult) -> str:
    return found.verdict if found.feasible else found.reasons[0]


def _study(study: CandidateStudy) -> dict[str, tuple[str, ...]]:
    """The figures of a candidate, and for which share of the time each camera sees each literal."""
    rows: dict[str, tuple[str, ...]] = {title: (text,) for title, text in zip(_TITLES, _figures(study), strict=True)}
    for atom in dict.fromkeys(name.removeprefix("not ") for name in study.targets):
        for camera in study.cameras:
            rows[f"{atom}, {camera} [%]"] = (_percent(_share(study.samples, atom, camera)),)
    return rows


def _share(samples: Sequence[Sample], atom: str, camera: str) -> float | None:
    """The share of the time in which a literal is asked for, and a camera covers it; between neighbouring samples."""
    seen = [
        next(
            (one.literals[name].cameras[camera].covered for name in (atom, f"not {atom}") if name in one.literals), None
        )
        for one in samples
    ]
    pairs = list(zip(samples, samples[1:], seen, seen[1:], strict=False))
    asked = sum(after.t - before.t for before, after, first, then in pairs if None not in (first, then))
    covered = sum(after.t - before.t for before, after, first, then in pairs if first and then)
    return covered / asked if asked else None
