"""Camera calibrations as different programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.camera.calibration import Intrinsics, read_calibration
from sqrp_cli.cell.load import load_workspace
from tests.cells import edit, read_cases, refused

CAMERAS = Path(__file__).parents[1] / "cases" / "cameras"
FISHEYE = """\
image_width: 800
image_height: 600
camera_matrix: {rows: 3, cols: 3, data: [300, 0, 400, 0, 300, 300, 0, 0, 1]}
distortion_model: equidistant
distortion_coefficients: {rows: 4, cols: 1, data: [0.01, 0.002, -0.0003, 0.00004]}
projection_matrix: {rows: 3, cols: 4, data: [250, 0, 400, 0, 0, 250, 300, 0, 0, 0, 1, 0]}
"""


FILES = read_cases("calibrations.yaml")["files"]


def read(text: str, folder: Path) -> Intrinsics:
    path = folder / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    return read_calibration(path)[0]


@pytest.mark.parametrize("name", FILES)
def test_files_are_read_as_their_programs_write_them(name):
    camera, (size, (fx, fy, cx, cy), model, coefficients) = read_calibration(CAMERAS / name)[0], FILES[name]
    assert [camera.width, camera.height] == size
    np.testing.assert_allclose(camera.matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rtol=1e-12)
    assert camera.distortion_model == model
    np.testing.assert_allclose(camera.distortion, coefficients, rtol=1e-12)


def test_every_file_is_tried():
    intrinsic = {path.name for path in CAMERAS.iterdir() if not path.name.startswith("easy_")}
    assert intrinsic == set(FILES)


def test_the_projection_matrix_of_the_rectified_image_is_not_used(tmp_path):
    assert read(FISHEYE, tmp_path).matrix[0, 0] == 300


@pytest.mark.parametrize(("model", "right"), [("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4)])
@pytest.mark.parametrize("count", [0, 2, 4, 5, 8, 12, 14])
def test_only_the_right_number_of_coefficients_is_accepted(tmp_path, model, right, count):
    stated = f"{{rows: 1, cols: {count}, data: {[0.01] * count}}}"
    text = FISHEYE.replace("equidistant", model).replace(
        FISHEYE[FISHEYE.index("{rows: 4") : FISHEYE.index("\nproj")], stated
    )
    if count == right:
        assert len(read(text, tmp_path).distortion) == count
    else:
        assert refused(read, text, tmp_path).place.line == 5


def test_a_field_of_view_reaches_from_edge_to_edge(cell):
    camera = load_workspace(cell).cameras["top"]
    left = np.linalg.inv(camera.matrix) @ [-0.5, 0.0, 1.0]
    right = np.linalg.inv(camera.matrix) @ [camera.width - 0.5, 0.0, 1.0]
    assert np.degrees(np.arctan(right[0]) - np.arctan(left[0])) == pytest.approx(60.0)
    assert left[0] == pytest.approx(-right[0])


@pytest.mark.parametrize("orientation", ["look_at: [0.5, 0, 0], up: [1, 0, 0]", "rpy: [180 deg, 0, -90 deg]",
                                         "quaternion: [0.70710678, -0.70710678, 0, 0]"])  # fmt: skip
def test_a_pose_may_be_stated_as_quaternion_rpy_or_point_to_look_at(cell, orientation):
    """All three describe a camera above the scene that looks straight down, its image's top towards +x."""
    edit(cell, "look_at: [0.5, 0, 0]", orientation)
    X_WC = load_workspace(cell).cameras["top"].X_FC
    assert np.allclose(X_WC[:3, :3], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-7)
    assert X_WC[:3, 3].tolist() == [0.5, 0.0, 1.5]


def test_body_axes_are_forward_left_up(cell):
    """The side camera's body is turned by -90 deg about z: forward is -y, left is +x, up is +z of the world."""
    R_WC = load_workspace(cell).cameras["side"].X_FC[:3, :3]
    right, down, forward = R_WC.T
    assert np.allclose(forward, [0, -1, 0])
    assert np.allclose(right, [-1, 0, 0])
    assert np.allclose(down, [0, 0, -1])


INFO = """width: 1280
height: 720
distortion_model: plumb_bob
d: [0.0, 0.0, 0.0, 0.0, 0.0]
k: [910.0, 0.0, 640.0, 0.0, 910.0, 360.0, 0.0, 0.0, 1.0]
binning_x: {x}
binning_y: {y}
roi: {{x_offset: {left}, y_offset: {top}, width: {width}, height: {height}, do_rectify: false}}
"""


@pytest.mark.parametrize(("x", "y", "left", "top", "width", "height", "size", "pinhole"), [
        (0, 0, 0, 0, 0, 0, (1280, 720), (910, 910, 640, 360)),
        (0, 0, 320, 180, 640, 360, (640, 360), (910, 910, 320, 180)),  # 39 deg wide
        (2, 2, 0, 0, 0, 0, (640, 360), (455, 455, 320, 180)),
        (2, 4, 320, 180, 640, 360, (320, 90), (455, 227.5, 160, 45)),
])  # fmt: skip
def test_images_are_cut_and_binned_as_image_geometry_has_it(tmp_path, x, y, left, top, width, height, size, pinhole):
    camera = read(INFO.format(x=x, y=y, left=left, top=top, width=width, height=height), tmp_path)
    assert (camera.width, camera.height) == size
    assert tuple(camera.matrix[(0, 1, 0, 1), (0, 1, 2, 2)]) == pinhole
