"""Files that are made to fill the memory, to take for ever or to upset a reader; those of text are in `bombs.yaml`."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import yaml

TABLE: dict[str, Any] = yaml.load(
    Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"),
    getattr(yaml, "CSafeLoader", yaml.SafeLoader),  # noqa: S506 - both are safe
)


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


def whole(name: str, content: bytes | Callable[[], bytes]) -> Bomb:
    """A bomb that is the whole file."""
    return edited(name, lambda _content, _random: content() if callable(content) else content)


def text_of(pieces: Any) -> str:
    """A new text as the table writes it."""
    if isinstance(pieces, dict):
        ((times, piece),) = pieces.items()
        piece, count = text_of(piece), int(times[1:])
        if "{i" not in piece:
            return piece * count
        split = re.split(r"\{i(|\+1)\}", piece)
        return "".join("".join([split[0], *(str(i + bool(plus)) + rest for plus, rest in zip(split[1::2], split[2::2],
            strict=True))]) for i in range(count))  # fmt: skip
    return "".join(map(text_of, pieces)) if isinstance(pieces, list) else pieces


def listed(section: str) -> Iterator[Bomb]:
    """The bombs of a section of the table."""
    for name, (where, pieces) in TABLE[section].items():

        def edit(content: bytes, random: Random, where: str = where, pieces: Any = pieces, name: str = name) -> bytes:
            new, start, end = text_of(pieces).encode(), 0, len(content)
            if where == "^":
                end = 0
            elif where == "$":
                start = end
            elif where == "?":
                start = end = random.randrange(len(content))
            elif where[0] == where[-1] == "/":
                found = list(re.finditer(where[1:-1].encode(), content))
                start, end = random.choice(found).span() if found else (0, end)
            elif where != "^$":
                start = content.find(where.encode())
                end = start + len(where.encode())
                if start < 0:
                    raise AssertionError(f"the bomb `{name}` finds no `{where}`")
            return content[:start] + new + content[end:]

        yield edited(name, edit)


def _line_again(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    at = random.randrange(len(lines))
    return b"\n".join([*lines[:at], *[lines[at]] * 20_000, *lines[at + 1 :]])


def in_place(name: str, make: Callable[[Path], object]) -> Bomb:
    """A bomb that is no file."""

    def place(path: Path, _random: Random) -> None:
        path.unlink()
        make(path)

    return Bomb(name, place)


ELSEWHERE = (
    in_place("a-folder", Path.mkdir),
    in_place("a-pipe", os.mkfifo),
    in_place("endless", lambda path: path.symlink_to("/dev/zero")),
)
TEXT = (
    *listed("text"),
    edited("line-20000-times", _line_again),
    edited("utf-16", lambda content, _: content.decode(errors="replace").encode("utf-16")),
    edited("latin-1", lambda content, _: content.replace(b"a", b"\xe4", 3)),
    edited("carriage-returns", lambda content, _: content.replace(b"\n", b"\r")),
    edited("no-line-ends", lambda content, _: content.replace(b"\n", b" ")),
    edited("tabs", lambda content, _: content.replace(b"  ", b"\t")),
    edited("surrogate", lambda content, random: content[: (at := random.randrange(len(content)))] + b"\xed\xa0\x80"
           + content[at:]),
    whole("noise", lambda: Random(0).randbytes(10_000)),  # noqa: S311
    in_place("gone", lambda _: None),
    in_place("link-to-itself", lambda path: path.symlink_to(path.name)),
    in_place("link-to-nowhere", lambda path: path.symlink_to("nowhere")),
    *ELSEWHERE,
)  # fmt: skip
"""In any text file."""
YAML = (*listed("yaml"), whole("indents", lambda: b"".join(b" " * i + b"a:\n" for i in range(1200))))
"""In any YAML file."""
