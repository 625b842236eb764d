"""Camera poses from hand-eye calibrations, in the files that easy_handeye and easy_handeye2 write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from tests.cells import edit, refused

CAMERAS = Path(__file__).parents[1] / "cases" / "cameras"
ORIGINAL = "    frame: wrist\n    pose: {position: [0, 0.05, 0], quaternion: [0, 0, 0, 1]}\n"


def with_hand_eye(cell: Path, file: str, extra: str = "") -> Path:
    """The cell with its wrist camera where a calibration says."""
    edit(cell, ORIGINAL, f"    hand_eye: {CAMERAS / file}\n{extra}")
    return cell


IN_HAND = [[0, 0, 1, 0.03], [0, 1, 0, -0.05], [-1, 0, 0, 0.12], [0, 0, 0, 1]]
ON_BASE = [[1, 0, 0, 0.5], [0, -1, 0, 0], [0, 0, -1, 1.4], [0, 0, 0, 1]]


@pytest.mark.parametrize(("file", "extra", "frame", "X_FC"), [
        ("easy_handeye_in_hand.yaml", "", "wrist", IN_HAND),
        ("easy_handeye2_on_base.calib", "", "base", ON_BASE),  # looks down
        ("easy_handeye_in_hand.yaml", "    frame: lower\n", "lower", IN_HAND),
])  # fmt: skip
def test_a_camera_sits_on_the_effector_the_base_or_the_link_that_the_workspace_names(cell, file, extra, frame, X_FC):
    camera = load_workspace(with_hand_eye(cell, file, extra)).cameras["hand"]
    assert camera.frame == frame
    np.testing.assert_allclose(camera.X_FC, X_FC, atol=1e-7)


def test_a_frame_that_is_not_optical_is_doubted_until_the_axes_are_stated(cell):
    doubted = load_workspace(with_hand_eye(cell, "easy_handeye_early.yaml"))
    assert [warning.code for warning in doubted.warnings if warning.code == "doubtful-axes"] == ["doubtful-axes"]
    np.testing.assert_allclose(doubted.cameras["hand"].X_FC[:3, 3], [-0.2, 0.4, 0.3])


def test_body_axes_are_turned_into_optical_ones(cell):
    workspace = load_workspace(with_hand_eye(cell, "easy_handeye_early.yaml", "    convention: body\n"))
    np.testing.assert_allclose(workspace.cameras["hand"].X_FC[:3, 2], [1, 0, 0])
    assert [warning for warning in workspace.warnings if warning.code == "doubtful-axes"] == []


def test_pose_and_calibration_exclude_each_other(cell):
    path = with_hand_eye(cell, "easy_handeye_in_hand.yaml", "    pose: {position: [0, 0, 1]}\n")
    with pytest.raises(InputError, match="exactly one of the keys `pose`, `hand_eye`"):
        load_workspace(path)


def test_a_frame_that_the_robot_lacks_is_refused_in_the_calibration_itself(cell):
    text = (CAMERAS / "easy_handeye_in_hand.yaml").read_text(encoding="utf-8")
    (cell / "wrist.yaml").write_text(text.replace("frame: wrist", "frame: wirst"), encoding="utf-8")
    problem = refused(load_workspace, with_hand_eye(cell, str(cell / "wrist.yaml")))
    assert (problem.code, problem.place.line) == ("unknown-frame", 8)
    assert "`wrist`" in problem.message
    assert "frame:" in problem.mend
