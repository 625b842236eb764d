"""Editing a YAML file as text: single values, whole entries and new ones; the rest stays, comments too.

Also patches: the text of a change, and the command that applies it.
"""

from __future__ import annotations

import difflib
import io
import os
import shlex
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from sqrp_cli.errors import InputError, Place, bad_input, expected_names, nearest
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.yaml_file import parse_yaml

_ABSENT = object()  # in place of a value that is missing


def with_values(document: SourceDocument, values: Mapping[str, str]) -> bytes:
    """The content of a document with values, lists or mappings written anew, or added to a mapping.

    values: by dotted path (`cameras.cam1.pose.position.0`), as YAML text in a line. Raises InputError for a path that
    leads nowhere, and where that would change anything else: the value belongs to an anchor.
    """
    known, (text, root) = {dotted(keys): keys for keys in document.values if keys}, _text_and_root(document)
    new = list[tuple[int, int, str]]()  # where text is replaced, and by what
    later = [path for path in values if path not in known or any(path.startswith(f"{other}.") for other in values)]
    first = [path for path in values if path not in later]
    for path in first:
        *above, key = known[path]
        parent, node = _node(root, tuple(above)), _node(root, known[path])
        start, end, value = node.start_mark.index, _end(node), values[path]
        is_empty = end == start
        end += is_empty and text[end : end + 1] == " "
        if isinstance(parent, yaml.MappingNode) and (path not in document.leaves or is_empty):
            # From its key on, so that a block, or nothing, becomes a value beside it.
            starts = (name.start_mark.index for name, _ in parent.value if str(name.value) == str(key))
            start = next(starts, start)
            value = f"{key}: {value}"
        new.append((start, end, value))
    for start, end, value in sorted(new, reverse=True):
        text = text[:start] + value + text[end:]
    content = _checked(document, text, *first) if new else document.content
    for path in later:
        document = parse_yaml(document.path, content)
        known, (parent, _, key) = {dotted(keys): keys for keys in document.values if keys}, path.rpartition(".")
        if path in known:
            content = with_values(document, {path: values[path]})
        elif isinstance(document.at(known.get(parent, (parent,))), dict) and key:
            content = appended(document, known[parent], f"{key}: {values[path]}")
        else:
            # All paths of a file are hundreds: those of its top, and the nearest, are enough to go on from.
            close = nearest(path, known)
            names = {name for name, keys in known.items() if len(keys) == 1 or name == close}
            message = f"the file has no value `{path}`; {expected_names(path, names)}"
            raise bad_input("unknown-value", message, Place(document.path))
    return content


def changed_values(before: SourceDocument, content: bytes) -> dict[str, str] | None:
    """What `with_values` writes to make a content of a document; None where that cannot make it."""
    after = parse_yaml(before.path, content)
    text, root = _text_and_root(after)
    # The shortest paths below which the two differ, and of what the second one adds.
    values: dict[str, str] = {}
    pairs: list[tuple[object, object, KeyPath]] = [(before.data, after.data, ())]  # the next one last
    while pairs:
        old, new, path = pairs.pop()
        if isinstance(old, dict) and isinstance(new, dict) and old.keys() <= new.keys():
            pairs += [(old.get(key, _ABSENT), new[key], (*path, key)) for key in reversed([*new])]
        elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
            pairs += [(old[index], new[index], (*path, index)) for index in reversed(range(len(new)))]
        elif old != new or type(old) is not type(new):
            node = _node(root, path)
            values[dotted(path)] = text[node.start_mark.index : _end(node)]
    try:
        return values if with_values(before, values) == content else None
    except InputError:
        return None


def appended(document: SourceDocument, path: KeyPath, item: str) -> bytes:
    """The content of a document with an item after the last one of a mapping or list; item: as YAML text in a line.

    An item of a mapping has its key. A mapping or list that is missing is added at the end of the file; only at the top
    of a file may one be missing. Raises InputError where that would change anything else.
    """
    text, root = _text_and_root(document)
    listed = ":" not in item.partition("{")[0]
    if path not in document.values:
        text = text.rstrip("\n") + f"\n\n{path[-1]}:\n  {'- ' if listed else ''}{item}\n"
        return _checked(document, text, dotted(path))
    node = _node(root, path)
    if node.flow_style or not node.value:
        end = text.rindex("]" if listed else "}", node.start_mark.index, node.end_mark.index)
        before = text[:end].rstrip()
        text = before + (", " if node.value else "") + item + text[end:]
        return _checked(document, text, dotted(path))
    line = text.find("\n", _end(node)) % (len(text) + 1)  # at the end of the text if there is none
    column = (node if listed else node.value[0][0]).start_mark.column
    new = f"\n{' ' * column}{'- ' if listed else ''}{item}"
    return _checked(document, text[:line] + new + text[line:], dotted(path))


def with_entries(document: SourceDocument, path: KeyPath, kept: Collection[str], items: Sequence[str]) -> bytes:
    """The content of a document with other entries of a mapping: those of `kept`, then `items`, one in a line each.

    items: as YAML text with their keys; at least one entry is left. Comments between entries go, those within stay.
    Raises InputError where that would change anything else.
    """
    text, root = _text_and_root(document)
    if path not in document.values:
        content = document.content
        for item in items:
            content = appended(parse_yaml(document.path, content), path, item)
        return content
    node = _node(root, path)
    entries = [(str(key.value), text[key.start_mark.index : _end(value)]) for key, value in node.value]
    left = [*(entry for name, entry in entries if name in kept), *items]
    if node.flow_style or not node.value:
        new = "{" + ", ".join(left) + "}"
        start, end = node.start_mark.index, node.end_mark.index
        return _checked(document, text[:start] + new + text[end:], dotted(path))
    first, end = node.value[0][0].start_mark, _end(node)
    if entries[-1][0] not in kept:
        end = text.find("\n", end) % (len(text) + 1)
    new = f"\n{' ' * first.column}".join(left)
    return _checked(document, text[: first.index] + new + text[end:], dotted(path))


def _checked(document: SourceDocument, text: str, *meant: str) -> bytes:
    """The text as bytes. Raises InputError if a value differs that is not meant, as where an anchor is used twice.

    meant: the dotted paths of what may differ.
    """
    content = text.encode()
    known, leaves = document.leaves, parse_yaml(document.path, content).leaves
    others = {name for name in (*known, *leaves) if known.get(name) != leaves.get(name)}
    others -= {name for name in others for path in meant if f"{name}.".startswith(f"{path}.")}
    if others:
        message = f"changing `{', '.join(meant)}` would also change `{min(others)}`, which is the same text in the file"
        raise bad_input("shared-value", message, Place(document.path), mend="write the value out in both places")
    return content


def _text_and_root(document: SourceDocument) -> tuple[str, yaml.Node]:
    text = document.content.decode("utf-8-sig")
    root = yaml.compose(text, yaml.SafeLoader)
    assert root is not None  # noqa: S101 - it has values
    return text, root


def _node(node: yaml.Node, path: KeyPath) -> Any:  # noqa: ANN401 - a mapping, a list or a scalar
    """The value at a path; of a mapping its own keys come before merged ones."""
    for key in path:
        if isinstance(node, yaml.SequenceNode):
            node = node.value[int(key)]
            continue
        mappings = [node]
        for one in mappings:  # those that it merges come behind it
            mappings += [value for name, value in one.value if name.value == "<<" and name.style is None]
        entries = (entry for one in mappings for entry in one.value)
        node = next(value for name, value in entries if name.value == str(key) and (name.style or key != "<<"))
    return node


def _end(node: yaml.Node) -> int:
    """Where the text of a value ends; a block ends with its last value, before comments that follow."""
    if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(node, yaml.MappingNode) else last)


def patch(document: SourceDocument, content: bytes, name: str | None = None) -> str:
    """A unified diff from a document to a new content; empty if nothing differs.

    name: of the file in it; by default as `to_apply` needs it.
    """
    name = in_patch(document.path) if name is None else name
    before, after = ([*io.StringIO(text.decode(), newline="\n")] for text in (document.content, content))
    lines = difflib.unified_diff(before, after, name, name)
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines)


def from_here(path: Path) -> str:
    """The name of a file in a patch and in a command: relative if it is below the current folder."""
    current = Path.cwd()
    return (path.relative_to(current) if path.is_relative_to(current) else path).as_posix()


def in_patch(path: Path) -> str:
    """The name of a file in a patch; where it is not below the current folder, `patch` takes its bare name only."""
    name = from_here(Path(os.path.normpath(Path.cwd() / path)))
    return path.name if Path(name).is_absolute() else name


def to_apply(patch: Path, path: Path) -> str:
    """The command that applies a patch of a file, in the current folder."""
    at = "" if in_patch(path) != path.name else f" -d {shlex.quote(str(path.parent))}"
    return f"patch -p0{at} < {shlex.quote(str(patch))}"
