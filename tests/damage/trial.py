"""What a command says about a damaged input, and whether that helps its user."""

from __future__ import annotations

import math
import multiprocessing
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tests.damage.child import LONGEST, MOST, call
from tests.damage.kinds import KINDS, Damaged, Kind, damaged

_LINE = re.compile(r":(\d+)(?::\d+)?: ")
_KEY = re.compile(r"`(?!sqrp )[^`\n]+`|<[A-Za-z_]+[ >]")
_PART = re.compile(
    r"\b(?:header|facet|face|vertex|element|entry|row|line|frame|object|link|joint|task|step|byte|option)s?:? [`\w-]"
)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{2,}|(?<=`)\w(?=`)")
_WHOLE = re.compile(
    r"expected a file|there is no|not found|is a folder|is a file|not a folder|is empty|no triangles|UTF-8"
    r"|the limit is|this folder|be written|[\d,]+ bytes|:\d+:\d+ names this file"
)
_ERROR = re.compile(r"^error: ", re.MULTILINE)
_NOISE = ("Traceback", "Warning:", "internal error", "Exception ignored", "libpng", "[ WARN", "terminate called")
_CONTROL = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")

LONGEST_TEXT = 10_000
"""Characters that a command may say on stderr: some screens."""

LEAST_NAMED, LEAST_NEAR = 0.99, 0.95
"""Share of the refusals that must name the file and a place in it, and of those whose place is the damaged one."""


@dataclass(frozen=True)
class Trial:
    """One damaged input and what came of it.

    controls: whether it sent signs to the terminal that are none of text. unlike: whether the result is another than
    without the damage, which must not change it. named: whether the refusal names the file, or what was changed in it,
    and a line, key or part. near: whether
    that is where the damage is, or names what was changed; None where that cannot be told.
    """

    number: int
    kind: str
    what: str
    lines: range | None
    code: int
    said: str
    seconds: float
    memory: float
    controls: bool
    unlike: bool
    named: bool
    near: bool | None

    @property
    def refused(self) -> bool:
        return self.code == 2

    @property
    def sound(self) -> bool:
        """Whether the command ended as commands end: in time, with little memory, without a traceback or a warning."""
        silent = not any(word in self.said for word in _NOISE) and len(self.said) <= LONGEST_TEXT
        small = self.seconds < LONGEST and self.memory < MOST
        return self.code in (0, 1, 2, 3) and silent and small and not self.controls and not self.unlike


def try_damages(cell: Path, numbers: Sequence[int]) -> Iterator[Trial]:
    """Damage a copy of the cell once for each number, and ask a command about it; some at a time."""
    # Processes that begin anew: what a whole test run has loaded is not theirs, and no part of a command's memory.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), context) as pool:
        yield from pool.map(partial(_try, cell), numbers, chunksize=8)


def _try(cell: Path, number: int) -> Trial:
    with tempfile.TemporaryDirectory(dir=cell.parent) as folder:
        copy = Path(folder) / cell.name
        shutil.copytree(cell, copy, copy_function=os.link)
        kind, damage = damaged(copy, number)
        done = call([str(word) for word in damage.command])
        unlike = kind.harmless and done.out != (cell / "score.json").read_text(encoding="utf-8")
        said = done.said.replace(str(copy), "CELL").replace(folder, "FOLDER")
    message = _ERROR.split(said)[:2][-1]
    return Trial(
        number=number,
        kind=kind.name,
        what=damage.what,
        lines=damage.lines,
        code=done.code,
        said=said,
        seconds=done.seconds,
        memory=done.memory,
        controls=_CONTROL.search(done.said + ("" if "--json" in damage.command else done.out)) is not None,
        unlike=unlike,
        named=_names(message, kind, damage),
        near=None if damage.lines is None else _is_near(message, damage),
    )


def _names(message: str, kind: Kind, damage: Damaged) -> bool:
    """Whether a message names the file and something in it, or says what the file itself is or is not."""
    parts = (pattern.search(message) for pattern in (_LINE, _KEY, _PART, _WHOLE))
    culprit = damage.name in message or _names_words(message, damage)
    return culprit and (any(parts) or not kind.parts)


def _names_words(message: str, damage: Damaged) -> bool:
    return any(word.lower() in damage.words for word in _NAME.findall(message))


def _is_near(message: str, damage: Damaged) -> bool:
    line = _LINE.search(message)
    at = line is not None and damage.lines is not None and int(line[1]) in damage.lines
    return at or _names_words(message, damage)


def report(trials: Sequence[Trial], worst: int) -> str:
    """The rates, and the messages that a user could not do anything with."""
    codes = Counter(trial.code for trial in trials)
    lines = [
        f"{len(trials)} damages: {', '.join(f'exit {code}: {n}' for code, n in sorted(codes.items()))}",
        f"not sound: {sum(not trial.sound for trial in trials)}",
        f"file and place named: {_rate(named(trials))}, at least {100 * LEAST_NAMED:g} %",
        f"the damaged place named: {_rate(near(trials))}, at least {100 * LEAST_NEAR:g} %",
        f"{'':28} cases refused  named   near longest  memory",
    ]
    for kind in KINDS:
        if of_kind := [trial for trial in trials if trial.kind == kind.name]:
            refused, named_, near_ = sum(t.refused for t in of_kind), named(of_kind), near(of_kind)
            lines.append(
                f"  {kind.name:26} {len(of_kind):5} {refused:7} {_percent(named_)} {_percent(near_)}"
                f" {max(t.seconds for t in of_kind):5.1f} s {max(t.memory for t in of_kind):4.0f} MB"
            )
    refusals = [trial for trial in trials if trial.sound and trial.refused]
    bad = [t for t in trials if not t.sound] + [t for t in refusals if not t.named]
    bad += [t for t in refusals if t.named and t.near is False]
    return "\n".join([*lines, *map(shown, bad[:worst])])


def shown(trial: Trial) -> str:
    """A trial as a user would see it, below what was done."""
    where = "" if trial.lines is None else f", lines {trial.lines.start} to {trial.lines.stop - 1}"
    spent = f"exit {trial.code}{', another result' * trial.unlike}, {trial.seconds:.1f} s, {trial.memory:.0f} MB"
    wrong = "unsound" if not trial.sound else "" if not trial.refused else "unnamed" if not trial.named else "named"
    said = trial.said.rstrip()
    if trial.controls:
        said = said.encode("unicode_escape").decode("ascii").replace("\\n", "\n")
    return f"--- {trial.number}: {trial.kind}, {trial.what}{where}; {spent}; {wrong}\n{said[:1200]}"


Rate = tuple[int, int]
"""So many of so many."""


def named(trials: Sequence[Trial]) -> Rate:
    """Refusals that name the file and a place in it."""
    refused = [trial for trial in trials if trial.refused]
    return sum(trial.named for trial in refused), len(refused)


def near(trials: Sequence[Trial]) -> Rate:
    """Refusals that name the place that is damaged, of those of which that can be told."""
    refused = [trial for trial in trials if trial.refused and trial.near is not None]
    return sum(trial.near is True for trial in refused), len(refused)


def _percent(rate: Rate) -> str:
    return f"{100 * rate[0] / rate[1]:5.1f}%" if rate[1] else "     -"


def _rate(rate: Rate) -> str:
    return f"{rate[0]} of {rate[1]} = {_percent(rate).strip()}"


def passed(trials: Sequence[Trial]) -> bool:
    """Whether every command ended soundly, and enough of the refusals name the file and a place."""
    rates = (named(trials), LEAST_NAMED), (near(trials), LEAST_NEAR)
    enough = all(of - n <= math.ceil((1 - least) * of) for (n, of), least in rates)
    return enough and all(trial.sound for trial in trials)
