"""What changed in a workspace: named by file and field, and nothing that does not matter."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sqrp_cli.score.baseline import Baseline, workspace_changes
from sqrp_cli.score.compute import Means, open_computer
from sqrp_cli.score.score import read_cell
from sqrp_cli.study.sampling import Adaptive
from tests.cells import read_cases

CELL = Path(__file__).parents[1] / "cases" / "cell"


@pytest.fixture
def own_cell(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CELL, tmp_path / "cell"))


def changes(cell: Path) -> list[str]:
    """What changed in a copy of the cell."""
    before, now = (read_cell(folder / "workspace.yaml", "cell") for folder in (CELL, cell))
    with open_computer(Means(Adaptive())) as computer:
        baseline = Baseline.of([before], [], computer)
    record = baseline.workspaces["cell"]
    found = workspace_changes(record.digest, record.files, baseline.fields, now.workspace)
    same = [one.content for one in now.requests] == [one.content for one in before.requests]
    assert not (found and same), found
    return [str(change) for change in found]


@pytest.mark.parametrize(("file", "old", "new", "expected"), read_cases("changes.yaml"))
def test_a_change_is_named_by_file_and_field(own_cell, file, old, new, expected):
    path = own_cell / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    found = changes(own_cell)
    assert found == ([expected] if expected else [])


def test_a_mesh_is_named_by_its_digest(own_cell):
    mesh = own_cell / "cube.stl"
    mesh.write_bytes(mesh.read_bytes() + b" ")
    found = changes(own_cell)
    assert [change.split(" content: ")[0] for change in found] == ["objects.tray.parts.2", "robot.urdf.lower"]
