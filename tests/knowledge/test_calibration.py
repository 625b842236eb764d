"""Camera calibrations as different programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.calibration import Intrinsics, read_calibration
from sqrp_cli.knowledge.load import load_workspace

CAMERA_INFO_MANAGER = """\
image_width: 1280
image_height: 720
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [900.12345, 0, 640.5, 0, 901.5, 360.25, 0, 0, 1]
distortion_model: rational_polynomial
distortion_coefficients:
  rows: 1
  cols: 8
  data: [0.1, 0.2, 1e-3, -1E-3, 0, .5, 6., -7.25]
"""
OPENCV = """\
%YAML:1.0
---
calibration_time: "Fri 20 Nov 2026 08:00:00 PM UTC"
image_width: 640
image_height: 480
board_width: 9
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.1720000000000005e+02, 0., 3.2240000000000003e+02, 0.,
       6.1689999999999998e+02, 2.3810000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.2e-01, -2.4e-01, 4.0e-04, -1.1e-03, 0. ]
avg_reprojection_error: 2.3e-01
"""
FISHEYE = """\
image_width: 800
image_height: 600
camera_matrix: {rows: 3, cols: 3, data: [300, 0, 400, 0, 300, 300, 0, 0, 1]}
distortion_model: equidistant
distortion_coefficients: {rows: 4, cols: 1, data: [0.01, 0.002, -0.0003, 0.00004]}
projection_matrix: {rows: 3, cols: 4, data: [250, 0, 400, 0, 0, 250, 300, 0, 0, 0, 1, 0]}
"""


def read(text: str, folder: Path) -> Intrinsics:
    path = folder / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    return read_calibration(path)[0]


def test_a_file_of_camera_info_manager_is_read_to_the_last_digit(tmp_path: Path) -> None:
    camera = read(CAMERA_INFO_MANAGER, tmp_path)
    assert (camera.width, camera.height, camera.distortion_model) == (1280, 720, "rational_polynomial")
    assert camera.matrix.tolist() == [[900.12345, 0, 640.5], [0, 901.5, 360.25], [0, 0, 1]]
    assert camera.distortion.tolist() == [0.1, 0.2, 0.001, -0.001, 0, 0.5, 6, -7.25]


def test_a_file_of_opencv_is_read_and_its_model_follows_from_the_count(tmp_path: Path) -> None:
    camera = read(OPENCV, tmp_path)
    assert camera.distortion_model == "plumb_bob"
    assert camera.matrix[0, 0] == 617.2
    assert camera.distortion.tolist() == [0.12, -0.24, 0.0004, -0.0011, 0.0]


def test_the_projection_matrix_of_the_rectified_image_is_not_used(tmp_path: Path) -> None:
    camera = read(FISHEYE, tmp_path)
    assert camera.distortion_model == "equidistant"
    assert camera.matrix[0, 0] == 300


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant"])
@pytest.mark.parametrize("count", [0, 2, 4, 5, 8, 12, 14])
def test_only_the_right_number_of_coefficients_is_accepted(tmp_path: Path, model: str, count: int) -> None:
    text = FISHEYE.replace("equidistant", model).replace(
        "{rows: 4, cols: 1, data: [0.01, 0.002, -0.0003, 0.00004]}",
        f"{{rows: 1, cols: {count}, data: {[0.0] * count}}}",
    )
    if count == {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}[model]:
        assert len(read(text, tmp_path).distortion) == count
    else:
        with pytest.raises(InputError) as caught:
            read(text, tmp_path)
        place = caught.value.problems[0].place
        assert place is not None
        assert place.line == 5


def test_a_field_of_view_reaches_from_edge_to_edge(cell: Path) -> None:
    camera = load_workspace(cell).cameras["top"]
    left = np.linalg.inv(camera.matrix) @ [-0.5, 0.0, 1.0]
    right = np.linalg.inv(camera.matrix) @ [camera.width - 0.5, 0.0, 1.0]
    assert np.degrees(np.arctan(right[0]) - np.arctan(left[0])) == pytest.approx(60.0)
    assert left[0] == pytest.approx(-right[0])


def test_a_pose_may_be_stated_as_quaternion_rpy_or_point_to_look_at(cell: Path) -> None:
    """All three describe a camera above the scene that looks straight down, its image's top towards +x."""
    down = {
        "look_at: [0.5, 0, 0], up: [1, 0, 0]",
        "rpy: [180 deg, 0, -90 deg]",
        "quaternion: [0.70710678, -0.70710678, 0, 0]",
    }
    expected = [[0, -1, 0], [-1, 0, 0], [0, 0, -1]]
    original = (cell / "workspace.yaml").read_text(encoding="utf-8")
    for orientation in down:
        (cell / "workspace.yaml").write_text(original.replace("look_at: [0.5, 0, 0]", orientation), encoding="utf-8")
        X_WC = load_workspace(cell).cameras["top"].X_FC
        assert np.allclose(X_WC[:3, :3], expected, atol=1e-7), orientation
        assert X_WC[:3, 3].tolist() == [0.5, 0.0, 1.5]


def test_body_axes_are_forward_left_up(cell: Path) -> None:
    """The side camera's body is turned by -90 deg about z: forward is -y, left is +x, up is +z of the world."""
    R_WC = load_workspace(cell).cameras["side"].X_FC[:3, :3]
    right, down, forward = R_WC.T
    assert np.allclose(forward, [0, -1, 0])
    assert np.allclose(right, [-1, 0, 0])
    assert np.allclose(down, [0, 0, -1])
