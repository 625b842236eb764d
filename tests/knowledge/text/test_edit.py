"""Changing single values of a YAML file: what was asked for changes, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.text.edit import edited
from sqrp_cli.knowledge.text.source import parse_document, read_document

TABLETOP = Path(__file__).parents[3] / "workspaces" / "tabletop" / "workspace.yaml"


def changed(text: str, **values: str) -> str:
    dotted = {path.replace("__", "."): value for path, value in values.items()}
    return edited(parse_document(Path("some.yaml"), text.encode()), dotted).decode()


def test_only_the_named_values_change() -> None:
    text = "a: {b: [1, 2 cm, x]}  # why\nc: 'quoted'\n"
    assert changed(text, a__b__1="3 cm", c="plain") == "a: {b: [1, 3 cm, x]}  # why\nc: plain\n"


def test_every_value_of_a_workspace_can_be_changed_alone() -> None:
    document = read_document(TABLETOP)
    for path in list(document.leaves)[::15]:
        leaves = parse_document(TABLETOP, edited(document, {path: "42"})).leaves
        assert leaves == {**document.leaves, path: 42}


@pytest.mark.parametrize("path", ["a.c", "a", "a.b.7"])
def test_a_path_without_a_value_is_refused_with_the_nearest(path: str) -> None:
    with pytest.raises(InputError, match="no value"):
        edited(parse_document(Path("some.yaml"), b"a: {b: [1, 2]}"), {path: "3"})


def test_a_value_that_an_anchor_shares_is_refused() -> None:
    text = "first: &same {rate: 10}\nsecond: *same\nthird: {<<: *same, far: 1}\n"
    with pytest.raises(InputError, match=r"would also change"):
        changed(text, first__rate="20")
    assert changed(text, third__far="2") == text.replace("far: 1", "far: 2")
