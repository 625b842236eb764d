"""Damages as people and disks cause them, to any text file: bytes, lines, numbers, words, structure."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]{2,}")
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(?=\s*[:=])")
_NUMBERS = (
    "-1", "0", "1e308", "-1e308", "1e999", ".nan", "inf", "1e-300", "99999999999999999999", "1,5", "0x10", "abc", "",
)  # fmt: skip
_VALUES = (
    "null", "true", "[]", "{}", "[1, 2]", "{a: 1}", "''", "*x", "&x 1", "!!python/object:os.system x", "|", "~",
    "30 lbs",
)  # fmt: skip
_CHARACTERS = "{}[]()<>:,'\"-&*#\t\n$é0%@`\0\x07\ufeff"


@dataclass(frozen=True)
class Damage:
    """What was done to a file.

    content: afterwards. lines: those concerned, from 1, and the line of the key or element that they belong to.
    words: on these lines, as they were and as they are.
    """

    what: str
    content: bytes
    lines: range
    words: frozenset[str]


def damage(content: bytes, random: Random) -> Damage:
    """One damage of a kind drawn by `random`; always a change."""
    while True:
        kind = random.choice([*_BYTES, *_LINES, *_MATCHES, *_TWICE])
        changed = _changed(kind, content, random)
        if changed != content:
            return Damage(kind, changed, *_concerned(content, changed))


def _concerned(before: bytes, after: bytes) -> tuple[range, frozenset[str]]:
    """The lines of the damaged file that differ, with one around them, and the words on them before and after."""
    old, new = (text.decode("utf-8", errors="replace").split("\n") for text in (before, after))
    differing = (k for k, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1])
    start = next(differing, min(len(old), len(new)))
    tail = 0
    while tail < min(len(old), len(new)) - start and old[-1 - tail] == new[-1 - tail]:
        tail += 1
    touched = [*old[start : len(old) - tail], *new[start : len(new) - tail]]
    words = frozenset(word.lower() for line in touched for word in (*_WORD.findall(line), *_KEY.findall(line)))

    def indentation(line: str) -> int:
        return len(line) - len(line.lstrip(" -"))

    own = indentation(old[start]) if start < len(old) else 0  # the line above with less of it is the owner
    owner = next((k for k in range(start - 1, -1, -1) if old[k].strip() and indentation(old[k]) < own), start)
    return range(min(start, owner + 1), len(new) - tail + 2), words


_BYTES: dict[str, Callable[[bytes, int, Random], bytes]] = {
    "flip_byte": lambda text, at, random: text[:at] + bytes([text[at] ^ (1 << random.randrange(8))]) + text[at + 1 :],
    "random_byte": lambda text, at, random: text[:at] + random.randbytes(1) + text[at + random.randrange(2) :],
    "insert_character": lambda text, at, random: text[:at] + random.choice(_CHARACTERS).encode() + text[at:],
    "delete_range": lambda text, at, random: text[:at] + text[at + random.choice([1, 1, 2, 5, 20, 100]) :],
    "double_range": lambda text, at, random: text[: at + random.choice([1, 2, 5, 20, 100])] + text[at:],
    "truncate": lambda text, at, _random: text[:at],
}
_LINES: dict[str, Callable[[list[bytes], int, Random], list[bytes]]] = {
    "delete_line": lambda lines, at, _random: lines[:at] + lines[at + 1 :],
    "double_line": lambda lines, at, _random: [*lines[:at], lines[at], *lines[at:]],
    "swap_lines": lambda lines, at, random: _swapped(lines, at, random.randrange(len(lines))),
    "indent_line": lambda lines, at, random: [
        *lines[:at],
        random.choice([b"  " + lines[at], lines[at][1:]]),
        *lines[at + 1 :],
    ],
}
_MATCHES: dict[str, tuple[re.Pattern[str], Callable[[str, Random], str]]] = {
    "change_number": (_NUMBER, lambda _number, random: random.choice(_NUMBERS)),
    "scale_number": (_NUMBER, lambda number, random: f"{float(number) * random.choice([-1, 1e3, 1e-3, 1e6, 1.01]):g}"),
    "misspell": (_WORD, lambda word, random: _misspelt(word, random)),
    "replace_word": (_WORD, lambda _word, random: random.choice(_OTHER_WORDS)),
    "change_value": (re.compile(r": [^\n]*"), lambda _rest, random: ": " + random.choice(_VALUES)),
    "rename_key": (_KEY, lambda key, random: _misspelt(key, random) if len(key) > 1 else key + key),
}  # fmt: skip
_OTHER_WORDS = ("xyzzy", "home", "world", "tool", "object", "table", "NaN", "true")
_TWICE = ("delete_line", "change_number", "misspell")
"""Kinds that are drawn twice as often."""


def _swapped(lines: list[bytes], one: int, other: int) -> list[bytes]:
    lines[one], lines[other] = lines[other], lines[one]
    return lines


def _misspelt(word: str, random: Random) -> str:
    at = random.randrange(len(word) - 1)
    return random.choice(
        [word[:at] + word[at + 1 :], word[: at + 1] + word[at:], word[:at] + word[at + 1] + word[at] + word[at + 2 :]]
    )


def _changed(kind: str, content: bytes, random: Random) -> bytes:
    """What a kind of damage makes of a file; the same where there is nothing of the kind."""
    if kind in _BYTES:
        return _BYTES[kind](content, random.randrange(len(content)), random)
    if kind in _LINES:
        lines = content.split(b"\n")
        return b"\n".join(_LINES[kind](lines, random.randrange(len(lines)), random))
    (pattern, new), text = _MATCHES[kind], content.decode("utf-8", errors="surrogateescape")
    found = list(pattern.finditer(text))
    if not found:
        return content
    match = random.choice(found)
    text = text[: match.start()] + new(match[0], random) + text[match.end() :]
    return text.encode("utf-8", errors="surrogateescape")
