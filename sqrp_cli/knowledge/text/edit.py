"""Changing single values in the text of a YAML file, and nothing else: comments and layout stay."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from sqrp_cli.errors import InputError, Place, Problem, expected_names
from sqrp_cli.knowledge.text.source import SourceDocument, parse_document


def edited(document: SourceDocument, values: Mapping[str, str]) -> bytes:
    """The content of a document with other values, by dotted path (`cameras.cam1.pose.position.0`), as YAML text.

    Raises InputError for a path that leads to no value of its own in the file: it is not there, is a list or a mapping,
    or belongs to an anchor that is used elsewhere, too.
    """
    text = document.content.decode("utf-8-sig")
    known = document.leaves
    for path in values:
        if path not in known:
            message = f"the file has no value `{path}`; {expected_names(path, known)}"
            raise InputError(Problem("unknown-value", message, Place(document.path)))
    root = yaml.compose(text, yaml.SafeLoader)
    assert root is not None  # noqa: S101 - it has values
    spans = sorted(((*_span(root, path.split(".")), value) for path, value in values.items()), reverse=True)
    for start, end, value in spans:
        text = text[:start] + value + text[end:]
    content = text.encode()
    leaves = parse_document(document.path, content).leaves
    others = [path for path in (*known, *leaves) if path not in values and known.get(path) != leaves.get(path)]
    if others:
        message = (
            f"changing `{', '.join(values)}` would also change `{min(others)}`, which is the same text in the file"
        )
        mend = "write the value out in both places"
        raise InputError(Problem("shared-value", message, Place(document.path), mend=mend))
    return content


def _span(node: yaml.Node, path: list[str]) -> tuple[int, int]:
    """Where the text of a value begins and ends."""
    for key in path:
        if isinstance(node, yaml.SequenceNode):
            node = node.value[int(key)]
        else:
            node = next(value for name, value in _pairs(node) if name == key)
    return node.start_mark.index, node.end_mark.index


def _pairs(node: yaml.Node) -> list[tuple[str, yaml.Node]]:
    """Keys and values of a mapping, those that it merges after its own."""
    own, merged = [], []
    for key, value in node.value:
        if key.value == "<<" and key.style is None:
            merged += _pairs(value)
        else:
            own.append((str(key.value), value))
    return [*own, *merged]
