"""Warnings that need the robot's geometry: cameras inside something solid, speeds that the tool never reaches."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.cell_warnings import cell_warnings, fastest_tool, outside_detectors, scenes_of, swept_cameras
from sqrp_cli.cli.main import run
from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, box_corners, inverse, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.collision import PlacedScene
from tests.cells import copied, edit, read_cases, shipped_cell, write_cell

CELL = Path(__file__).parents[1] / "cases" / "cell"
TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"
CODES = {"camera-inside-robot", "camera-inside-object", "unreachable-speed"}


def found(folder: Path) -> list[Problem]:
    return [problem for problem in cell_warnings(Cell.load(load_workspace(folder))) if problem.code in CODES]


TOP = "position: [0.5, 0, 1.5], look_at: [0.5, 0, 0]"
HAND = "frame: wrist\n    pose: {position: [0, 0.05, 0]"


@pytest.mark.parametrize(
    ("old", "new", "camera", "solid"),
    [
        (TOP, "position: [0, 0, 0.1], look_at: [0.5, 0, 0]", "top", "link `base`"),  # a box, which stands at z = 0.1
        (TOP, "position: [0.01, 0, 0.22], look_at: [0.5, 0, 0]", "top", None),  # above the base and the upper arm
        (HAND, "frame: lower\n    pose: {position: [0.01, 0, 0]", "hand", "link `lower`"),  # the mesh that carries it
        (HAND, "frame: lower\n    pose: {position: [0.1, 0, 0]", "hand", None),
    ],
)
def test_a_camera_inside_a_link_is_reported_with_the_link(
    old: str, new: str, camera: str, solid: str | None, tmp_path: Path
) -> None:
    edit(shutil.copytree(CELL, tmp_path / "cell"), old, new)
    problems = found(tmp_path / "cell")
    assert [problem.code for problem in problems] == ["camera-inside-robot"] * (solid is not None)
    for problem in problems:
        assert f"camera `{camera}` is inside {solid} at the start" in problem.message
        assert problem.severity == "warning"
        assert problem.place is not None
        assert problem.place.line is not None


def test_a_speed_that_the_joints_allow_nowhere_is_reported_where_it_stands(tmp_path: Path) -> None:
    cell, skill = copied(tmp_path), tmp_path / "skills/pickup/skill.yaml"
    edit(skill, "straight_move: grasp, speed: 4 cm/s", "straight_move: grasp, speed: 3")
    (problem,) = found(cell)
    assert problem.code == "unreachable-speed"
    assert "`a2` asks for a speed of 3 m/s" in problem.message
    assert problem.place is not None
    assert (problem.place.file.name, problem.place.line) == ("skill.yaml", 18)


def test_no_posture_moves_the_tool_faster_than_the_bound() -> None:
    model = Cell.load(load_workspace(TABLETOP)).model
    random = np.random.default_rng(0)
    postures = random.uniform(model.lower, model.upper, (2000, len(model.arm)))
    _, jacobians = model.tool_poses_and_jacobians(postures)
    signs = np.sign(random.uniform(-1, 1, (2000, len(model.arm), 1)))
    speeds = np.linalg.norm((jacobians[:, :3] @ (signs * model.velocity[:, None]))[..., 0], axis=1)
    assert 0.3 * fastest_tool(model) < speeds.max() < fastest_tool(model)


def tabletop_with(tmp_path: Path, camera: str) -> Path:
    """The tabletop with one more camera."""
    entry = "cameras:                         # pose: where the lens is, and the point that it looks at\n"
    more = "image: {width: 640, height: 480, horizontal_fov: 60 deg}, far: 3 m, rate: 10 Hz, latency: 50 ms"
    folder = copied(tmp_path)
    edit(folder, entry, f"{entry}  more: {{{camera}, {more}}}\n")
    return folder


@pytest.mark.parametrize(("camera", "code", "says", "mend"), read_cases("doubtful_cameras.yaml"))
def test_cameras_on_links_see_something_too(
    camera: str, code: str | None, says: str, mend: str, tmp_path: Path
) -> None:
    cell = Cell.load(load_workspace(tabletop_with(tmp_path, camera)))
    problems = [one for one in cell_warnings(cell) if one.code in ("camera-sees-nothing", "doubtful-parent")]
    assert [one.code for one in problems] == ([] if code is None else [code])
    for problem in problems:
        assert "`more`" in problem.message
        assert says in problem.message
        assert problem.mend is not None
        assert mend in problem.mend


def test_a_camera_measured_from_another_link_is_told_from_which_it_would_see(tmp_path: Path) -> None:
    """A result relative to the world, which was published from a base that stands a metre away and is turned round."""
    folder = tabletop_with(tmp_path, "frame: base_link, pose: {position: [0.5, 0, 1.2], rpy: [150 deg, 0, 90 deg]}")
    edit(folder, "base: {position: [0, 0, 0]}", "base: {position: [-2, 3, 0], rpy: [0, 0, 180 deg]}")
    (problem,) = [one for one in cell_warnings(Cell.load(load_workspace(folder))) if "`more`" in one.message]
    assert problem.code == "camera-sees-nothing"
    assert problem.mend is not None
    assert "say `frame: world`" in problem.mend


@pytest.mark.parametrize(("position", "hit"), [("[0.48, 0.28, 0.15]", True), ("[0.48, 0.9, 0.15]", False)])
def test_a_camera_in_the_way_of_the_arm_is_a_finding_and_rank_says_it_of_the_best(
    position: str, hit: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tabletop_with(tmp_path, f"pose: {{position: {position}, look_at: [0, 0, 0]}}")
    assert run(["rank", str(folder), "pickup g2 approach_yaw=0deg", "--ways", "fastest"]) == 0
    assert ("camera `more` stands where `" in capsys.readouterr().err.replace("\n", " ")) == hit
    cell = open_cell(folder)
    checked = cell.check("pickup g2 approach_yaw=0deg")
    assert ["camera-in-the-way"] * hit == [one.code for one in checked.problems if one.code == "camera-in-the-way"]
    best = cell.rank("pickup g2 approach_yaw=0deg", ways="fastest").best
    scenes = scenes_of(cell.cell, cell.cell.initial_world, [[best.way]])
    found = [one.message for one in swept_cameras(cell.cell, scenes)]
    assert [message.startswith("camera `more` stands where `") for message in found] == [True] * hit
    several = [one.message for one in cell.check("pickup green").problems if one.code == "camera-in-the-way"]
    assert ["passes in `pickup g2`" in message for message in several] == [True] * hit  # not in that of g1, the first


def test_a_camera_that_shows_another_place_than_the_task_is_a_finding_of_check(tmp_path: Path) -> None:
    cell = open_cell(tabletop_with(tmp_path, "pose: {position: [-0.05, -0.9, 0.4], look_at: [-0.05, -0.55, 0.04]}"))
    told = {}
    for task in ("pickup g2 approach_yaw=0deg", "pickup r2 approach_yaw=0deg"):
        told[task] = any("`more`" in one.message for one in cell.check(task).problems if one.code == "idle-camera")
    assert list(told.values()) == [True, False]


@pytest.mark.parametrize(
    ("position", "says"),
    [([0, 0, 0], "the arm is inside crate (the mesh of"), ([80.45, 0, 0.5], " hits crate (the mesh of")],
    ids=["around everything", "around all places of work"],
)
def test_a_mesh_in_millimetres_that_is_in_the_way_is_doubted_before_any_path_is_searched(
    position: list[float], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signs = [(x, y, z) for x in (-80, 80) for y in (-60, 60) for z in (-90, 90)]  # a crate of 16 x 12 x 18 cm
    sides = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    lines = [*(f"v {x} {y} {z}" for x, y, z in signs), *(f"f {side}" for side in sides)]
    (tmp_path / "crate.obj").write_text("\n".join(lines))
    cell = shipped_cell("tabletop")
    cell["objects"]["crate"] |= {"parts": [{"mesh": str(tmp_path / "crate.obj")}], "pose": {"position": position}}
    searched, check_path = [], PlacedScene.check_path
    monkeypatch.setattr(PlacedScene, "check_path", lambda *a, **b: searched.append(1) or check_path(*a, **b))
    (row,) = open_cell(write_cell(cell, tmp_path).parent).rank("pickup g2").candidates
    assert not row.feasible
    assert says in row.reasons[0]
    assert "measures 269 m, its `size` 0.326 m: perhaps it is in millimetres, say `scale: 0.001`" in row.reasons[0]
    assert not searched


def size_in_image(eye: Camera, X_CB: Array, size: Sequence[float]) -> float:
    """Square root of the area of a box in the image, by OpenCV [pixels]; 0 where a corner is outside."""
    corners, still = transform(X_CB, box_corners(size)), np.zeros(3)
    pixels = cv2.projectPoints(corners, still, still, np.array(eye.matrix), None)[0].reshape(-1, 2)
    inside = ((pixels > -0.5) & (pixels < [eye.width - 0.5, eye.height - 0.5])).all() and corners[:, 2].min() > eye.near
    return float(np.sqrt(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32))))) if inside else 0.0


@pytest.mark.parametrize(("least", "told"), [(12, False), (130, True)])
def test_a_part_too_small_from_where_it_is_looked_at_is_told_with_the_distance_that_would_do(least, told, tmp_path):
    folder = tabletop_with(tmp_path, "frame: forearm_link, pose: {position: [0, 0, 0.2]}")
    edit(folder, "min_pixels: 12", f"min_pixels: {least}")
    cell = open_cell(folder)
    best = cell.rank("pickup g2 approach_yaw=0deg", ways="fastest").best
    (scene,) = scenes = scenes_of(cell.cell, cell.cell.initial_world, [[best.way]])
    problems = [*outside_detectors(cell.cell, scenes)]
    assert len(problems) == told
    views = []  # of each box, the best
    states = scene.states
    for box in (box for target in scene.planned.targets for box in target.boxes):
        posed = [(eye, inverse(states.camera_poses(eye)) @ states.box_poses(box)) for eye in cell.cell.observer.cameras]
        seen = [(size_in_image(eye, one, box.size), eye, one, box.size) for eye, X_CB in posed for one in X_CB]
        views.append(max(seen, key=lambda one: one[0]))
    largest, eye, X_CB, size = min(views, key=lambda one: one[0])
    assert (largest < least) == told
    for problem in problems:
        assert f"`g2` measures at most {largest:.1f} pixels" in problem.message
        assert f"{np.linalg.norm(X_CB[:3, 3]):.2f} m from camera `{eye.name}`" in problem.message
        nearer = float(re.search(r"from (\S+) m or nearer", problem.mend)[1]) / np.linalg.norm(X_CB[:3, 3])
        X_CB[:3, 3] *= nearer
        assert least <= size_in_image(eye, X_CB, size) < 1.15 * least
