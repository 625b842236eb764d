"""What commands print and write down, against golden files; `python -m tests.golden` makes them anew."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.golden import DOCUMENTS, FOLDER, differences, document, played, sections

SECTIONS = [(file.stem, section) for file in sorted(FOLDER.glob("*.txt")) for section in sections(file.stem)]


@pytest.mark.parametrize(("name", "section"), SECTIONS, ids=[f"{name}: {one.title}" for name, one in SECTIONS])
def test_commands_print_what_they_did(sqrp, tmp_path, name, section):
    if name == "linux" and not Path("/dev/full").exists():
        pytest.skip("needs the device that is always full")
    assert list(played(section, tmp_path, sqrp)) == section.lines


@pytest.mark.parametrize("name", DOCUMENTS)
def test_figures_of_shipped_cells_are_what_they_were(asked, name):
    was = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert list(differences(document(name, asked), was)) == []
