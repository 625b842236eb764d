"""Arms as their makers describe them: each picks up a cube in a small cell, and every motion is honest.

Six, seven and five axes; with and without an SRDF; continuous joints, gripper joints that mimic, meshes of all formats.
The independent model is Pinocchio's own reading of the URDF, with its geometry, its kinematics and coal's distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import pose, rpy_to_matrix
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.collision import CLEARANCE
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task
from tests.cells import read_cases, write_cell
from tests.motion.cells import PinocchioArm, assert_keeps_limits, even_steps

SKILL = Path(__file__).parents[2] / "skills" / "pickup"
DATA = "package://example-robot-data/robots/"
TOOL_BOX, TOOL_LENGTH = (0.03, 0.03, 0.1), 0.1


@dataclass(frozen=True)
class Arm:
    """A vendor's arm: URDF, SRDF or none, the link that the tool is on and how it is turned there, home [deg], cube.

    tool: position [m] and rpy [deg] of the tool's root. height: of the base over the table [m]. cube: x, y and side.
    """

    urdf: str
    link: str
    home: dict[str, float]
    cube: tuple[float, float, float]
    srdf: str | None = None
    height: float = 0.005
    tool: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0, 0, 0), (0, 0, 0))


ARMS = {name: Arm(**stated) for name, stated in read_cases("arms.yaml").items()}


ALIKE = ("ur3", "ur10")
"""Arms that differ from another one by their size alone."""


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.trial) if name in ALIKE else name for name in ARMS]
)
def arm(request: pytest.FixtureRequest) -> Arm:
    return ARMS[request.param]


@pytest.fixture(scope="module")
def cell(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return make_cell(arm, tmp_path_factory.mktemp("arm"))


def make_cell(arm: Arm, folder: Path, **things: dict[str, object]) -> Cell:
    """A table, a cube, a camera and other things around an arm with a tool made of one box."""
    (x, y, side), (position, rpy), document = arm.cube, arm.tool, read_cases("arm_cell.yaml")
    robot, cube = document["robot"], document["objects"]["cube"]
    robot |= {"urdf": f"{DATA}{arm.urdf}.urdf", "base": {"position": [0, 0, arm.height]}}
    robot |= {"srdf": f"{DATA}{arm.srdf}"} if arm.srdf else {}
    robot["home"] = {name: f"{angle} deg" for name, angle in arm.home.items()}
    turned = {"position": list(position), "rpy": [f"{angle} deg" for angle in rpy]}
    robot["tool"] |= {"link": arm.link, "pose": turned}
    document["cameras"]["cam"]["pose"] = {"position": [x + 0.5, y + 0.4, 0.5], "look_at": [x, y, 0]}
    document["skills"] = [str(SKILL)]
    cube |= {"size": [side] * 3, "pose": {"position": [x, y, side / 2]}}
    document["objects"] |= things
    return Cell.load(load_workspace(write_cell(document, folder)))


@pytest.fixture(scope="module")
def motion(cell: Cell) -> Motion:
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    planned = feasible_motion(cell, candidate, cell.initial_world)
    assert not isinstance(planned, Infeasible), planned
    return planned


def independent_arm(cell: Cell, arm: Arm) -> PinocchioArm:
    position, rpy = arm.tool
    X_LR, X_RT = pose(rpy_to_matrix(np.radians(rpy)), position), pose(position=(0, 0, TOOL_LENGTH))
    tool = [(X_LR @ pose(position=(0, 0, TOOL_LENGTH / 2)), coal.Box(*TOOL_BOX))]
    about = cell.workspace.objects, cell.unchecked_pairs
    return PinocchioArm(cell.workspace.robot, cell.model, arm.link, X_LR @ X_RT, tool, *about)


def contacts(independent: PinocchioArm, motion: Motion) -> dict[str, set[tuple[str, str]]]:
    """What touches what in each primitive, by Pinocchio's geometry."""
    steps = [even_steps(one.trajectory, 0.01) for one in motion.primitives]
    found = (independent.contacts(motion, index, own, 0.9 * CLEARANCE) for index, own in enumerate(steps))
    return dict(zip((one.name for one in motion.primitives), found, strict=True))


@pytest.fixture(scope="module")
def independent(cell: Cell, arm: Arm) -> PinocchioArm:
    return independent_arm(cell, arm)


def test_the_tool_goes_where_the_skill_says_by_pinocchios_kinematics(
    independent: PinocchioArm, arm: Arm, motion: Motion
) -> None:
    """Straight down onto the middle of the cube's upper side, and straight up again."""
    x, y, side = arm.cube
    heights = {"a2": (side + 0.02, side), "a4": (side, side + 0.05)}
    for primitive in motion.primitives:
        if primitive.name in heights:
            for share in np.linspace(0, 1, 7):
                q = primitive.trajectory.path.positions([share])[0]
                low, high = heights[primitive.name]
                X_WT = independent.tool_pose(q)
                np.testing.assert_allclose(X_WT[:3, 3], [x, y, low + share * (high - low)], atol=5e-6)
                np.testing.assert_allclose(X_WT[:3, 2], [0, 0, -1], atol=5e-6)


def test_nothing_touches_by_pinocchios_geometry(independent: PinocchioArm, motion: Motion) -> None:
    meant = {"a2": {("cube", "tool")}, "a3": {("cube", "tool")}, "a4": {("cube", "table")}}
    for name, found in contacts(independent, motion).items():
        assert found <= meant.get(name, set()), name


def test_velocity_acceleration_jerk_and_position_keep_their_limits(cell: Cell, motion: Motion) -> None:
    assert_keeps_limits(cell.model, motion, 5e-3)


def test_it_is_ranked(cell: Cell) -> None:
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    result = RankJob(FixedCount(5), cell=cell, world=cell.initial_world).assess(candidate)
    assert result.feasible
    assert result.q_avg is not None


def test_more_positions_of_a_seventh_axis_are_tried_where_few_do_not_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A box hangs where the forearm is in each of the first eight."""
    box = {"type": "box", "size": [0.06, 0.18, 0.17], "pose": {"position": [0.24, 0.11, 0.36]}, "fixed": True}
    cell = make_cell(ARMS["panda"], tmp_path, box=box)
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    motion = feasible_motion(cell, candidate, cell.initial_world)
    assert isinstance(motion, Motion)
    touched = set().union(*contacts(independent_arm(cell, ARMS["panda"]), motion).values())
    assert not any("box" in names for names in touched)
    monkeypatch.setattr(inverse_kinematics, "MORE_REDUNDANCY_SAMPLES", inverse_kinematics.REDUNDANCY_SAMPLES)
    few = feasible_motion(cell, candidate, cell.initial_world)
    assert isinstance(few, Infeasible)
    assert " hits box " in few.reasons[0]
