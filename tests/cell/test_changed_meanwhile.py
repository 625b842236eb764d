"""A workspace file that has changed since it was read is not written over: of two changes at once none is lost."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sqrp_cli import open_cell
from sqrp_cli.errors import InputError
from tests.cells import ROOT

MOUNTS = """
mounts: {post: {points: [[0.0, 1.15, 0.9], [0.3, 1.15, 0.9]]}}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of `tabletop`, two mounts beside it."""
    for name in ("workspaces", "skills"):
        shutil.copytree(ROOT / name, tmp_path / name)
    folder = tmp_path / "workspaces" / "tabletop"
    (folder / "place.yaml").write_text(MOUNTS)
    return folder


def change(file: Path) -> str:
    """Another one's change; the text that is then there."""
    text = file.read_text().replace("rate: 10 Hz", "rate: 11 Hz", 1)
    assert text != file.read_text()
    file.write_text(text)
    return text


def test_cameras_are_not_written_over_a_change_that_came_after_the_cell_was_read(folder):
    cell, file = open_cell(folder), folder / "workspace.yaml"
    found = cell.place("pickup g2", cameras=2, ways="fastest")
    text = change(file)
    with pytest.raises(InputError, match="changed meanwhile"):
        found.apply()
    assert file.read_text() == text
    open_cell(folder).place("pickup g2", cameras=2, ways="fastest").apply()
    assert sorted(open_cell(folder).workspace.cameras) == ["cam1", "cam2"]
