"""Reading YAML files safely, with the position of every key and value.

Scalars follow the core schema of YAML 1.2: `1e-3` is a number, `on` and `no` are text, octal and sexagesimal numbers do
not exist. Keys are always text. Numbers must be finite.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import yaml

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.text.input_file import decoded, read_input

MAX_BYTES = 1_000_000
"""Largest YAML file that is read."""
MAX_VALUES = 100_000
"""Most values in a file, aliases counted as often as they are used."""
MAX_DEPTH = 32
"""Deepest nesting of mappings and lists."""

KeyPath = tuple[str | int, ...]
"""Keys and list indices from the top of a document to a value."""

LeafValue = str | float | int | bool | None

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN|Nan)")
_CLOSING = re.compile(r"\n---\s*\Z")
"""The line that ROS prints after each message, which YAML takes for the beginning of another document."""
_QUOTED = re.compile(r"([`']).*\1", re.DOTALL)
"""What messages quote of a file, quotation marks within it included."""
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}

_LIMIT_CODES = {"nested deeper": "nesting-too-deep", "more than": "too-many-values"}

_SYNTAX_HINTS = {
    "<stream end>": "the file ends inside a list, a mapping or a value",
    "mapping values are not allowed here": "a second `: ` on one line; put text that contains `: ` in quotes",
    "expected <block end>": "this line does not fit the lines above: check its indentation and the `:` of each key",
    "could not find expected ':'": "a key without `:`",
    "cannot start any token": "a character that cannot start a value; indent with spaces, or put the text in quotes",
    "expected ',' or ']'": "a list `[` that is not closed with `]`, or a missing `,`",
    "expected ',' or '}'": "a mapping `{` that is not closed with `}`, or a missing `,`",
    "expected '<document start>'": "this line does not fit the lines above: check their indentation",
    "expected a single document": "a second document (`---`); one file holds one document",
    "found undefined alias": "an alias (`*name`) without an anchor (`&name`) before it",
    "unexpected end of stream": "text in quotes that is not closed",
}


def dotted(path: KeyPath) -> str:
    """How messages name a key: `cameras.cam1.rate`."""
    return ".".join(map(str, path))


@dataclass(frozen=True, eq=False)
class SourceDocument:
    """The content of a YAML file.

    data: nested dicts, lists, text, numbers, booleans and None. content: the file's bytes.
    keys: where each key (for list items: the item) stands. values: where each value's text starts.
    """

    path: Path
    content: bytes
    data: dict[str, Any]
    keys: Mapping[KeyPath, Place]
    values: Mapping[KeyPath, Place]

    @cached_property
    def places(self) -> Mapping[str, Place]:
        """Position of every key by its dotted path."""
        return {dotted(path): place for path, place in self.keys.items()}

    @property
    def leaves(self) -> Mapping[str, LeafValue]:
        """Every value that is neither a mapping nor a list (or an empty one, as None), by its dotted path."""
        return {dotted(path): value for path, value in _leaves(self.data, ())}

    def name(self, path: KeyPath) -> str:
        """How messages name a key."""
        return dotted(path)

    def key_place(self, path: KeyPath) -> Place:
        """Where a key stands; for a key that is missing, where the mapping that should have it stands."""
        while path and path not in self.keys:
            path = path[:-1]
        return self.keys.get(path, Place(self.path))

    def value_place(self, path: KeyPath) -> Place:
        """Where a value stands; for one that is missing, as `key_place`."""
        return self.values.get(path) or self.key_place(path)

    def problem(self, code: str, path: KeyPath, message: str, mend: str | None = None) -> Problem:
        """A problem with the value at `path`; the message is prefixed with its dotted path."""
        return Problem(code, f"`{self.name(path)}`: {message}", self.value_place(path), mend=mend)


def read_document(path: Path, tags: frozenset[str] = frozenset(), keys: Collection[str] = ()) -> SourceDocument:
    """The YAML file at `path`, which must hold a mapping.

    tags: explicit tags (such as `!!opencv-matrix`) that are accepted and ignored; every other one is refused.
    keys: what files of this kind have at their top. Of a file with none of them no word is quoted, for it may be
    another one, named to see what it says; without keys every file is.

    Raises InputError for a file that is missing, too large, not UTF-8, empty, not a mapping, breaks YAML's syntax,
    repeats a key, or exceeds a limit of this module.
    """
    return parse_document(path, read_input(path, MAX_BYTES), tags, keys)


def parse_document(
    path: Path, content: bytes, tags: frozenset[str] = frozenset(), keys: Collection[str] = ()
) -> SourceDocument:
    """As `read_document`, of content that is at hand; path: what problems name."""
    text = _decode(path, content)
    try:
        return _parsed(path, content, text, tags)
    except InputError as error:
        if not keys or _top_key(keys).search(text):
            raise
        raise InputError(*map(_unquoted, error.problems)) from None


def _top_key(keys: Collection[str]) -> re.Pattern[str]:
    """Finds a line that begins with one of some keys."""
    return re.compile(rf"""^(?:\{{\s*)?["']?(?:{"|".join(map(re.escape, keys))})["']?\s*:""", re.MULTILINE)


def _unquoted(problem: Problem) -> Problem:
    """The problem without a word of the file."""
    hint = problem.message in _SYNTAX_HINTS.values()
    return replace(problem, message=problem.message if hint else _QUOTED.sub("`...`", problem.message), excerpt=None)


def _parsed(path: Path, content: bytes, text: str, tags: frozenset[str]) -> SourceDocument:
    root = _compose(path, text)
    if root is None:
        raise InputError(Problem("empty-file", "the file is empty, expected a mapping of keys to values", Place(path)))
    builder = _Builder(path, text.splitlines(), tags)
    data = builder.build(root, ())
    if not isinstance(data, dict):
        place = builder.values[()]
        found = "text" if isinstance(data, str) else describe(data)
        raise InputError(Problem("not-a-mapping", f"found {found}, expected a mapping of keys to values", place))
    return SourceDocument(path, content, data, builder.keys, builder.values)


def _leaves(value: object, path: KeyPath) -> Iterator[tuple[KeyPath, LeafValue]]:
    if isinstance(value, dict | list) and value:
        for key, child in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(child, (*path, key))
    else:
        yield path, value if isinstance(value, LeafValue) else None


def describe(value: object) -> str:
    """How messages name a value that was found."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "`true`" if value else "`false`"
    if isinstance(value, dict):
        return "a mapping" if value else "an empty mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    text = str(value)
    return f"`{text if len(text) <= 60 else text[:57] + '...'}`"


def excerpt(line: str, column: int) -> str:
    """A line of text with a caret under `column` (from 1), shortened around it if it is long."""
    start = max(0, column - 60)
    shown = line[start : start + 100].replace("\t", " ")
    return f"{shown}\n{' ' * (column - 1 - start)}^"


def _decode(path: Path, content: bytes) -> str:
    text = decoded(path, content)
    if text.startswith("%YAML:"):  # OpenCV's header, which YAML itself does not know
        text = "#" + text[1:]
    return _CLOSING.sub("\n", text)


if yaml.__with_libyaml__:

    class _FastLoader(yaml.CSafeLoader):
        """libyaml's loader, in a tenth of the time; raises YAMLError for everything out of the ordinary."""

        # What a scalar without a tag stands for is found elsewhere: looking for it here would take half of the time.
        yaml_implicit_resolvers: dict[str, list[Any]] = {}  # noqa: RUF012 # as the base class has it
        depth = 0

        def descend_resolver(self, parent: yaml.Node | None, index: int) -> None:  # noqa: ARG002
            """Called as each node begins."""
            self.depth += 1
            if self.depth > MAX_DEPTH:
                raise yaml.YAMLError

        def ascend_resolver(self) -> None:
            """Called as each node ends."""
            self.depth -= 1


@lru_cache(maxsize=16)
def _compose_fast(text: str) -> yaml.Node | None:
    """As `_compose`; cells often share their skills' texts, and each is parsed once."""
    node: yaml.Node | None = _FastLoader(text).get_single_node()
    return node


class _DepthLimitedLoader(yaml.SafeLoader):
    """A loader that refuses deep nesting before Python's own stack does."""

    depth = 0
    count = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self.depth += 1
        self.count += 1
        if self.count > 2 * MAX_VALUES:  # a key is a node, too
            problem = f"more than {MAX_VALUES:,} values"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=self.peek_event().start_mark)  # type: ignore[no-untyped-call]
        if self.depth > MAX_DEPTH:
            problem = f"nested deeper than {MAX_DEPTH} levels"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=self.peek_event().start_mark)  # type: ignore[no-untyped-call]
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def _compose(path: Path, text: str) -> yaml.Node | None:
    if yaml.__with_libyaml__:
        try:
            return _compose_fast(text)
        except yaml.YAMLError:
            pass  # the other parser says better what is wrong
    try:
        loader = _DepthLimitedLoader(text)
        return loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        raise InputError(_syntax_problem(path, text, error)) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        column = error.position - text.rfind("\n", 0, error.position)
        message = f"character U+{ord(text[error.position]):04X} is not allowed in YAML"
        raise InputError(Problem("yaml-syntax", message, Place(path, line, column))) from error
    except (ValueError, OverflowError) as error:  # `\\U` or `%YAML` with a number that Python refuses
        problem, mark = "the number of a character or of a version is too large", loader.get_mark()
        raise InputError(
            _syntax_problem(path, text, yaml.MarkedYAMLError(problem=problem, problem_mark=mark))
        ) from error


def _syntax_problem(path: Path, text: str, error: yaml.MarkedYAMLError) -> Problem:
    mark = error.problem_mark or error.context_mark
    opened = error.context_mark
    context = error.context or ""
    if mark and opened and opened.line < mark.line and context.startswith("while") and "block" not in context:
        mark = opened  # where a bracket, quote or key was opened that is not closed in its line
    problem = error.problem or error.context or "not YAML"
    code = next((code for start, code in _LIMIT_CODES.items() if problem.startswith(start)), "yaml-syntax")
    said = f"{error.context} {problem}"
    hint = next((hint for fragment, hint in _SYNTAX_HINTS.items() if fragment in said), problem)
    if mark is None:
        return Problem(code, hint, Place(path))
    lines = text.splitlines()
    line = lines[mark.line] if mark.line < len(lines) else ""
    return Problem(code, hint, Place(path, mark.line + 1, mark.column + 1), excerpt=excerpt(line, mark.column + 1))


class _Builder:
    """Turns YAML nodes into plain values and notes where they stand."""

    def __init__(self, path: Path, lines: list[str], tags: frozenset[str]) -> None:
        self.path = path
        self.lines = lines
        self.tags = tags
        self.keys: dict[KeyPath, Place] = {}
        self.values: dict[KeyPath, Place] = {}

    def build(self, node: yaml.Node, path: KeyPath) -> Any:  # noqa: ANN401 - YAML holds anything
        if len(self.values) >= MAX_VALUES:
            message = f"more than {MAX_VALUES:,} values (an alias counts as often as it is used)"
            raise InputError(Problem("too-many-values", message, self._place(node)))
        if len(path) > MAX_DEPTH:
            message = f"nested deeper than {MAX_DEPTH} levels (an alias inside its own anchor?)"
            raise InputError(Problem("nesting-too-deep", message, self._place(node)))
        self.values[path] = self._text_place(node)
        explicit_tag = node.tag not in _IMPLICIT_TAGS and node.tag.replace("tag:yaml.org,2002:", "!!")
        if explicit_tag and explicit_tag not in self.tags:
            raise InputError(Problem("yaml-tag", f"the tag `{explicit_tag}` is not accepted", self._place(node)))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self._item(child, (*path, index)) for index, child in enumerate(node.value)]
        return self._scalar(node) if isinstance(node, yaml.ScalarNode) else None

    def _item(self, node: yaml.Node, path: KeyPath) -> Any:  # noqa: ANN401
        self.keys[path] = self._place(node)
        return self.build(node, path)

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in self._pairs(node):
            key, place = str(key_node.value), self._place(key_node)
            if key in data:
                first = self.keys[(*path, key)]
                message = f"`{dotted((*path, key))}` is given twice, first in line {first.line}"
                raise InputError(Problem("duplicate-key", message, place))
            self.keys[(*path, key)] = place
            data[key] = self.build(value_node, (*path, key))
        return data

    def _pairs(self, node: yaml.MappingNode) -> Iterator[tuple[yaml.Node, yaml.Node]]:
        """Keys and values of a mapping, those merged with `<<: *anchor` after its own, which take precedence."""
        own: set[str] = set()
        merged: list[yaml.Node] = []
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise InputError(
                    Problem("yaml-key", "a key must be a word, not a list or mapping", self._place(key_node))
                )
            if key_node.value == "<<" and not key_node.style:
                merged.append(value_node)
            else:
                own.add(key_node.value)
                yield key_node, value_node
        for value_node in merged:
            if not isinstance(value_node, yaml.MappingNode) or value_node is node:
                raise InputError(
                    Problem("yaml-key", "`<<` merges one mapping, such as `*base`", self._place(value_node))
                )
            for pair in value_node.value:
                if pair[0].value not in own:
                    yield pair

    def _scalar(self, node: yaml.ScalarNode) -> LeafValue:
        text = str(node.value)
        if node.style:
            return text
        if text.lower() in _WORDS:
            return _WORDS[text.lower()]
        if _INTEGER.fullmatch(text) and len(text) < 20:
            return int(text)
        if _NOT_FINITE.fullmatch(text) or (_FLOAT.fullmatch(text) and abs(float(text)) == float("inf")):
            raise InputError(
                Problem("not-finite", f"found {describe(text)}, expected a finite number", self._place(node))
            )
        return float(text) if _FLOAT.fullmatch(text) else text

    def _place(self, node: yaml.Node) -> Place:
        return Place(self.path, node.start_mark.line + 1, node.start_mark.column + 1)

    def _text_place(self, node: yaml.Node) -> Place:
        """Where a scalar's text starts, behind its quote or block sign."""
        place = self._place(node)
        if not isinstance(node, yaml.ScalarNode) or not node.style:
            return place
        if node.style in "'\"":
            return Place(self.path, place.line, node.start_mark.column + 2)
        for number in range(node.start_mark.line + 1, len(self.lines)):
            if self.lines[number].strip():
                indentation = len(self.lines[number]) - len(self.lines[number].lstrip())
                return Place(self.path, number + 1, indentation + 1)
        return place


_IMPLICIT_TAGS = frozenset(
    f"tag:yaml.org,2002:{name}"
    for name in ("map", "seq", "str", "int", "float", "bool", "null", "merge", "timestamp", "value")
)
