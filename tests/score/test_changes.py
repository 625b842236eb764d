"""What changed in a workspace: named by file and field, and nothing that does not matter."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sqrp_cli.score.baseline import Baseline, workspace_changes
from sqrp_cli.score.compute import Means, open_computer
from sqrp_cli.score.score import read_cell
from sqrp_cli.study.sampling import Adaptive

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
    same = [one.content for one in now.wanted] == [one.content for one in before.wanted]
    assert not (found and same), found
    return [str(change) for change in found]


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("workspace.yaml", "[0.5, 0, 1.5]", "[0.5, 0, 1.6]", "cameras.top.pose.position.2: 1.5 -> 1.6"),
        ("workspace.yaml", "    far: 4 m\n", "", "cameras.top.far = 4 m is gone"),
        ("side.yaml", "617.20", "618.20", "cameras.side.calibration camera_matrix.data.0: 617.2 -> 618.2"),
        ("pickup/skill.yaml", "speed: 1", "speed: 0.5", "skills.pickup.yaml motion.speed: 1 -> 0.5"),
        ("arm.urdf", 'velocity="0.5"', 'velocity="0.4"', "robot.urdf joint.slide.limit.velocity: 0.5 -> 0.4"),
        (
            "pickup/pickup.pddl",
            "and (on_table ?object) (not",
            "and (not",
            "skills.pickup.pddl pickup.precondition: (and (on_table ?object) {rest} -> (and {rest}".replace(
                "{rest}", "(not (hold ?object)) (hand_empty))"
            ),
        ),
        ("workspace.yaml", "near: 10 cm", "near: 100 mm", ""),
        ("workspace.yaml", "near: 10 cm", "near: 0.1", ""),
        ("workspace.yaml", "rpy: [0, 0, -90 deg]", "rpy: [0, 0.0, -90.0 °]", ""),
        ("workspace.yaml", "near: 10 cm", "near: 101 mm", "cameras.top.near: 10 cm -> 101 mm"),
        ("workspace.yaml", "acceleration: 3", "acceleration: 300 cm/s^2", "robot.limits.acceleration: 3 -> 300 cm/s^2"),
        ("pickup/skill.yaml", "speed: 5 cm/s", "speed: 50 mm/s", ""),
        ("arm.urdf", 'velocity="2"', 'velocity="2.0"', ""),
        ("arm.urdf", 'xyz="0 0 1"', 'xyz="0.0 0 1.0"', ""),
        ("arm.srdf", "robot>", "robot><!-- why -->", ""),
        ("workspace.yaml", "objects:", "# things\nobjects:", ""),
        ("workspace.yaml", "task: ", "min_q_avg: 0.1, task: ", ""),
    ],
)
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
