"""Common to files of all formats: content with places, and messages that refuse or quote it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.records import dataclass

KeyPath = tuple[str | int, ...]  # keys and list indices from the top of a document to a value
LeafValue = str | float | int | bool | None
Data = dict[str, Any]  # a mapping of a file: nested dicts, lists, text, numbers, booleans and None


def dotted(path: KeyPath) -> str:
    """How messages name a key: `cameras.cam1.rate`."""
    return ".".join(map(str, path))


@dataclass(frozen=True, eq=False)
class SourceDocument:
    """The content of a file, with the place of every key and value."""

    path: Path
    content: bytes  # The file's bytes
    data: Data
    keys: Mapping[KeyPath, Place]  # Place of each key; for items of a list, of the item
    values: Mapping[KeyPath, Place]  # Start of each value's text
    within: KeyPath = ()  # Of a part of a file, its path, which messages put before those of keys
    named: Callable[[KeyPath], str] = dotted  # How messages name a key

    def part(self, at: KeyPath) -> SourceDocument:
        """The mapping at a path, as a document of its own."""
        keys, values = (
            {path[len(at) :]: place for path, place in places.items() if path[: len(at)] == at}
            for places in (self.keys, self.values)
        )
        return SourceDocument(self.path, self.content, self.at(at), keys, values, (*self.within, *at), self.named)

    @property
    def folder(self) -> Path:
        """The absolute path of the file's folder, where the files that it names are looked for."""
        return Path(os.path.abspath(self.path.parent))  # noqa: PTH100 - `..` goes too

    @cached_property
    def places(self) -> Mapping[str, Place]:
        """Position of every key by its dotted path."""
        return {dotted(path): place for path, place in self.keys.items()}

    @property
    def leaves(self) -> Mapping[str, LeafValue]:
        """Every value that is neither a mapping nor a list (or an empty one, as None), by its dotted path."""
        found: dict[str, LeafValue] = {}
        waiting: list[tuple[KeyPath, Any]] = [((), self.data)]
        while waiting:
            path, value = waiting.pop()
            if isinstance(value, dict | list) and value:
                inside = [*value.items()] if isinstance(value, dict) else [*enumerate(value)]
                waiting += [((*path, key), child) for key, child in reversed(inside)]
            else:
                found[dotted(path)] = value if isinstance(value, LeafValue) else None
        return found

    def at(self, path: KeyPath) -> Any:  # noqa: ANN401 - whatever the file has
        """The value at a path; None where there is none."""
        found: Any = self.data
        try:
            for key in path:
                found = found[key]
        except (LookupError, TypeError):
            return None
        return found

    def name(self, path: KeyPath) -> str:
        """The same, also of a part."""
        return self.named((*self.within, *path))

    def key_place(self, path: KeyPath) -> Place:
        """The place of a key; for a missing key, that of the mapping that should have it."""
        while path and path not in self.keys:
            path = path[:-1]
        return self.keys.get(path, Place(self.path))

    def value_place(self, path: KeyPath) -> Place:
        """The place of a value; for a missing one, as `key_place`."""
        return self.values.get(path) or self.key_place(path)

    def problem(self, code: str, path: KeyPath, message: str, mend: str | None = None) -> Problem:
        """A problem with the value at `path`; its dotted path is put before the message."""
        return Problem(code, f"`{self.name(path)}`: {message}", self.value_place(path), mend=mend)

    def error(self, code: str, path: KeyPath, message: str, mend: str | None = None) -> InputError:
        """The error of that problem alone."""
        return InputError(self.problem(code, path, message, mend))


def too_deep(place: Place | None, most: int, what: str = "", hint: str = "") -> Problem:
    """The problem of a file nested deeper than `most` levels."""
    return Problem("nesting-too-deep", f"{what}nested deeper than {most} levels{hint}", place)


def not_finite(place: Place, found: str, name: str = "") -> Problem:
    """The problem of an infinite or NaN number; found: as the file writes it; name: of its key, if it has one."""
    message = f"found {describe(found)}, expected a finite number"
    return Problem("not-finite", f"`{name}`: {message}" if name else message, place)


def describe(value: object) -> str:
    """A found value as messages show it."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "`true`" if value else "`false`"
    if isinstance(value, dict):
        return "a mapping" if value else "an empty mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    text = str(value)
    if isinstance(value, float) and text.endswith("00000.0") and float(f"{value:g}") == value:
        text = f"{value:g}".replace("e+0", "e").replace("e+", "e")  # `1e9`, as people write it
    return f"`{text if len(text) <= 60 else text[:57] + '...'}`"


def excerpt(line: str, column: int) -> str:
    """A line of text with a caret under `column` (from 1), shortened around it if it is long."""
    start = max(0, column - 60)
    shown = line[start : start + 100].replace("\t", " ")
    return f"{shown}\n{' ' * (column - 1 - start)}^"
