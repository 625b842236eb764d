"""What commands say about damaged inputs, and whether that helps their users: 100 damages a case."""

from __future__ import annotations

import math
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.damage.cell import whole_cell
from tests.damage.child import LONGEST, MOST, call
from tests.damage.kinds import KINDS, TURNS, Damaged, Kind, damaged

EACH = 100
"""Damages of a case; case -1 has one of every kind."""
LEAST_NAMED, LEAST_NEAR = 0.99, 0.95
"""Share of the refusals that must name the file and a place in it, and of those whose place is the damaged one."""
LONGEST_TEXT = 10_000
"""Characters that a command may say on stderr: some screens."""

_LINE = re.compile(r":(\d+)(?::\d+)?: ")
_PLACES = (
    _LINE,
    re.compile(r"`(?!sqrp )[^`\n]+`|<[A-Za-z_]+[ >]"),
    re.compile(
        r"\b(?:header|facet|face|vertex|element|entry|row|line|frame|object|link|joint|task|step|byte|option)s?"
        r":? [`\w-]"
    ),
    re.compile(
        r"expected a file|there is no|no such file|not found|is a folder|is a file|not a folder|is empty|no triangles"
        r"|UTF-8|the limit is|this folder|be written|[\d,]+ bytes|:\d+:\d+ names this file"
    ),
)
"""A line, a key, a part, or what the file itself is or is not."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{2,}|(?<=`)\w(?=`)")
_NOISE = ("Traceback", "Warning:", "internal error", "Exception ignored", "libpng", "[ WARN", "terminate called")
_CONTROL = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def prepare(shared: Path) -> None:
    """Make the undamaged cell."""
    whole_cell(shared / "cell")


def damage(number: int, folder: Path) -> dict[str, Any]:
    """Damage a copy of the cell in many ways, and ask a command about each."""
    numbers = range(EACH * number, EACH * (number + 1)) if number >= 0 else sorted(TURNS.index(kind) for kind in KINDS)
    tried = [_tried(folder, folder.parent / "cell", one) for one in numbers]
    bad = [one["shown"] for one in tried if one["shown"]]
    return {
        "said": "\n".join([f"{sum(one['code'] == 2 for one in tried)} of {len(tried)} refused", *bad]),
        "all": tried,
    }


def damage_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    every = [one for case in found for one in case["all"]]
    refused = [one for one in every if one["code"] == 2]
    for kind in KINDS:
        if those := [one for one in every if one["kind"] == kind.name]:
            most, largest = max(one["seconds"] for one in those), max(one["memory"] for one in those)
            yield f"{kind.name:26} {len(those):5} cases, {most:5.1f} s and {largest:4.0f} MB at most", True
    yield ", ".join(f"exit {code}: {n}" for code, n in sorted(Counter(one["code"] for one in every).items())), True
    sound = sum(one["sound"] for one in every)
    yield f"sound: {sound} of {len(every)}", sound == len(every)
    for what, key, least in (("file and place", "named", LEAST_NAMED), ("the damaged place", "near", LEAST_NEAR)):
        known = [one[key] for one in refused if one[key] is not None]
        enough = len(known) - sum(known) <= math.ceil((1 - least) * len(known))
        yield f"{what} named: {sum(known)} of {len(known)}, at least {100 * least:g} %", enough


def _tried(folder: Path, cell: Path, number: int) -> dict[str, Any]:
    """One damage and what came of it.

    sound: whether the command ended as commands end: in time, with little memory, without a traceback, a warning or
    signs that are none of text, and with the result of before where the damage must not change it. named: whether a
    refusal names the file, or what was changed in it, and a line, key or part. near: whether that is where the damage
    is, or names what was changed; None where that cannot be told. shown: as a user sees it, where that is no help.
    """
    copy = folder / cell.name
    shutil.copytree(cell, copy, copy_function=os.link)
    kind, done_to = damaged(copy, number)
    done = call([str(word) for word in done_to.command])
    unlike = kind.harmless and done.out != (cell / "score.json").read_text(encoding="utf-8")
    shutil.rmtree(folder)
    folder.mkdir()
    said = done.said.replace(str(copy), "CELL").replace(str(folder), "FOLDER")
    controls = _CONTROL.search(done.said + ("" if "--json" in done_to.command else done.out)) is not None
    silent = not any(word in said for word in _NOISE) and len(said) <= LONGEST_TEXT
    small = done.seconds < LONGEST and done.memory < MOST
    sound = done.code in (0, 1, 2, 3) and silent and small and not controls and not unlike
    named, near = _helps(re.split(r"(?m)^error: ", said)[:2][-1], kind, done_to)
    where = "" if done_to.lines is None else f", lines {done_to.lines.start} to {done_to.lines.stop - 1}"
    spent = f"exit {done.code}{', another result' * unlike}, {done.seconds:.1f} s, {done.memory:.0f} MB"
    text = said.rstrip().encode("unicode_escape").decode("ascii").replace("\\n", "\n") if controls else said.rstrip()
    good = sound and (done.code != 2 or (named and near is not False))
    shown = "" if good else f"--- {number}: {kind.name}, {done_to.what}{where}; {spent}\n{text[:1200]}"
    return {
        "kind": kind.name, "code": done.code, "sound": sound, "named": named, "near": near, "seconds": done.seconds,
        "memory": done.memory, "shown": shown,
    }  # fmt: skip


def _helps(message: str, kind: Kind, done_to: Damaged) -> tuple[bool, bool | None]:
    words = any(word.lower() in done_to.words for word in _NAME.findall(message))
    place = any(pattern.search(message) for pattern in _PLACES)
    named = (done_to.name in message or words) and (place or not kind.parts)
    line = _LINE.search(message)
    near = None if done_to.lines is None else words or (line is not None and int(line[1]) in done_to.lines)
    return named, near
