"""One camera in every format that people have gives the same intrinsics, and damage gives one good message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

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
RADTAN = (*PLUMB_BOB[:4], 0.0)
RATIONAL = (0.45, -2.51, 6.1e-4, -2.2e-4, 1.44, 0.33, -2.33, 1.37)
FISHEYE = (-0.0076, 0.0441, -0.0417, 0.0081)
Writer = Callable[[Path], CalibrationFile]


def storage(ending: str, wanted: Mapping[str, Any] = {}, **entries: Any) -> Writer:
    """OpenCV's own writer."""

    def write(folder: Path) -> CalibrationFile:
        path = folder / f"camera.{ending}"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, value in entries.items():
            if isinstance(value, dict):
                storage.startWriteStruct(name, cv2.FILE_NODE_MAP)
                for key, number in value.items():
                    storage.write(key, number)
                storage.endWriteStruct()
            else:
                storage.write(name, value)
        storage.release()
        return CalibrationFile(file=str(path), **wanted)

    return write


SIZED = {"image_width": SIZE[0], "image_height": SIZE[1]}


def file_storage(ending: str, *, size: bool = True, D: tuple[float, ...] = PLUMB_BOB, **other: str) -> Writer:
    """Matrices, as programs write them."""
    matrices = {"camera_matrix": K, "distortion_coefficients": np.array([D])}
    if not size:
        return storage(ending, {"width": 1280, "height": 720}, **matrices, **other)
    return storage(ending, calibration_time="Mon Nov 23 20:00:00 2026", **SIZED, **matrices, **other)


SAMPLE_OF_OPENCV = storage(
    "yml", image_Width=SIZE[0], image_Height=SIZE[1], Camera_Matrix=K, Distortion_Coefficients=np.array([PLUMB_BOB]).T
)
"""With the names of the calibration program that comes with OpenCV."""


def arrays(folder: Path) -> CalibrationFile:
    """As Python programs keep what OpenCV's calibration returns."""
    np.savez(folder / "camera.npz", ret=0.3, mtx=K, dist=np.array([PLUMB_BOB]), rvecs=np.zeros((4, 3, 1)))
    return CalibrationFile(file=str(folder / "camera.npz"), width=1280, height=720)


def vins(model: str, projection: Mapping[str, float], distortion: Mapping[str, float]) -> Writer:
    """As camodocal writes it, with OpenCV's writer."""
    parameters = {"distortion_parameters": distortion, "projection_parameters": projection}
    given = {name: dict(values) for name, values in parameters.items() if values}
    return storage("yaml", model_type=model, camera_name="camera", **SIZED, **given)


def typed(text: str, ending: str = "txt", **wanted: Any) -> Writer:
    """A text as it is."""

    def write(folder: Path) -> CalibrationFile:
        path = folder / f"camera.{ending}"
        path.write_text(text, encoding="utf-8")
        return CalibrationFile(file=str(path), **wanted)

    return write


def dumped(data: Any, **wanted: Any) -> Writer:
    """As Python programs write YAML."""
    return typed(yaml.safe_dump(data), "yaml", **wanted)


def kalibr(model: str, coefficients: tuple[float, ...]) -> dict[str, Any]:
    return {
        "T_cn_cnm1": np.eye(4).tolist(), "cam_overlaps": [1], "camera_model": "pinhole",
        "distortion_coeffs": list(coefficients), "distortion_model": model, "intrinsics": list(PINHOLE),
        "resolution": list(SIZE), "rostopic": "/cam0/image_raw",
    }  # fmt: skip


def camera_info(model: str, D: tuple[float, ...], k: str = "k", d: str = "d") -> dict[str, Any]:
    found = {"width": SIZE[0], "height": SIZE[1], "distortion_model": model, k: K.ravel().tolist(), d: list(D)}
    return {"header": {"frame_id": "camera"}, **found, "p": [0.0] * 12}


def ost(name: str = "narrow_stereo", D: tuple[float, ...] = PLUMB_BOB) -> str:
    def rows(matrix: Any) -> str:
        return "\n".join(" ".join(f"{number:.6f}" for number in row) for row in matrix)

    sections = [("camera matrix", K), ("distortion", [D]), ("rectification", np.eye(3)), ("projection", np.eye(3, 4))]
    values = "\n\n".join(f"{title}\n{rows(matrix)}" for title, matrix in sections)
    return f"# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n1280\n\nheight\n720\n\n[{name}]\n\n{values}\n\n"


def words(numbers: tuple[float, ...]) -> str:
    return " ".join(map(str, numbers))


FISHEYE_NAMES = ("k2", "k3", "k4", "k5", "mu", "mv", "u0", "v0")
NAMED = dict(zip(("fx", "fy", "cx", "cy"), PINHOLE, strict=True))
COLMAP = f"{PINHOLE[0]} {PINHOLE[1]} {PINHOLE[2] + 0.5} {PINHOLE[3] + 0.5}"
KALIBR = {"cam0": kalibr("equidistant", FISHEYE), "cam1": kalibr("radtan", RADTAN[:4])}

INFO = "ROS camera_info (YAML)"
FISHEYE_LENS, RATIONAL_LENS = ("equidistant", FISHEYE), ("rational_polynomial", RATIONAL)
PLUMB_BOB_LENS, RADTAN_LENS, NO_LENS = ("plumb_bob", PLUMB_BOB), ("plumb_bob", RADTAN), ("none", ())
FILES: Mapping[str, tuple[Writer, str, tuple[float, ...], str]] = {
    "OpenCV YAML": (file_storage("yaml"), *PLUMB_BOB_LENS, "OpenCV FileStorage (YAML)"),
    "OpenCV XML": (file_storage("xml"), *PLUMB_BOB_LENS, "OpenCV FileStorage (XML)"),
    "OpenCV JSON": (file_storage("json"), *PLUMB_BOB_LENS, "OpenCV FileStorage (JSON)"),
    "OpenCV's sample": (SAMPLE_OF_OPENCV, *PLUMB_BOB_LENS, "OpenCV FileStorage (YAML)"),
    "OpenCV without size": (file_storage("yaml", size=False), *PLUMB_BOB_LENS, "OpenCV FileStorage (YAML)"),
    "OpenCV, two cameras": (storage("yml", {"camera": "2", "width": 1280, "height": 720}, M1=np.eye(3), M2=K,
        D1=np.zeros((1, 14)), D2=np.array([(*RATIONAL, *[0.0] * 6)])), *RATIONAL_LENS, "OpenCV FileStorage (YAML): 2"),
    "NumPy": (arrays, *PLUMB_BOB_LENS, "keys and values (NumPy)"),
    "OpenCV XML, 8": (file_storage("xml", D=RATIONAL), *RATIONAL_LENS, "OpenCV FileStorage (XML)"),
    "OpenCV, 14 with zeros": (file_storage("json", D=(*RATIONAL, *[0.0] * 6)), *RATIONAL_LENS,
        "OpenCV FileStorage (JSON)"),
    "a model with 14, zeros": (dumped(camera_info("rational_polynomial", (*RATIONAL, *[0.0] * 6))),
        *RATIONAL_LENS, INFO),
    "no coefficients": (dumped(camera_info("", ())), *NO_LENS, INFO),
    "OpenCV fisheye": (file_storage("yml", D=FISHEYE, distortion_model="fisheye"), *FISHEYE_LENS,
        "OpenCV FileStorage (YAML)"),
    "VINS pinhole": (vins("PINHOLE", NAMED, dict(zip(("k1", "k2", "p1", "p2"), RADTAN, strict=False))),
        *RADTAN_LENS, "VINS"),
    "VINS fisheye": (vins("KANNALA_BRANDT", dict(zip(FISHEYE_NAMES, FISHEYE + PINHOLE, strict=True)), {}),
        *FISHEYE_LENS, "VINS"),
    "Kalibr": (dumped(KALIBR, camera="cam0"), *FISHEYE_LENS, "Kalibr camchain: cam0"),
    "Kalibr, the other": (dumped(KALIBR, camera="cam1"), *RADTAN_LENS, "Kalibr camchain: cam1"),
    "Kalibr, one": (dumped({"cam0": kalibr(*NO_LENS)}), *NO_LENS, "Kalibr camchain: cam0"),
    "message": (dumped(camera_info(*PLUMB_BOB_LENS)), *PLUMB_BOB_LENS, INFO),
    "message of ROS 1": (dumped(camera_info(*RATIONAL_LENS, "K", "D")), *RATIONAL_LENS, INFO),
    "fisheye": (dumped(camera_info("fisheye", FISHEYE)), *FISHEYE_LENS, INFO),
    "COLMAP's name": (dumped(camera_info("OPENCV_FISHEYE", FISHEYE)), *FISHEYE_LENS, INFO),
    "several": (dumped({"left": camera_info(*RADTAN_LENS), "right": camera_info("fisheye", FISHEYE)},
        camera="right"), *FISHEYE_LENS, "ROS camera_info (YAML): right"),
    "several in a list": (dumped({"cameras": [{**camera_info("fisheye", FISHEYE),
        "camera_name": name} for name in "ab"]}, camera="b"), *FISHEYE_LENS, "ROS camera_info (YAML): b"),
    "nothing distorts": (dumped(camera_info(*NO_LENS)), *NO_LENS, INFO),
    "ost.txt": (typed(ost()), *PLUMB_BOB_LENS, "ROS camera_info (INI): narrow_stereo"),
    "ost.txt of two": (typed(ost("narrow_stereo/left", RADTAN) + ost("narrow_stereo/right"),
        camera="narrow_stereo/right"), *PLUMB_BOB_LENS, "ROS camera_info (INI): narrow_stereo/right"),
    "COLMAP": (typed(f"# Cameras\n1 PINHOLE 640 480 5 5 3 2\n7 OPENCV 1280 720 {COLMAP} {words(RADTAN[:4])}\n",
        camera="7"), *RADTAN_LENS, "COLMAP cameras.txt: 7"),
    "COLMAP in lower case": (typed(f"1 pinhole 1280 720 {COLMAP}\n"), *NO_LENS, "COLMAP cameras.txt: 1"),
    "COLMAP fisheye": (typed(f"1 OPENCV_FISHEYE 1280 720 {COLMAP} {words(FISHEYE)}\n"), *FISHEYE_LENS,
        "COLMAP cameras.txt: 1"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_camera(tmp_path, name):
    writer, model, coefficients, lens_file = FILES[name]
    wanted = writer(tmp_path)
    found = read_calibration(Path(wanted.file), wanted)[0]
    assert (found.width, found.height) == SIZE
    assert (found.distortion_model, found.lens_file) == (model, lens_file)
    np.testing.assert_allclose(found.matrix, K, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.distortion, coefficients, rtol=0, atol=1e-9)


@pytest.mark.parametrize("case", CASES["same"], ids=lambda case: case["case"])
def test_formats_typed_from_their_documentation_give_the_same_camera(tmp_path, case):
    wanted = typed(case["text"], **case.get("wanted", {}))(tmp_path)
    found = read_calibration(Path(wanted.file), wanted, told=case.get("distortion"))[0]
    assert (found.width, found.height) == SIZE
    assert (found.distortion_model, found.lens_file) == (case["model"], case["title"])
    np.testing.assert_allclose(found.matrix, K, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.distortion, case["D"], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("model", "parameters", "distortion"), [
        ("SIMPLE_PINHOLE", "900 640 360", ("none", ())),
        ("SIMPLE_RADIAL", "900 640 360 0.1", ("plumb_bob", (0.1, 0, 0, 0, 0))),
        ("RADIAL", "900 640 360 0.1 -0.2", ("plumb_bob", (0.1, -0.2, 0, 0, 0))),
        ("RADIAL_FISHEYE", "900 640 360 0.1 -0.2", ("equidistant", (0.1, -0.2, 0, 0))),
        ("FULL_OPENCV", "900 900 640 360 1 2 3 4 5 6 7 8", ("rational_polynomial", (1, 2, 3, 4, 5, 6, 7, 8))),
])  # fmt: skip
def test_colmap_counts_pixels_from_the_corner_of_the_first(tmp_path, model, parameters, distortion):
    wanted = typed(f"1 {model} 1280 720 {parameters}\n")(tmp_path)
    found = read_calibration(Path(wanted.file), wanted)[0]
    np.testing.assert_allclose(found.matrix, [[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]])
    assert (found.distortion_model, tuple(found.distortion)) == distortion


@pytest.mark.parametrize(("number", "seen_by_colmap"), [*enumerate(CASES["colmap"]["seen"], 1)])
def test_cameras_of_colmap_see_points_where_colmap_sees_them(tmp_path, number, seen_by_colmap):
    wanted = typed(CASES["colmap"]["text"], camera=str(number))(tmp_path)
    lens = read_calibration(Path(wanted.file), wanted)[0]
    camera = Camera(**vars(lens), name="c", frame="world", X_FC=np.eye(4), rate=10.0)
    seen = Projection(camera).pixels(np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 1.0]]))[0]
    np.testing.assert_allclose(seen, np.array(seen_by_colmap) - 0.5, rtol=0, atol=2e-9)


@pytest.mark.parametrize("case", CASES["damaged"], ids=lambda case: case["case"])
def test_damage_gives_one_message(tmp_path, case):
    text = CASES["texts"].get(case["text"], case["text"])
    for old, new in case.get("replace", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "camera.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_calibration(
            path, CalibrationFile(**{"file": "camera.txt", **case.get("wanted", {})}), "cameras.c.calibration"
        )
    (problem,) = caught.value.problems
    assert problem.code == case["code"]
    for words in case["says"]:
        assert words in problem.message
    assert case.get("mend", "") in (problem.mend or "")
    assert (problem.place.file, problem.place.line) == (path, case.get("line"))


def test_a_workspace_says_which_camera_and_how_large_the_image_is(cell):
    (cell / "side.yaml").write_text(yaml.safe_dump(KALIBR), encoding="utf-8")
    workspace = cell / "workspace.yaml"
    text = workspace.read_text(encoding="utf-8")
    workspace.write_text(text.replace("side.yaml", "{file: side.yaml, camera: cam0}"), encoding="utf-8")
    assert load_workspace(cell).cameras["side"].lens_file == "Kalibr camchain: cam0"
    workspace.write_text(text.replace("side.yaml", "{file: side.yaml, width: 640}"), encoding="utf-8")
    with pytest.raises(InputError, match="`width` and `height` go together"):
        load_workspace(cell)
    workspace.write_text(text.replace("side.yaml", "{file: sid.yaml, camera: cam0}"), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_workspace(cell)
    assert "did you mean" in str(caught.value)


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
    path = folder / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    return read_calibration(path)[0]


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
