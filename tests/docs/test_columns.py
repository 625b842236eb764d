"""Every column with figures that the terminal prints is defined in docs/reference/numbers.md."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NUMBERS = (ROOT / "docs" / "reference" / "numbers.md").read_text(encoding="utf-8")
TABLES = sorted((ROOT / "sqrp_cli" / "show" / "terminal").glob("*.py"))
UNNAMED = {"#"}
"""A column without a figure to define."""


def titles(tree: ast.Module) -> Iterator[str]:
    """The titles of columns of numbers in a module: given at once, or as a tuple that is handed on."""
    tuples = [
        (target.id, node.value.elts)
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)
        for target in node.targets
        if isinstance(target, ast.Name)
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "numbers":
            handed_on = {ast.unparse(word.value) for word in node.args if isinstance(word, ast.Starred)}
            parts = [*node.args, *(part for name, elements in tuples if name in handed_on for part in elements)]
            for part in parts:
                if isinstance(part, ast.Constant):
                    yield re.sub(r"\s*\[.*?\]", "", " ".join(part.value.split()))


@pytest.mark.parametrize("file", TABLES, ids=lambda file: file.stem)
def test_every_column_of_figures_is_defined(file: Path) -> None:
    found = set(titles(ast.parse(file.read_text(encoding="utf-8")))) - UNNAMED
    assert {title for title in found if f"`{title}`" not in NUMBERS} == set()


def test_columns_are_found() -> None:
    found = {title for file in TABLES for title in titles(ast.parse(file.read_text(encoding="utf-8")))}
    assert {"critical time seen", "noticed at the latest", "loss if it fails", "reacted", "predicted", "clock"} <= found
