"""New workspaces: what is guessed about an arm holds, and what it is said to be able to do it does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Infeasible, InputError
from sqrp_cli.files.packages import package_roots
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.starter.layout import Layout
from sqrp_cli.starter.make import make_starter
from sqrp_cli.study.analysis import analyse
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.grips import grips
from sqrp_cli.task.task import read_task

ROBOTS = "package://example-robot-data/robots/"

ARMS = {
    "own": (None, "flange"),
    "ur3": (f"{ROBOTS}ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur10": (f"{ROBOTS}ur_description/urdf/ur10_robot.urdf", "tool0"),
    "panda": (f"{ROBOTS}panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    "xarm7": (f"{ROBOTS}xarm_description/urdf/xarm7.urdf", "link_eef"),
    "kinova": (f"{ROBOTS}kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "z1": (f"{ROBOTS}z1_description/urdf/z1.urdf", "gripperStator"),
}
"""Arms as laboratories have them, and where a robot programmer would fix a tool; UR and Z1 have no usable SRDF, and
Z1 is too low for its tool."""

HANDS = ("panda", "z1")
"""Those with fingers in their URDF."""

SWEEP = ("ur10", "kinova", "xarm7")
"""Further arms, for trials; home and cubes of the last are sought for half a minute."""


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=[pytest.mark.trial] * (name in SWEEP)) for name in ARMS]
)
def arm(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def starter(arm: str, tmp_path_factory: pytest.TempPathFactory) -> Layout:
    return make_starter(tmp_path_factory.mktemp(arm) / "cell", ARMS[arm][0])


@pytest.fixture(scope="module")
def cell(starter: Layout) -> Cell:
    return Cell.load(load_workspace(starter.folder))


@pytest.fixture(scope="module")
def motions(cell: Cell) -> dict[str, Motion]:
    world = cell.initial_world
    found = {c.name: feasible_motion(cell, c, world) for c in read_task("pickup green", cell.workspace).candidates}
    return {name: motion for name, motion in found.items() if isinstance(motion, Motion)}


def test_the_tool_is_fixed_where_a_programmer_would_and_what_was_guessed_is_marked(arm: str, starter: Layout) -> None:
    assert starter.tip == ARMS[arm][1]
    text = (starter.folder / "workspace.yaml").read_text()
    marked = set(re.findall(r"^ *(\w+):.*# check:", text, re.MULTILINE))
    grasps = {"tool", "frame", "fingers", "width"} if arm in HANDS else {"tool", "tool_frame"}
    guessed = {"base", "home", "color", *grasps, *(["srdf"] if arm == "panda" else [])}
    assert ("check:" in text) == (arm != "own")
    assert arm == "own" or guessed <= marked


def test_every_object_that_it_puts_there_can_be_picked_up(starter: Layout, motions: dict[str, Motion]) -> None:
    assert len(motions) == sum(cube.name.startswith("g") for cube in starter.cubes) == 3
    assert starter.task == "pickup green"


def test_the_workspace_is_sound_and_its_home_points_down_and_touches_nothing(cell: Cell) -> None:
    """A home that is a state of the SRDF is as that says."""
    assert [problem for problem in lint(cell.workspace) if problem.severity == "error"] == []
    named = re.search(r"home: [\w-]+  # check: .*a state of the SRDF", cell.workspace.path.read_text())
    assert named or cell.model.tool_pose(cell.model.home)[2, 2] < np.cos(np.radians(179)) + 1e-3
    assert cell.collision.placed(cell.initial_world).check(cell.model.home) is None


def test_nothing_of_the_robot_reaches_beyond_the_tool_frame_along_its_axis(cell: Cell) -> None:
    """So its z axis points out of the arm, and the cup is not inside a gripper that was there before."""
    X_TW = np.linalg.inv(cell.model.tool_pose(cell.model.home))
    X_WL = cell.model.link_poses(cell.model.home[None])
    depth = cell.collision.depth
    for solid in cell.collision.solids:
        link = solid.part.parent
        if depth[link] >= depth[cell.model.tool_frame]:
            center = X_TW @ X_WL[link][0] @ np.append(solid.center, 1.0)
            assert center[2] < 0.0, link


def test_the_cameras_see_all_that_matters_in_one_way_at_least(cell: Cell) -> None:
    found = []
    for candidate in read_task("pickup green", cell.workspace).candidates:
        for grip in grips(cell, candidate, cell.initial_world):  # fingers hide an object, turned otherwise they do not
            analysis = analyse(cell, grip, cell.initial_world, FixedCount(20), full=False)
            found.append(0.0 if isinstance(analysis, Infeasible) else analysis.result.q_eoi)
    assert max(found) > 0.9


def test_its_cameras_beside_others_are_a_finding(tmp_path: Path) -> None:
    folder = make_starter(tmp_path / "cell", ARMS["panda"][0]).folder
    assert "guessed-camera" not in [one.code for one in lint(load_workspace(folder))]
    text = (folder / "workspace.yaml").read_text()
    image = "image: {width: 640, height: 480, fx: 600, fy: 600}"
    mine = f"mine: {{pose: {{position: [1, 0, 1], look_at: [0.4, 0, 0]}}, {image}, rate: 30}}"
    (folder / "workspace.yaml").write_text(text.replace("  cam1:", f"  {mine}\n  cam1:"))
    (found,) = [one for one in lint(load_workspace(folder)) if one.code == "guessed-camera"]
    assert "`cam1` and `cam2`" in found.message


def test_it_is_the_same_every_time(tmp_path: Path) -> None:
    for name in ("one", "other"):
        make_starter(tmp_path / name, ARMS["own"][0])
    one, other = (
        {f.name: f.read_bytes() for f in (tmp_path / n).rglob("*.*") if f.is_file()} for n in ("one", "other")
    )
    assert one == other


def test_an_urdf_of_ones_own_with_meshes_in_its_own_package_needs_no_settings(tmp_path: Path) -> None:
    """A checkout of a ROS package that no environment variable points at."""
    data = next(root for root in package_roots() if (root / "example-robot-data").is_dir())
    source = data / "example-robot-data" / "robots" / "ur_description"
    package = tmp_path / "ws" / "my_ur"
    package.mkdir(parents=True)
    (package / "meshes").symlink_to(source / "meshes")
    text = (source / "urdf" / "ur10_robot.urdf").read_text()
    (package / "urdf").mkdir()
    text = text.replace("package://example-robot-data/robots/ur_description", "package://my_ur")
    (package / "urdf" / "arm.urdf").write_text(text)
    made = make_starter(tmp_path / "cell", str(package / "urdf" / "arm.urdf"))
    written = (made.folder / "workspace.yaml").read_text()
    assert "urdf: ../ws/my_ur/urdf/arm.urdf" in written
    assert "package_roots: [../ws]" in written
    assert made.task is not None


@pytest.mark.parametrize(("folder", "robot", "said"), [
    ("file", None, "file: this is a file"), ("full", None, "full: this folder is not empty"),
    ("no/cell", None, "no/cell: there is no folder no"),
    ("/proc/cell", None, "/proc/cell: this folder cannot be made"),  # it takes no folders, whoever asks
    ("cell", "none.urdf", "none.urdf:1:"), ("cell", "table.urdf", "no joint that moves an arm"),
])  # fmt: skip
def test_what_cannot_be_made_is_named_as_it_was_given_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, robot: str | None, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("full").mkdir()
    files = {"file": "mine", "full/workspace.yaml": "mine", "none.urdf": "no robot"}
    for name, text in (files | {"table.urdf": "<robot name='table'><link name='top'/></robot>"}).items():
        Path(name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError) as caught:
        make_starter(Path(folder), robot)
    assert said in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("reference", ["none.urdf", "/nowhere/none.urdf", "package://none/none.urdf", "file:///n.urdf"])
def test_a_robot_that_is_missing_is_named_once(reference: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"not found|no such file or folder") as caught:
        make_starter(tmp_path / "cell", reference)
    assert str(caught.value).count(reference) == 1
