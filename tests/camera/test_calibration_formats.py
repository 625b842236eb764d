"""One camera in every format that people have gives the same intrinsics, and damage gives one good message."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sqrp_cli.camera.calibration import Intrinsics, read_calibration
from sqrp_cli.camera.camera import CalibrationFile, Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from tests.cells import edit, read_cases, refused

CASES = read_cases("calibrations.yaml")
SIZE = (1280, 720)
PINHOLE = (912.348712, 911.902174, 641.205533, 358.771204)
K = np.array([[PINHOLE[0], 0, PINHOLE[2]], [0, PINHOLE[1], PINHOLE[3]], [0, 0, 1]])
PLUMB_BOB = (0.112043, -0.231871, 0.000412, -0.001097, 0.051)
RATIONAL = (0.45, -2.51, 6.1e-4, -2.2e-4, 1.44, 0.33, -2.33, 1.37)
FISHEYE = (-0.0076, 0.0441, -0.0417, 0.0081)
SIZED = {"width": SIZE[0], "height": SIZE[1]}


def stored(D: tuple[float, ...] = PLUMB_BOB, **other: Any) -> dict[str, Any]:
    """What programs store with OpenCV."""
    date, size = "Mon Nov 23 20:00:00 2026", {"image_width": SIZE[0], "image_height": SIZE[1]}
    return {"calibration_time": date, **size, "camera_matrix": K, "distortion_coefficients": np.array([D]), **other}


SAMPLE = {"image_Width": SIZE[0], "image_Height": SIZE[1], "Camera_Matrix": K,
          "Distortion_Coefficients": np.array([PLUMB_BOB]).T}  # fmt: skip
"""With the names of the calibration program that comes with OpenCV."""
PLUMB_BOB_LENS, RATIONAL_LENS = ("plumb_bob", PLUMB_BOB), ("rational_polynomial", RATIONAL)
STORED: Mapping[str, tuple[str, Mapping[str, Any], Mapping[str, Any], str, tuple[float, ...]]] = {
    "YAML": ("yaml", stored(), {}, *PLUMB_BOB_LENS),
    "XML": ("xml", stored(), {}, *PLUMB_BOB_LENS),
    "JSON": ("json", stored(), {}, *PLUMB_BOB_LENS),
    "sample": ("yml", SAMPLE, {}, *PLUMB_BOB_LENS),
    "without size": ("yaml", dict([*stored().items()][3:]), SIZED, *PLUMB_BOB_LENS),
    "two cameras": ("yml", {"M1": np.eye(3), "M2": K, "D1": np.zeros((1, 14)),
        "D2": np.array([(*RATIONAL, *[0.0] * 6)])}, {"camera": "2", **SIZED}, *RATIONAL_LENS),
    "XML, 8": ("xml", stored(RATIONAL), {}, *RATIONAL_LENS),
    "14 with zeros": ("json", stored((*RATIONAL, *[0.0] * 6)), {}, *RATIONAL_LENS),
    "fisheye": ("yml", stored(FISHEYE, distortion_model="fisheye"), {}, "equidistant", FISHEYE),
}  # fmt: skip
"""Ending and entries of a file, what the workspace says of it, and the distortion."""


def assert_the_camera(path: Path, wanted: Mapping[str, Any], told: Any, model: str, D: Any, lens_file: str) -> None:
    found = read_calibration(path, CalibrationFile(**{"file": path.name, **wanted}), told=told)[0]
    assert (found.width, found.height) == SIZE
    assert (found.distortion_model, found.lens_file) == (model, lens_file)
    np.testing.assert_allclose(found.matrix, K, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.distortion, D, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", STORED)
def test_what_opencv_itself_writes_gives_the_camera(tmp_path, name):
    ending, entries, wanted, model, D = STORED[name]
    storage = cv2.FileStorage(str(tmp_path / f"camera.{ending}"), cv2.FILE_STORAGE_WRITE)
    for key, value in entries.items():
        storage.write(key, value)
    storage.release()
    title = f"OpenCV FileStorage ({ending.upper().replace('YML', 'YAML')}){': 2' if 'camera' in wanted else ''}"
    assert_the_camera(tmp_path / f"camera.{ending}", wanted, None, model, D, title)


def test_what_python_programs_keep_of_opencv_gives_the_camera(tmp_path):
    np.savez(tmp_path / "camera.npz", ret=0.3, mtx=K, dist=np.array([PLUMB_BOB]), rvecs=np.zeros((4, 3, 1)))
    assert_the_camera(tmp_path / "camera.npz", SIZED, None, *PLUMB_BOB_LENS, "keys and values (NumPy)")


def typed(folder: Path, text: str) -> Path:
    (folder / "camera.txt").write_text(text, encoding="utf-8")
    return folder / "camera.txt"


@pytest.mark.parametrize("case", CASES["same"], ids=lambda case: case["case"])
def test_every_format_gives_the_same_camera(tmp_path, case):
    stated = case.get("wanted", {}), case.get("distortion"), case["model"], case["D"], case["title"]
    assert_the_camera(typed(tmp_path, case["text"]), *stated)


def test_colmap_counts_pixels_from_the_corner_of_the_first(tmp_path):
    found = read_calibration(typed(tmp_path, "1 RADIAL_FISHEYE 1280 720 900 640 360 0.1 -0.2\n"))[0]
    np.testing.assert_allclose(found.matrix, [[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]])
    assert (found.distortion_model, tuple(found.distortion)) == ("equidistant", (0.1, -0.2, 0, 0))


@pytest.mark.parametrize(("number", "seen_by_colmap"), [*enumerate(CASES["colmap"]["seen"], 1)])
def test_cameras_of_colmap_see_points_where_colmap_sees_them(tmp_path, number, seen_by_colmap):
    path = typed(tmp_path, CASES["colmap"]["text"])
    lens = read_calibration(path, CalibrationFile(file="camera.txt", camera=str(number)))[0]
    camera = Camera(**vars(lens), name="c", frame="world", X_FC=np.eye(4), rate=10.0)
    seen = Projection(camera).pixels(np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 1.0]]))[0]
    np.testing.assert_allclose(seen, np.array(seen_by_colmap) - 0.5, rtol=0, atol=2e-9)


@pytest.mark.parametrize("case", CASES["damaged"], ids=lambda case: case["case"])
def test_damage_gives_one_message(tmp_path, case):
    text = CASES["texts"].get(case["text"], case["text"])
    for old, new in case.get("replace", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    path, wanted = typed(tmp_path, text), CalibrationFile(**{"file": "camera.txt", **case.get("wanted", {})})
    problem = refused(read_calibration, path, wanted, "cameras.c.calibration")
    assert problem.code == case["code"]
    for words in case["says"]:
        assert words in problem.message
    assert case.get("mend", "") in (problem.mend or "")
    assert (problem.place.file, problem.place.line) == (path, case.get("line"))


def test_a_workspace_says_which_camera_and_how_large_the_image_is(cell):
    kalibr = next(case["text"] for case in CASES["same"] if case["case"] == "Kalibr")
    (cell / "side.yaml").write_text(kalibr, encoding="utf-8")
    workspace = cell / "workspace.yaml"
    text = workspace.read_text(encoding="utf-8")
    workspace.write_text(text.replace("side.yaml", "{file: side.yaml, camera: cam0}"), encoding="utf-8")
    assert load_workspace(cell).cameras["side"].lens_file == "Kalibr camchain: cam0"
    workspace.write_text(text.replace("side.yaml", "{file: side.yaml, width: 640}"), encoding="utf-8")
    with pytest.raises(InputError, match="`width` and `height` go together"):
        load_workspace(cell)
    workspace.write_text(text.replace("side.yaml", "{file: sid.yaml, camera: cam0}"), encoding="utf-8")
    with pytest.raises(InputError, match="did you mean"):
        load_workspace(cell)


CAMERAS = Path(__file__).parents[1] / "cases" / "cameras"
FISHEYE_FILE = """\
image_width: 800
image_height: 600
camera_matrix: {rows: 3, cols: 3, data: [300, 0, 400, 0, 300, 300, 0, 0, 1]}
distortion_model: equidistant
distortion_coefficients: {rows: 4, cols: 1, data: [0.01, 0.002, -0.0003, 0.00004]}
projection_matrix: {rows: 3, cols: 4, data: [250, 0, 400, 0, 0, 250, 300, 0, 0, 0, 1, 0]}
"""


SAMPLES = CASES["files"]


def read(text: str, folder: Path) -> Intrinsics:
    return read_calibration(typed(folder, text))[0]


@pytest.mark.parametrize("name", SAMPLES)
def test_files_are_read_as_their_programs_write_them(name):
    camera, (size, (fx, fy, cx, cy), model, coefficients) = read_calibration(CAMERAS / name)[0], SAMPLES[name]
    assert [camera.width, camera.height] == size
    np.testing.assert_allclose(camera.matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rtol=1e-12)
    assert camera.distortion_model == model
    np.testing.assert_allclose(camera.distortion, coefficients, rtol=1e-12)


def test_every_file_is_tried():
    intrinsic = {path.name for path in CAMERAS.iterdir() if not path.name.startswith("easy_")}
    assert intrinsic == set(SAMPLES)


def test_the_projection_matrix_of_the_rectified_image_is_not_used(tmp_path):
    assert read(FISHEYE_FILE, tmp_path).matrix[0, 0] == 300


@pytest.mark.parametrize(("model", "right"), [("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4)])
@pytest.mark.parametrize("count", [0, 2, 4, 5, 8, 12, 14])
def test_only_the_right_number_of_coefficients_is_accepted(tmp_path, model, right, count):
    stated = f"{{rows: 1, cols: {count}, data: {[0.01] * count}}}"
    text = FISHEYE_FILE.replace("equidistant", model).replace(
        FISHEYE_FILE[FISHEYE_FILE.index("{rows: 4") : FISHEYE_FILE.index("\nproj")], stated
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


CUT_INFO = """width: 1280
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
    camera = read(CUT_INFO.format(x=x, y=y, left=left, top=top, width=width, height=height), tmp_path)
    assert (camera.width, camera.height) == size
    assert tuple(camera.matrix[(0, 1, 0, 1), (0, 1, 2, 2)]) == pinhole
