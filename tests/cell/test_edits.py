"""A workspace file with one camera, object or task changed: it says the new value, and nothing else differs."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.edits import stated_look_at, with_camera, with_further_camera, with_pose, with_task
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import patch
from sqrp_cli.geometry import displacement, look_at, read_only
from tests.cells import edit

POSES = {
    "look_at": "{position: [-0.099, 71.1 cm, 1.162], look_at: [-0.31, -0.027, 0.245]}",
    "up": "{position: [0.1, 0.7, 1.1], look_at: [-0.31, -0.027, 0.245], up: [1, 0, 0]}",
    "rpy": "{position: [0.1, 0.7, 1.1], rpy: [-150 deg, 0, 0.1]}",
    "quaternion": "{position: [0.1, 0.7, 1.1], quaternion: [0.6, 0.8, 0, 0]}",
    "no orientation": "{position: [0.1, 0.7, 1.1]}",
    "no position": "{look_at: [-0.31, -0.027, 0.245]}",
    "block": "\n      # where\n      position: [0.1, 0.7, 1.1]\n      rpy: [-2.6, 0, 0.1]  # as measured",
    "block without": "\n      position: [0.1, 0.7, 1.1]\n    # the lens",
}


@pytest.fixture
def file(tabletop: Workspace, tmp_path: Path) -> Path:
    """A copy of the tabletop's file, with paths that lead to the same files."""
    path = tmp_path / "workspace.yaml"
    text = tabletop.path.read_text(encoding="utf-8").replace("../", f"{tabletop.path.parents[1]}/")
    path.write_text(text.replace(f"{tabletop.path.parents[1]}/{tabletop.path.parents[1]}/", "../"), encoding="utf-8")
    shutil.copytree(tabletop.path.parents[2] / "skills", tmp_path.parent / "skills", dirs_exist_ok=True)
    return path


def opened(file: Path, *edits: str) -> tuple[Workspace, SourceDocument]:
    """The workspace and its file, with pairs of texts replaced."""
    edit(file, *edits)
    return load_workspace(file), read_workspace_document(file)


def changes(document: SourceDocument, content: bytes) -> list[str]:
    lines = patch(document, content, "file").splitlines()[2:]
    return [line for line in lines if line[0] in "+-"]


@pytest.mark.parametrize("notation", POSES)
@pytest.mark.parametrize("convention", ["", "\n    convention: body"])
def test_a_camera_elsewhere_is_where_it_should_be(file, notation, convention):
    if convention and "look_at" in POSES[notation]:
        convention = ""
    stated = "{position: [-0.099, 0.711, 1.162], look_at: [-0.31, -0.027, 0.245]}"
    workspace, document = opened(file, f"    pose: {stated}", f"    pose: {POSES[notation]}{convention}")
    camera = workspace.cameras["cam1"]
    aim = stated_look_at(workspace, "cam1")
    if aim is not None:
        point, up = np.array([-0.2, 0.1, 0.25]), aim[1]
        X_FC = look_at(camera.X_FC[:3, 3] + (0.01, -0.02, 0.003), point, up)
    else:
        point = np.zeros(3)
        X_FC = camera.X_FC @ displacement(np.array([0.01, -0.02, 0.003]), np.array([0.1, 0.2, -0.1]))
    X_FC[:3, 3] = np.round(X_FC[:3, 3], 6)
    content = with_camera(document, camera, replace(camera, X_FC=read_only(X_FC)), point)
    again = load_workspace(file, content)
    np.testing.assert_allclose(again.cameras["cam1"].X_FC, X_FC, atol=1e-8)
    others = {path: value for path, value in again.values.items() if not path.startswith("cameras.cam1.pose")}
    assert others == {path: v for path, v in workspace.values.items() if not path.startswith("cameras.cam1.pose")}
    assert again.values["cameras.cam1.image.width"] == 640


def test_only_numbers_that_differ_are_written_in_the_unit_of_the_old_ones(file):
    workspace, document = opened(file, "[-0.099, 0.711, 1.162]", "[-0.099, 71.1 cm, 1162 mm]")
    camera, aim = workspace.cameras["cam1"], stated_look_at(workspace, "cam1")
    moved = replace(camera, X_FC=look_at((-0.099, 0.733, 1.1), *aim))
    assert changes(document, with_camera(document, camera, moved, aim[0])) == [
        "-    pose: {position: [-0.099, 71.1 cm, 1162 mm], look_at: [-0.31, -0.027, 0.245]}",
        "+    pose: {position: [-0.099, 73.3 cm, 1100 mm], look_at: [-0.31, -0.027, 0.245]}",
    ]


@pytest.mark.parametrize("lens", ["horizontal_fov: 18 deg", "horizontal_fov: 0.3142", "fx: 2000", "fx: 2000, fy: 1990"])
def test_another_lens_is_written_in_its_own_notation(file, lens):
    workspace, document = opened(file, "horizontal_fov: 18 deg", lens)
    camera = workspace.cameras["cam1"]
    K = camera.matrix.copy()
    K[:2, :2] *= 0.8
    content = with_camera(document, camera, replace(camera, matrix=read_only(K)), np.array([-0.31, -0.027, 0.245]))
    np.testing.assert_allclose(load_workspace(file, content).cameras["cam1"].matrix, K, rtol=1e-8)
    assert len(changes(document, content)) == 2


def test_a_lens_in_a_calibration_file_is_refused(file):
    calibration = file.parent / "cam.yaml"
    calibration.write_text(
        "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, data: [2000, 0, 320, 0, 2000, 240, 0,"
        " 0, 1]}\ndistortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    )
    image = "image: {width: 640, height: 480, horizontal_fov: 18 deg}"
    workspace, document = opened(file, image, "calibration: cam.yaml")
    camera, aim = workspace.cameras["cam1"], stated_look_at(workspace, "cam1")
    with pytest.raises(InputError, match=r"another file, which would have to say camera_matrix fx 1600, fy 1600$"):
        with_camera(document, camera, replace(camera, matrix=read_only(0.8 * camera.matrix)), aim[0])
    assert with_camera(document, camera, camera, aim[0]) == document.content


@pytest.mark.parametrize("style", ["block", "flow"])
def test_a_further_camera_comes_last_and_has_the_lens_of_another(file, style):
    if style == "flow":
        text = file.read_text(encoding="utf-8")
        start, end = text.index("cameras:"), text.index("skills:")
        flow = (
            "cameras: {cam1: {pose: {position: [0, 0, 1], look_at: [0, 0.5, 0]}, rate: 10, "
            "image: {width: 640, height: 480, horizontal_fov: 18 deg}}}  # few\n"
        )
        file.write_text(text[:start] + flow + text[end:], encoding="utf-8")
    workspace, document = opened(file)
    point = np.array([0.1, 0.2, 0.3])
    new = replace(workspace.cameras["cam1"], name="cam9", X_FC=look_at((1, 1, 1), point))
    again = load_workspace(file, with_further_camera(document, new, "cam1", point))
    assert list(again.cameras) == [*workspace.cameras, "cam9"]
    np.testing.assert_allclose(again.cameras["cam9"].X_FC, new.X_FC, atol=1e-9)
    np.testing.assert_allclose(again.cameras["cam9"].matrix, new.matrix)
    assert {**again.values}.items() >= {**workspace.values}.items()
    assert again.cameras["cam9"].rate == workspace.cameras["cam1"].rate


def test_an_object_elsewhere_keeps_the_rest(file):
    workspace, document = opened(file)
    X_WO = workspace.objects["g1"].X_WO.copy()
    X_WO[:3, 3] += (0.05, -0.01, 0)
    content = with_pose(document, ("objects", "g1", "pose"), X_WO)
    np.testing.assert_allclose(load_workspace(file, content).objects["g1"].X_WO, X_WO, atol=1e-9)
    assert len(changes(document, content)) == 2


def test_a_task_is_added_or_told_more_exactly(file):
    document = read_workspace_document(file)
    named = load_workspace(file, with_task(document, "pickup g1 elbow=up", {}, instead_of="pickup green"))
    assert [task.task for task in named.tasks] == ["pickup g1 elbow=up"]
    assert named.tasks[0].min_q_eoi == 0.5
    added = load_workspace(file, with_task(document, "pickup g1 elbow=up", {"min_q_eoi": 1.0}, instead_of=None))
    assert [task.task for task in added.tasks] == ["pickup green", "pickup g1 elbow=up"]
    assert added.tasks[1].min_q_eoi == 1.0


def with_tasks(file: Path, tasks: str) -> SourceDocument:
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.index("tasks:")] + tasks, encoding="utf-8")
    return read_workspace_document(file)


def test_a_listed_task_keeps_its_thresholds_and_gets_those_that_are_missing_or_stricter(file):
    document = with_tasks(file, "tasks:\n  - task: pickup g1\n    min_q_eoi: 50 %  # half\n    max_time: 20 s\n")
    wished = {"min_q_eoi": 0.8, "max_time": 25.0, "max_delay": 2.0}
    content = with_task(document, "pickup g1 elbow=up", wished, instead_of="pickup g1")
    (task,) = load_workspace(file, content).tasks
    assert (task.task, task.min_q_eoi, task.max_time, task.max_delay) == ("pickup g1 elbow=up", 0.8, 20.0, 2.0)
    assert b"min_q_eoi: 80 %  # half\n    max_time: 20 s\n    max_delay: 2\n" in content
    file.write_bytes(content)
    again = read_workspace_document(file)
    assert with_task(again, "pickup g1 elbow=up", wished, instead_of=None) == content


def test_a_task_of_several_steps_is_added_or_told_more_exactly_as_its_steps(file):
    document = with_tasks(file, "tasks:\n  - steps: [pickup g1, place g1 table]  # both\n    min_q_eoi: 50 %\n")
    old, new = "pickup g1 then place g1 table", "pickup g1 elbow=up then place g1 table"
    told = with_task(document, new, {"min_q_eoi": 0.8}, instead_of=old).decode()
    assert "  - steps: [pickup g1 elbow=up, place g1 table]  # both\n    min_q_eoi: 80 %\n" in told
    added = with_task(document, new, {}, instead_of=None).decode()
    assert added == document.content.decode() + "  - {steps: [pickup g1 elbow=up, place g1 table]}\n"


def test_the_first_task_of_a_file_is_added_at_its_end(file):
    added = load_workspace(file, with_task(with_tasks(file, ""), "pickup g1", {"min_q_eoi": 1.0}, instead_of=None))
    assert [task.task for task in added.tasks] == ["pickup g1"]
