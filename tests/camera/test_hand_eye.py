"""Where a camera is: by results of easy_handeye, TF messages, launch files, commands and recordings."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2

from sqrp_cli.camera.hand_eye import read_hand_eye
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, rpy_to_matrix
from sqrp_cli.ros.messages import message_types
from tests.cells import edit, read_cases, refused

CASES = read_cases("static_transforms.yaml")
LINKS = ("world", "base", "wrist")
OPTICAL = (-0.5, 0.5, -0.5, 0.5)
IN_HAND = ("wrist", "camera_link", (0.03, -0.05, 0.12), (0.0, 0.6, 0.0, 0.8))
IN_CAMERA = ("camera_link", "camera_optical_frame", (0.0, 0.015, 0.0), OPTICAL)
OTHER = ("base", "lidar", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
Frames = tuple[str, str, Sequence[float], Sequence[float]]


def matrix(frames: Frames) -> Array:
    return pose(quaternion_to_matrix(frames[3]), frames[2])


X_HC = matrix(IN_HAND) @ matrix(IN_CAMERA)
"""Of the optical frame in the wrist."""


def written(folder: Path, kind: str, name: str) -> Path:
    """A file of the table."""
    (folder / name).write_text(CASES[kind][name], encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("name", CASES["chain"])
def test_a_chain_of_transforms_ends_at_the_first_link(tmp_path, name):
    found = read_hand_eye(written(tmp_path, "chain", name), carriers=LINKS)
    assert (found.parent, found.child) == ("wrist", "camera_optical_frame")
    np.testing.assert_allclose(found.X_PC, X_HC, atol=1e-9)


@pytest.mark.parametrize("name", CASES["in_hand"])
def test_launch_files_are_read_and_not_executed(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    found = read_hand_eye(written(tmp_path, "in_hand", name))
    assert found.parent == "wrist"
    np.testing.assert_allclose(found.X_PC, matrix(IN_HAND), atol=1e-9)
    assert not Path("trap").exists()


def test_angles_are_yaw_pitch_roll_in_the_older_order_and_by_name(tmp_path):
    path = tmp_path / "start.sh"
    expected = pose(rpy_to_matrix((0.1, 0.2, 0.3)), (1, 2, 3))
    older, named = "1 2 3 0.3 0.2 0.1 /wrist /cam 100", "--yaw 0.3 --x 1 --y=2 --z 3 --frame-id wrist"
    for words in (older, f"{named} --pitch 0.2 --roll 0.1 --child-frame-id cam"):
        path.write_text(f"rosrun tf static_transform_publisher {words}\n", encoding="utf-8")
        found = read_hand_eye(path)
        assert (found.parent, found.child) == ("wrist", "cam")
        np.testing.assert_allclose(found.X_PC, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap", "ros1"])
@pytest.mark.parametrize("whole", [True, False])
def test_recordings_are_read_as_rosbags_writes_them(tmp_path, kind, whole):
    path = bag(tmp_path, kind, [IN_HAND, IN_CAMERA, OTHER])
    if path.is_dir():
        path = path / "metadata.yaml" if whole else next(file for file in path.iterdir() if file.suffix != ".yaml")
    found = read_hand_eye(path, carriers=LINKS)
    assert (found.parent, found.child) == ("wrist", "camera_optical_frame")
    assert found.pose_file == "/tf_static of a recording"
    np.testing.assert_allclose(found.X_PC, X_HC, atol=1e-9)


def bag(folder: Path, kind: str, all_frames: Sequence[Frames]) -> Path:
    """By the writers of rosbags."""
    name, plugin = "tf2_msgs/msg/TFMessage", getattr(rosbag2.StoragePlugin, kind.upper(), None)
    types, path = message_types(1 if kind == "ros1" else 2), folder / ("a.bag" if kind == "ros1" else "recording")
    with rosbag1.Writer(path) if kind == "ros1" else rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/tf_static", name, typestore=types.store)
        for number, (parent, child, position, quaternion) in enumerate(all_frames):
            pairs = {"translation": zip("xyz", position, strict=True), "rotation": zip("xyzw", quaternion, strict=True)}
            fields = {"header": {"frame_id": parent}, "child_frame_id": child,
                      "transform": {key: dict(values) for key, values in pairs.items()}}  # fmt: skip
            one = types.make("geometry_msgs/msg/TransformStamped", **fields)
            writer.write(connection, number, types.encode(types.make(name, transforms=[one])))
    return path


def test_without_the_library_a_recording_names_the_command_that_installs_it(tmp_path, monkeypatch):
    path = tmp_path / "recording.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert refused(read_hand_eye, path).mend == "pip install 'sqrp[bags]'"


def test_frames_that_lead_back_to_themselves_are_refused(tmp_path):
    (tmp_path / "tf.yaml").write_text(CASES["ring"], encoding="utf-8")
    for camera, said in (("camera_link", "lead back"), ("camera_lnk", "did you mean `camera_link`")):
        assert said in refused(read_hand_eye, tmp_path / "tf.yaml", camera, LINKS).message


@pytest.mark.parametrize("frame", ["", "    frame: wrist\n"])
def test_a_workspace_takes_the_pose_from_a_recording_in_a_folder(cell, frame):
    bag(cell, "mcap", [IN_HAND, IN_CAMERA, OTHER])
    edit(cell, ORIGINAL, f"    hand_eye: {{file: recording, camera: camera_optical_frame}}\n{frame}")
    camera = load_workspace(cell).cameras["hand"]
    assert (camera.frame, camera.pose_file) == ("wrist", "/tf_static of a recording")
    np.testing.assert_allclose(camera.X_FC, X_HC, atol=1e-9)


@pytest.mark.parametrize("name", CASES["conditional"])
def test_a_transform_whose_condition_is_false_by_default_is_not_that_of_the_real_cell(name, tmp_path):
    path = written(tmp_path, "conditional", name)
    assert read_hand_eye(path, carriers=LINKS).X_PC[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    path.write_text(path.read_text().replace('default="false"', "").replace('default_value="false"', ""))
    said = refused(read_hand_eye, path, carriers=LINKS).message
    assert re.search("depends on .*sim.*, which is not known before a launch", said)


CAMERAS = Path(__file__).parents[1] / "cases" / "cameras"
ORIGINAL = "    frame: wrist\n    pose: {position: [0, 0.05, 0], quaternion: [0, 0, 0, 1]}\n"


def with_hand_eye(cell: Path, file: str, extra: str = "") -> Path:
    """The cell with its wrist camera where a calibration says."""
    edit(cell, ORIGINAL, f"    hand_eye: {CAMERAS / file}\n{extra}")
    return cell


EYE_IN_HAND = [[0, 0, 1, 0.03], [0, 1, 0, -0.05], [-1, 0, 0, 0.12], [0, 0, 0, 1]]
EYE_ON_BASE = [[1, 0, 0, 0.5], [0, -1, 0, 0], [0, 0, -1, 1.4], [0, 0, 0, 1]]


@pytest.mark.parametrize(("file", "extra", "frame", "X_FC"), [
        ("easy_handeye_in_hand.yaml", "", "wrist", EYE_IN_HAND),
        ("easy_handeye2_on_base.calib", "", "base", EYE_ON_BASE),  # looks down
        ("easy_handeye_in_hand.yaml", "    frame: lower\n", "lower", EYE_IN_HAND),
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


def with_pose_file(cell: Path, case: Mapping[str, Any]) -> Path:
    """The cell with its wrist camera where a file says, and what the workspace says of that."""
    (cell / "pose").write_text(case["text"], encoding="utf-8")
    stated = case["hand_eye"].replace("FILE", "pose")
    stated = stated if stated.startswith("urdf") else f"file: pose, {stated}".rstrip(", ")
    beside = "".join(f"    {key}\n" for key in case["beside"].split(", ") if key)
    edit(cell, ORIGINAL, f"    hand_eye: {{{stated}}}\n{beside}")
    return cell


@pytest.mark.parametrize("case", CASES["same"], ids=lambda case: case["case"])
def test_numbers_mean_what_their_format_or_the_workspace_says(cell, case):
    camera = load_workspace(with_pose_file(cell, case)).cameras["hand"]
    assert camera.frame == "wrist"
    np.testing.assert_allclose(camera.X_FC, CASES["matrix"], atol=1e-9)


@pytest.mark.parametrize("case", CASES["unsaid"], ids=lambda case: case["case"])
def test_numbers_that_nobody_explains_are_asked_for(cell, case):
    problem = refused(load_workspace, with_pose_file(cell, case))
    assert case["says"] in problem.message
    assert all(words in (problem.mend or "") for words in case["mend"])


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
