"""Files that are made to fill the memory, to take for ever or to upset a reader: those that any text file can be."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from random import Random

_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z0-9_]{2,}")


@dataclass(frozen=True)
class Bomb:
    """A name, and what is done to the file at a path."""

    name: str
    set: Callable[[Path, Random], None]


Edit = Callable[[bytes, Random], bytes]


def edited(name: str, edit: Edit) -> Bomb:
    """A bomb that is other content; a file that is a link to the undamaged one becomes a file of its own."""

    def place(path: Path, random: Random) -> None:
        content = edit(path.read_bytes(), random)
        path.unlink()
        path.write_bytes(content)

    return Bomb(name, place)


def replaced(name: str, old: str, new: str | Callable[[], str]) -> Bomb:
    """A bomb that is other words in one place. Raises AssertionError where the old ones are not in the file."""

    def edit(content: bytes, _random: Random) -> bytes:
        text = content.decode()
        if old not in text:
            raise AssertionError(f"the bomb `{name}` finds no `{old}`")
        return text.replace(old, new if isinstance(new, str) else new(), 1).encode()

    return edited(name, edit)


def whole(name: str, content: str | bytes | Callable[[], str | bytes]) -> Bomb:
    """A bomb that is the whole file."""

    def edit(_content: bytes, _random: Random) -> bytes:
        made = content() if callable(content) else content
        return made.encode() if isinstance(made, str) else made

    return edited(name, edit)


def at_a(pattern: re.Pattern[bytes], name: str, new: bytes | Callable[[bytes], bytes]) -> Bomb:
    """A bomb in place of one of the matches of a pattern."""

    def edit(content: bytes, random: Random) -> bytes:
        found = list(pattern.finditer(content))
        if not found:
            return new if isinstance(new, bytes) else new(content)
        match = random.choice(found)
        return content[: match.start()] + (new if isinstance(new, bytes) else new(match[0])) + content[match.end() :]

    return edited(name, edit)


def _inserted(name: str, piece: bytes) -> Bomb:
    def edit(content: bytes, random: Random) -> bytes:
        at = random.randrange(len(content))
        return content[:at] + piece + content[at:]

    return edited(name, edit)


def _line_again(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    at = random.randrange(len(lines))
    return b"\n".join([*lines[:at], *[lines[at]] * 20_000, *lines[at + 1 :]])


def _in_place(name: str, make: Callable[[Path], None]) -> Bomb:
    def place(path: Path, _random: Random) -> None:
        path.unlink()
        make(path)

    return Bomb(name, place)


_INSIDE_WORDS = {
    "nul": b"\0", "escape": b"\x1b[31m", "bell": b"\x07", "delete": b"\x7f", "next-line": b"\xc2\x85", "tab": b"\x0b",
    "leftwards": b"\xe2\x80\xae", "line-separator": b"\xe2\x80\xa8", "surrogate": b"\xed\xa0\x80",
}  # fmt: skip

NUMBERS = tuple(
    at_a(_NUMBER, name, number)
    for name, number in (
        ("number-of-400-digits", b"7" * 400), ("number-of-5000-digits", b"3" * 5000), ("decimals", b"0." + b"1" * 5000),
        ("1e999", b"1e999"), ("-1e308", b"-1e308"), ("1e18", b"1e18"), ("1e-320", b"1e-320"), ("1e-12", b"1e-12"),
        ("exponent", b"1e" + b"9" * 1000), ("2^63", b"9223372036854775808"), ("2^31", b"-2147483649"),
    )
)  # fmt: skip
"""In place of a number."""

TEXT = (
    *NUMBERS,
    *starmap(_inserted, (
        ("brackets", b"[" * 100_000), ("braces", b'{"a":' * 100_000), ("parentheses", b"(" * 100_000),
        ("elements", b"<a>" * 100_000), ("line-ends", b"\n" * 300_000),
    )),
    at_a(_WORD, "word-of-a-million", b"w" * 1_000_000),
    at_a(_WORD, "word-of-signs", "ä€😀".encode() * 30),
    *(at_a(_WORD, f"{name}-in-word", lambda word, sign=sign: word[:2] + sign + word[2:])
      for name, sign in _INSIDE_WORDS.items()),
    edited("line-20000-times", _line_again),
    edited("utf-16", lambda content, _: content.decode(errors="replace").encode("utf-16")),
    edited("latin-1", lambda content, _: content.replace(b"a", b"\xe4", 3)),
    edited("carriage-returns", lambda content, _: content.replace(b"\n", b"\r")),
    edited("no-line-ends", lambda content, _: content.replace(b"\n", b" ")),
    edited("tabs", lambda content, _: content.replace(b"  ", b"\t")),
    *starmap(whole, (
        ("empty", b""), ("blanks", b" \n" * 1000), ("only-line-ends", b"\n" * 900_000), ("nuls", bytes(100_000)),
    )),
    whole("noise", lambda: Random(0).randbytes(10_000)),  # noqa: S311
    whole("a-scalar", b"42\n"),
    whole("a-list", b"[1, 2, 3]\n"),
    whole("null", b"null\n"),
    _in_place("a-folder", Path.mkdir),
    _in_place("a-pipe", os.mkfifo),
    _in_place("gone", lambda _: None),
    _in_place("link-to-itself", lambda path: path.symlink_to(path.name)),
    _in_place("link-to-nowhere", lambda path: path.symlink_to("nowhere")),
    _in_place("endless", lambda path: path.symlink_to("/dev/zero")),
)  # fmt: skip
"""In any text file."""


def aliases() -> str:
    """Ten billion values by aliases of aliases."""
    lists = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    return lists + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 10))


def merges() -> str:
    """Mappings that merge each other, doubling each time."""
    return "b0: &b0 {k: 1}\n" + "".join(f"b{i}: &b{i}\n  <<: *b{i - 1}\n  x{i}: *b{i - 1}\n" for i in range(1, 40))


def _before(name: str, text: str | Callable[[], str]) -> Bomb:
    return edited(name, lambda content, _: (text if isinstance(text, str) else text()).encode() + content)


YAML = (
    *starmap(
        _before,
        (
            ("aliases", aliases),
            ("merges", merges),
            ("itself", "a: &a\n  b: *a\n"),
            ("indents", lambda: "".join(" " * i + "a:\n" for i in range(1200))),
            ("dashes", "- " * 100_000 + "x\n"),
            ("questions", "? " * 100_000 + "x\n"),
            ("values", "x: [" + "a," * 400_000 + "a]\n"),
            ("bytes", "x: '" + "a" * 2_000_000 + "'\n"),
            ("keys", lambda: "".join(f"key{i}: 1\n" for i in range(60_000))),
            ("key-of-a-million", "k" * 1_000_000 + ": 1\n"),
            ("complex-key", "? [a, b]\n: 1\n"),
            ("object", "x: !!python/object/apply:os.system [exit]\n"),
            ("set", "x: !!set {a, b}\n"),
            ("binary", "x: !!binary gggg\n"),
            ("timestamp", "x: 2001-99-99\n"),
            ("documents", "--- 1\n" * 1000),
            ("sexagesimal", "x: " + "1:" * 5000 + "0\n"),
            ("hexadecimal", "x: 0x" + "f" * 100_000 + "\n"),
            ("binary-number", "x: 0b" + "1" * 100_000 + "\n"),
            ("underscores", "x: 1" + "_" * 100_000 + "1\n"),
            ("quotes", "x: '" + "''" * 200_000 + "'\n"),
            ("escapes", 'x: "' + "\\U0010ffff" * 10_000 + '"\n'),
            ("wrong-escape", 'x: "\\UFFFFFFFF"\n'),
            ("directive-of-5000-digits", "%YAML " + "9" * 5000 + ".1\n---\n"),
            ("lone-surrogate", 'x: "\\ud800"\n'),
            ("directives", "%YAML 9.9\n---\n"),
            ("tags", "%TAG ! tag:" + "x" * 100_000 + "\n---\n"),
        ),
    ),
)
"""In any YAML file."""
