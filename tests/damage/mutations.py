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
        kind = random.choice(_KINDS)
        changed = kind(content, random)
        if changed != content:
            lines, words = _concerned(content, changed)
            return Damage(kind.__name__.strip("_"), changed, lines, words)


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
    return range(min(start, _owner(old, start) + 1), len(new) - tail + 2), words


def _owner(lines: list[str], at: int) -> int:
    """The line above with less indentation than one."""

    def indentation(line: str) -> int:
        return len(line) - len(line.lstrip(" -"))

    own = indentation(lines[at]) if at < len(lines) else 0
    return next((k for k in range(at - 1, -1, -1) if lines[k].strip() and indentation(lines[k]) < own), at)


def _flip_byte(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    return content[:at] + bytes([content[at] ^ (1 << random.randrange(8))]) + content[at + 1 :]


def _random_byte(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    return content[:at] + bytes([random.randrange(256)]) + content[at + random.randrange(2) :]


def _insert_character(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    return content[:at] + random.choice(_CHARACTERS).encode() + content[at:]


def _delete_range(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    return content[:at] + content[at + random.choice([1, 1, 2, 5, 20, 100]) :]


def _double_range(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    piece = content[at : at + random.choice([1, 2, 5, 20, 100])]
    return content[:at] + piece + content[at:]


def _truncate(content: bytes, random: Random) -> bytes:
    return content[: random.randrange(len(content))]


def _lines(edit: Callable[[list[bytes], int, Random], None]) -> Callable[[bytes, Random], bytes]:
    def kind(content: bytes, random: Random) -> bytes:
        lines = content.split(b"\n")
        edit(lines, random.randrange(len(lines)), random)
        return b"\n".join(lines)

    kind.__name__ = edit.__name__
    return kind


def _delete_line(lines: list[bytes], at: int, _random: Random) -> None:
    del lines[at]


def _double_line(lines: list[bytes], at: int, _random: Random) -> None:
    lines.insert(at, lines[at])


def _swap_lines(lines: list[bytes], at: int, random: Random) -> None:
    other = random.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]


def _indent_line(lines: list[bytes], at: int, random: Random) -> None:
    lines[at] = b"  " + lines[at] if random.random() < 0.5 else lines[at][1:]


def _matches(pattern: re.Pattern[str], new: Callable[[str, Random], str]) -> Callable[[bytes, Random], bytes]:
    def kind(content: bytes, random: Random) -> bytes:
        text = content.decode("utf-8", errors="surrogateescape")
        found = list(pattern.finditer(text))
        if not found:
            return content
        match = random.choice(found)
        text = text[: match.start()] + new(match[0], random) + text[match.end() :]
        return text.encode("utf-8", errors="surrogateescape")

    kind.__name__ = new.__name__
    return kind


def _change_number(_number: str, random: Random) -> str:
    return random.choice(_NUMBERS)


def _scale_number(number: str, random: Random) -> str:
    return f"{float(number) * random.choice([-1, 1e3, 1e-3, 1e6, 1.01]):g}"


def _misspell(word: str, random: Random) -> str:
    at = random.randrange(len(word) - 1)
    return random.choice(
        [word[:at] + word[at + 1 :], word[: at + 1] + word[at:], word[:at] + word[at + 1] + word[at] + word[at + 2 :]]
    )


def _replace_word(_word: str, random: Random) -> str:
    return random.choice(["xyzzy", "home", "world", "tool", "object", "table", "NaN", "true"])


def _change_value(_rest: str, random: Random) -> str:
    return ": " + random.choice(_VALUES)


def _rename_key(key: str, random: Random) -> str:
    return _misspell(key, random) if len(key) > 1 else key + key


_KINDS = (
    _flip_byte, _random_byte, _insert_character, _delete_range, _double_range, _truncate,
    *map(_lines, (_delete_line, _delete_line, _double_line, _swap_lines, _indent_line)),
    _matches(_NUMBER, _change_number), _matches(_NUMBER, _change_number), _matches(_NUMBER, _scale_number),
    _matches(_WORD, _misspell), _matches(_WORD, _misspell), _matches(_WORD, _replace_word),
    _matches(re.compile(r": [^\n]*"), _change_value), _matches(_KEY, _rename_key),
)  # fmt: skip
