"""A copy of the workspace in tests/cases/cell, which tests may damage."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Damage = Callable[[dict[str, Any]], Path]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A fresh copy of the cell."""
    return Path(shutil.copytree(Path(__file__).parents[1] / "cases" / "cell", tmp_path / "cell"))


@pytest.fixture
def damaged(cell: Path) -> Damage:
    """Edits the copy as a case describes (see tests/cases/bad_inputs.yaml) and gives its folder."""

    def damage(case: dict[str, Any]) -> Path:
        for edit in case.get("edits", [case]):
            path = cell / edit["file"]
            if edit.get("delete"):
                path.unlink()
            elif "bytes" in edit:
                path.write_bytes(bytes.fromhex(edit["bytes"]))
            elif "text" in edit:
                path.write_text(edit["text"] * edit.get("times", 1), encoding="utf-8")
            else:
                text = path.read_text(encoding="utf-8") + edit.get("append", "")
                for old, new in edit.get("replace", {}).items():
                    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {edit['file']}"
                    text = text.replace(old, new)
                path.write_text(text, encoding="utf-8")
        return cell

    return damage


@pytest.fixture
def position_of() -> Callable[[str, Path], tuple[int, int]]:
    """Line and column, from 1, at which a text first stands in a file."""

    def find(text: str, path: Path) -> tuple[int, int]:
        content = path.read_text(encoding="utf-8")
        before = content[: content.index(text)]
        return before.count("\n") + 1, len(before) - before.rfind("\n")

    return find
