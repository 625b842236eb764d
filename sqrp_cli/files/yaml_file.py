"""Reading YAML files safely, with the position of every key and value.

Scalars follow the core schema of YAML 1.2: `1e-3` is a number, `on` and `no` are text, octal and sexagesimal numbers do
not exist. Keys are always text. Numbers must be finite.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files import source
from sqrp_cli.files.input_file import decoded, read_input

MAX_BYTES = 1_000_000  # largest YAML file that is read
MAX_VALUES = 100_000  # most values in a file; each use of an alias counts
MAX_DEPTH = 32  # deepest nesting of mappings and lists
_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN|Nan)")
_CLOSING = re.compile(r"\n---\s*\Z")  # the line that ROS prints after each message; in YAML it begins another document
_QUOTED = re.compile(r"([`']).*\1", re.DOTALL)  # a quote of a file in a message, quotation marks within it included
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}

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

_IMPLICIT_TAGS = frozenset(
    f"tag:yaml.org,2002:{name}"
    for name in ("map", "seq", "str", "int", "float", "bool", "null", "merge", "timestamp", "value")
)


def read_yaml(path: Path, tags: frozenset[str] = frozenset(), keys: Collection[str] = ()) -> source.SourceDocument:
    """The YAML file at `path`, which must hold a mapping.

    tags: explicit tags (such as `!!opencv-matrix`) that are accepted and ignored; all others are refused.
    keys: top-level keys of this kind of file. A file with none of them is not quoted in messages: it may be a secret
    file, named to see its content. Without keys every file is quoted.

    Raises InputError for a file that is missing, too large, not UTF-8, empty, not a mapping, not valid YAML, repeats a
    key, or exceeds a limit of this module.
    """
    return parse_yaml(path, read_input(path, MAX_BYTES), tags, keys)


def parse_yaml(
    path: Path, content: bytes, tags: frozenset[str] = frozenset(), keys: Collection[str] = (), lists: bool = False,
    repeats: bool = False,
) -> source.SourceDocument:  # fmt: skip
    """As `read_yaml`, from content in memory; path: named in problems; lists: whether it may hold a list.

    repeats: whether keys may be given twice, as some programs write them; the last counts.
    """
    text = decoded(path, content)
    if text.startswith("%YAML:"):  # OpenCV's header, which is not YAML
        text = "#" + text[1:]
    text = _CLOSING.sub("\n", text)
    try:
        root = _compose(path, text)
        if root is None:
            raise bad_input("empty-file", "the file is empty, expected a mapping of keys to values", Place(path))
        document = _plain(root, path, text, tags, repeats)
        if not isinstance(document.data, (dict, list) if lists else dict):
            found = "text" if isinstance(document.data, str) else source.describe(document.data)
            message = f"found {found}, expected a mapping of keys to values"
            raise bad_input("not-a-mapping", message, document.values[()])
        return replace(document, content=content)
    except InputError as error:
        if not keys or top_key(keys).search(text):
            raise
        hints = _SYNTAX_HINTS.values()
        said = [one.message if one.message in hints else _QUOTED.sub("`...`", one.message) for one in error.problems]
        unquoted = [replace(one, message=text, excerpt=None) for one, text in zip(error.problems, said, strict=True)]
        raise InputError(*unquoted) from None


def top_key(keys: Collection[str]) -> re.Pattern[str]:
    """Matches a line that begins with one of the keys."""
    return re.compile(rf"""^(?:\{{\s*)?["']?(?:{"|".join(map(re.escape, keys))})["']?\s*:""", re.MULTILINE)


if yaml.__with_libyaml__:

    @lru_cache(maxsize=16)
    def _compose_fast(text: str) -> yaml.Node | None:
        """As `_compose`, cached: cells often share the texts of skills."""
        return _FastLoader(text).get_single_node()

    class _FastLoader(yaml.CSafeLoader):
        """libyaml's loader, ten times as fast; raises YAMLError for anything unusual."""

        # Scalars without a tag are resolved elsewhere: doing it here would take half of the time.
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


def _compose(path: Path, text: str) -> yaml.Node | None:
    if yaml.__with_libyaml__:
        try:
            return _compose_fast(text)
        except yaml.YAMLError:
            pass  # the other parser has better messages
    try:
        loader, depth, nodes = yaml.SafeLoader(text), 0, 0
        while loader.check_event():  # Python's own stack refuses deep nesting later
            event = loader.get_event()  # type: ignore[no-untyped-call]
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            nodes += isinstance(event, yaml.NodeEvent)
            if depth > MAX_DEPTH or nodes > 2 * MAX_VALUES:  # a key is a node, too
                many = Problem("too-many-values", f"more than {MAX_VALUES:,} values")
                problem = source.too_deep(None, MAX_DEPTH) if depth > MAX_DEPTH else many
                raise InputError(_quoting(problem, path, text, event.start_mark))
        return yaml.compose(text, yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark, opened, context = error.problem_mark or error.context_mark, error.context_mark, error.context or ""
        if mark and opened and opened.line < mark.line and context.startswith("while") and "block" not in context:
            mark = opened  # the start of a bracket, quote or key that is not closed in its line
        said = error.problem or error.context or "not YAML"
        hint = next((hint for part, hint in _SYNTAX_HINTS.items() if part in f"{error.context} {said}"), said)
        raise InputError(_quoting(Problem("yaml-syntax", hint, Place(path)), path, text, mark)) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        column = error.position - text.rfind("\n", 0, error.position)
        message = f"character U+{ord(text[error.position]):04X} is not allowed in YAML"
        raise bad_input("yaml-syntax", message, Place(path, line, column)) from error
    except (ValueError, OverflowError) as error:  # `\\U` or `%YAML` with a number that Python refuses
        problem = Problem("yaml-syntax", "the number of a character or of a version is too large")
        raise InputError(_quoting(problem, path, text, loader.get_mark())) from error


def _quoting(problem: Problem, path: Path, text: str, mark: Any) -> Problem:  # noqa: ANN401 - of either parser
    """The problem with its place at a mark, if any, and that line as an excerpt."""
    if mark is None:
        return problem
    lines = text.splitlines()
    line = lines[mark.line] if mark.line < len(lines) else ""
    place = Place(path, mark.line + 1, mark.column + 1)
    return replace(problem, place=place, excerpt=source.excerpt(line, mark.column + 1))


def _plain(root: yaml.Node, path: Path, text: str, tags: frozenset[str], repeats: bool) -> source.SourceDocument:
    """YAML nodes as plain values with their places; the data may be anything yet."""
    keys: dict[source.KeyPath, Place] = {}
    values: dict[source.KeyPath, Place] = {}
    lines = text.splitlines()

    def place_of(node: yaml.Node) -> Place:
        return Place(path, node.start_mark.line + 1, node.start_mark.column + 1)

    def pairs(node: yaml.MappingNode) -> Iterator[tuple[yaml.Node, yaml.Node]]:
        """Keys and values of a mapping, those merged with `<<: *anchor` after its own, which take precedence."""
        own: set[str] = set()
        merged: list[yaml.Node] = []
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise bad_input("yaml-key", "a key must be a word, not a list or mapping", place_of(key_node))
            if key_node.value == "<<" and not key_node.style:
                merged.append(value_node)
            else:
                own.add(key_node.value)
                yield key_node, value_node
        for value_node in merged:
            if not isinstance(value_node, yaml.MappingNode) or value_node is node:
                raise bad_input("yaml-key", "`<<` merges one mapping, such as `*base`", place_of(value_node))
            yield from (pair for pair in value_node.value if pair[0].value not in own)

    def build(node: yaml.Node, at: source.KeyPath) -> Any:  # noqa: ANN401 - YAML holds anything
        if len(values) >= MAX_VALUES:
            message = f"more than {MAX_VALUES:,} values (an alias counts as often as it is used)"
            raise bad_input("too-many-values", message, place_of(node))
        if len(at) > MAX_DEPTH:
            raise InputError(source.too_deep(place_of(node), MAX_DEPTH, hint=" (an alias inside its own anchor?)"))
        values[at], style = place_of(node), node.style if isinstance(node, yaml.ScalarNode) else None
        if style in ("'", '"'):
            values[at] = replace(values[at], column=node.start_mark.column + 2)
        elif style:  # a block, whose text begins in a line below its sign
            filled = (row for row in range(node.start_mark.line + 1, len(lines)) if lines[row].strip())
            if (row := next(filled, None)) is not None:
                values[at] = Place(path, row + 1, len(lines[row]) - len(lines[row].lstrip()) + 1)
        explicit_tag = node.tag not in _IMPLICIT_TAGS and node.tag.replace("tag:yaml.org,2002:", "!!")
        if explicit_tag and explicit_tag not in tags:
            raise bad_input("yaml-tag", f"the tag `{explicit_tag}` is not accepted", place_of(node))
        if isinstance(node, yaml.MappingNode):
            data: source.Data = {}
            for key_node, value_node in pairs(node):
                key, place = str(key_node.value), place_of(key_node)
                if key in data and not repeats:
                    first = keys[(*at, key)].line
                    message = f"`{source.dotted((*at, key))}` is given twice, first in line {first}"
                    raise bad_input("duplicate-key", message, place)
                keys[(*at, key)] = place
                data[key] = build(value_node, (*at, key))
            return data
        if isinstance(node, yaml.SequenceNode):
            keys.update({(*at, index): place_of(child) for index, child in enumerate(node.value)})
            return [build(child, (*at, index)) for index, child in enumerate(node.value)]
        if not isinstance(node, yaml.ScalarNode) or node.style:
            return str(node.value) if isinstance(node, yaml.ScalarNode) else None
        word = str(node.value)
        if word.lower() in _WORDS:
            return _WORDS[word.lower()]
        if _INTEGER.fullmatch(word) and len(word) < 20:
            return int(word)
        if _NOT_FINITE.fullmatch(word) or (_FLOAT.fullmatch(word) and abs(float(word)) == float("inf")):
            raise InputError(source.not_finite(place_of(node), word))
        return float(word) if _FLOAT.fullmatch(word) else word

    return source.SourceDocument(path, b"", build(root, ()), keys, values)
