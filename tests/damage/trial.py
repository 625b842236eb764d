"""What a command says about a damaged file, and whether that helps its user."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import signal
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import FrameType
from unittest import mock

from sqrp_cli.cli.main import run
from tests.damage.cell import KINDS, TASK
from tests.damage.mutations import Damage, damage

LONGEST = 10.0
"""Time that a command may take on a damaged file [s]."""

_PLACE = re.compile(r":(\d+)(?::\d+)?: ")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{2,}|(?<=`)\w(?=`)")


@dataclass(frozen=True)
class Trial:
    """One damage and what came of it."""

    number: int
    file: str
    damage: Damage
    code: int
    said: str
    seconds: float
    names_file: bool
    names_key: bool

    @property
    def rejected(self) -> bool:
        return self.code == 2

    @property
    def clear(self) -> bool:
        return self.names_file and self.names_key

    @property
    def sound(self) -> bool:
        """Whether the command ended as commands end, in time and without a traceback or a library's warning."""
        silent = not any(word in self.said for word in ("Traceback", "Warning:", "internal error"))
        return self.code in (0, 1, 2) and silent and self.seconds < LONGEST


def try_damages(cell: Path, numbers: Sequence[int]) -> Iterator[Trial]:
    """Damage a copy of the cell once for each number, and run a command on it."""
    copy = cell.with_name("damaged")
    for number in numbers:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(cell, copy)
        file = KINDS[number % len(KINDS)]
        random = Random(number)  # noqa: S311
        done = damage((copy / file).read_bytes(), random)
        (copy / file).write_bytes(done.content)
        yield _try(copy, number, file, done)


def _try(cell: Path, number: int, file: str, done: Damage) -> Trial:
    command = ["rank", str(cell), TASK, "--samples", "2"]
    if file == "program.yaml":
        command = ["check", str(cell), TASK, "--after", str(cell / file)]
    code, said, seconds = call(command)
    first = said.split("\nerror: ")[0]
    place = _PLACE.search(first)
    at = int(place[1]) if place else None
    words = {word.lower() for word in _NAME.findall(first.replace(str(cell), ""))}
    return Trial(
        number=number,
        file=file,
        damage=done,
        code=code,
        said=said.replace(str(cell), "CELL"),
        seconds=seconds,
        names_file=Path(file).name in first,
        names_key=(at in done.lines) or bool(words & done.words),
    )


class TooLong(BaseException):
    """Raised inside a command that hangs."""


def call(command: Sequence[str]) -> tuple[int, str, float]:
    """Exit code, everything on stderr, and processor time [s] of a command; warnings count as said."""
    out, err = io.StringIO(), io.StringIO()

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise TooLong

    before = time.process_time()
    previous = signal.signal(signal.SIGALRM, stop)
    signal.alarm(int(6 * LONGEST))  # other work on the machine takes its share of the time
    try:
        with (
            mock.patch.dict(os.environ, {"COLUMNS": "80", "NO_COLOR": "1"}),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("always")
            try:
                code = int(run(list(command)))
            except TooLong:
                code = -1
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)
    return code, err.getvalue(), time.process_time() - before


def report(trials: Sequence[Trial], worst: int) -> str:
    """The rates, and the messages that a user could not do anything with."""
    rejected = [trial for trial in trials if trial.rejected]
    clear = sum(trial.clear for trial in rejected)
    codes = Counter(trial.code for trial in trials)
    lines = [
        f"{len(trials)} damages: {', '.join(f'exit {code}: {n}' for code, n in sorted(codes.items()))}",
        f"longest: {max(t.seconds for t in trials):.1f} s; not sound: {sum(not t.sound for t in trials)}",
        f"file and key named: {clear} of {len(rejected)} rejected = {100 * clear / max(len(rejected), 1):.1f} %",
    ]
    for file in KINDS:
        of_file = [trial for trial in rejected if trial.file == file]
        lines.append(f"  {file:28} {sum(t.clear for t in of_file):4} of {len(of_file):4}")
    unclear = [trial for trial in trials if not trial.sound] + [trial for trial in rejected if not trial.clear]
    for trial in unclear[:worst]:
        where = f"lines {trial.damage.lines.start} to {trial.damage.lines.stop - 1}"
        lines.append(f"--- {trial.number}: {trial.file}, {trial.damage.what}, {where}, exit {trial.code}")
        lines.append(trial.said.rstrip()[:1200])
    return "\n".join(lines)


def passed(trials: Sequence[Trial]) -> bool:
    """Whether every command ended soundly, and at least 95 % of the rejections name file and key."""
    rejected = [trial for trial in trials if trial.rejected]
    clear = sum(trial.clear for trial in rejected)
    return all(trial.sound for trial in trials) and clear >= 0.95 * len(rejected)
