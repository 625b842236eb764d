"""Arms as their makers describe them: each picks up a cube in a small cell, and every motion is honest.

Six, seven and five axes; with and without an SRDF; continuous joints, gripper joints that mimic, meshes of all formats.
The independent model is Pinocchio's own reading of the URDF, with its geometry, its kinematics and coal's distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, pose, rpy_to_matrix
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.collision import CLEARANCE, pair
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task
from tests.cells import write_cell
from tests.motion.cells import phase_samples

SKILL = Path(__file__).parents[2] / "skills" / "pickup"
DATA = "package://example-robot-data/robots/"
TOOL_BOX, TOOL_LENGTH = (0.03, 0.03, 0.1), 0.1


@dataclass(frozen=True)
class Arm:
    """A vendor's arm: URDF, SRDF or none, the link that the tool is on and how it is turned there, home [deg], cube.

    tool: position [m] and rpy [deg] of the tool's root. height: of the base over the table [m]. cube: x, y and side.
    """

    urdf: str
    srdf: str | None
    link: str
    home: dict[str, float]
    cube: tuple[float, float, float]
    height: float = 0.005
    tool: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0, 0, 0), (0, 0, 0))


def ur(*home: float) -> dict[str, float]:
    names = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    return {f"{name}_joint": angle for name, angle in zip(names, home, strict=True)}


def numbered(name: str, *home: float) -> dict[str, float]:
    return {f"{name}{k}": angle for k, angle in enumerate(home, 1)}


ARMS = {
    "ur3": Arm("ur_description/urdf/ur3_robot", None, "tool0", ur(-21, -47, 35, 102, 90, 69), (0.28, 0, 0.03)),
    "ur5": Arm("ur_description/urdf/ur5_robot", None, "tool0", ur(0, -110, 110, -90, -90, 0), (0.44, 0, 0.04)),
    "ur10": Arm("ur_description/urdf/ur10_robot", None, "tool0", ur(-14, -70, 78, 82, 90, 76), (0.62, 0, 0.05)),
    "panda": Arm(
        "panda_description/urdf/panda",
        "panda_description/srdf/panda.srdf",
        "panda_hand_tcp",
        numbered("panda_joint", 0, -9, 0, -113, 0, 104, 45),
        (0.46, 0, 0.05),
        tool=((0, 0, 0.0115), (0, 0, 0)),
    ),
    "xarm7": Arm(
        "xarm_description/urdf/xarm7",
        "xarm_description/srdf/xarm7.srdf",
        "link_eef",
        numbered("joint", 0, -10, 0, 50, 0, 60, 0),
        (0.37, 0, 0.04),
    ),
    "kinova": Arm(
        "kinova_description/robots/kinova",
        "kinova_description/srdf/kinova.srdf",
        "j2s6s200_end_effector",
        numbered("j2s6s200_joint_", 89, 144, 215, 0, 71, 89),
        (0.49, 0, 0.05),
        tool=((0.0044, 0, 0), (90, 0, 90)),
    ),
    "z1": Arm(
        "z1_description/urdf/z1",
        None,
        "gripperStator",
        numbered("joint", 0, 112, -95, 73, 0, 90),
        (0.39, 0, 0.04),
        height=0.237,
        tool=((0.151, 0, 0), (90, 0, 90)),
    ),
    "so100": Arm(
        "so_arm_description/urdf/so100",
        None,
        "gripper",
        {"shoulder_pan": 0, "shoulder_lift": 115, "elbow_flex": -89, "wrist_flex": 44, "wrist_roll": 0},
        (0, -0.28, 0.02),
        height=0.214,
        tool=((0, -0.1084, 0), (90, -90, 0)),
    ),
}


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
    x, y, side = arm.cube
    position, rpy = arm.tool
    robot = {
        "urdf": f"{DATA}{arm.urdf}.urdf",
        "base": {"position": [0, 0, arm.height]},
        "tool": {
            "boxes": [{"size": list(TOOL_BOX), "pose": {"position": [0, 0, TOOL_LENGTH / 2]}}],
            "frame": {"position": [0, 0, TOOL_LENGTH]},
            "link": arm.link,
            "pose": {"position": list(position), "rpy": [f"{angle} deg" for angle in rpy]},
        },
        "home": {name: f"{angle} deg" for name, angle in arm.home.items()},
        "limits": {"velocity": 1, "acceleration": 2, "jerk": 20},
    }
    document = {
        "robot": robot | ({"srdf": f"{DATA}{arm.srdf}"} if arm.srdf else {}),
        "detectors": {"color": {"kind": "color", "distance": [0.1, 5], "max_incidence": 1.5, "min_pixels": 5}},
        "cameras": {
            "cam": {
                "pose": {"position": [x + 0.5, y + 0.4, 0.5], "look_at": [x, y, 0]},
                "image": {"width": 640, "height": 480, "horizontal_fov": "60 deg"},
                "rate": 10,
            }
        },
        "skills": [str(SKILL)],
        "objects": {
            "table": {"type": "table", "size": [2, 2, 0.04], "pose": {"position": [0, 0, -0.02]}, "fixed": True},
            "cube": {"type": "cube", "size": [side] * 3, "pose": {"position": [x, y, side / 2]}, "on": "table"},
            **things,
        },
        "state": ["hand_empty", "obj_on_table(cube)"],
    }
    return Cell.load(load_workspace(write_cell(document, folder)))


@pytest.fixture(scope="module")
def motion(cell: Cell) -> Motion:
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    planned = feasible_motion(cell, candidate, cell.initial_world)
    assert not isinstance(planned, Infeasible), planned
    return planned


class IndependentArm:
    """Arm, tool and things as Pinocchio and coal see them, from the URDF file."""

    def __init__(self, cell: Cell, arm: Arm) -> None:
        robot = cell.workspace.robot
        self.cell = cell
        self.model = pin.buildModelFromUrdf(str(robot.urdf.path))
        folders = [str(root) for root in robot.package_roots]
        kind = pin.GeometryType.COLLISION
        self.geometry = pin.buildGeomFromUrdf(self.model, str(robot.urdf.path), kind, package_dirs=folders)
        frame = self.model.frames[self.model.getFrameId(arm.link, pin.FrameType.BODY)]
        position, rpy = arm.tool
        X_JR = frame.placement * pin.SE3(pose(rpy_to_matrix(np.radians(rpy)), position))
        self.joint, self.X_JT = frame.parentJoint, X_JR * pin.SE3(pose(position=(0, 0, TOOL_LENGTH)))
        self.links = {k: self.model.frames[g.parentFrame].name for k, g in enumerate(self.geometry.geometryObjects)}
        X_JB = X_JR * pin.SE3(pose(position=(0, 0, TOOL_LENGTH / 2)))
        self.tool = self._add("tool_body", self.joint, X_JB, coal.Box(*TOOL_BOX))
        X_BW = pin.SE3(pose(position=(0, 0, -arm.height)))
        sizes = {name: thing.size for name, thing in cell.workspace.objects.items()}
        self.things = {
            name: self._add(name, 0, X_BW * pin.SE3(cell.workspace.objects[name].X_WO), coal.Box(*size))
            for name, size in sizes.items()
        }
        self.X_BW = X_BW

    def _add(self, name: str, joint: int, X: pin.SE3, shape: coal.CollisionGeometry) -> int:
        index = self.geometry.addGeometryObject(pin.GeometryObject(name, joint, X, shape))
        self.links[index] = name
        return int(index)

    def configuration(self, q: Array) -> Array:
        """Pinocchio's q: every joint's position, cosine and sine for joints without limits."""
        full = pin.neutral(self.model)
        for name, value in self.cell.model.joint_values(q).items():
            joint = self.model.joints[self.model.getJointId(name)]
            full[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return full

    def tool_pose(self, q: Array) -> Array:
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.configuration(q))
        return (self.X_BW.inverse() * data.oMi[self.joint] * self.X_JT).homogeneous

    def contacts(self, motion: Motion, index: int, margin: float, step: float) -> set[tuple[str, str]]:
        """Pairs of names that come closer than a margin [m] at steps [m] of a primitive, neighbours aside."""
        primitive = motion.primitives[index]
        geometry = self.geometry.copy()
        objects = geometry.geometryObjects
        if primitive.held is not None:
            held = objects[self.things[primitive.held]]
            held.parentJoint, held.placement = self.joint, self.X_JT * pin.SE3(np.asarray(primitive.X_TO))
        unchecked = self.cell.unchecked_pairs | self.cell.model.adjacent_pairs
        for i, j in combinations(range(geometry.ngeoms), 2):
            names = pair(self.links[i], self.links[j])
            carried = primitive.held in names and "tool_body" in names
            if objects[i].parentJoint != objects[j].parentJoint and names not in unchecked and not carried:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
        model_data, data = self.model.createData(), geometry.createData()
        for request in data.collisionRequests:
            request.security_margin = margin
        t = np.linspace(0, primitive.trajectory.duration, 500)
        moved = np.concatenate(
            [[0.0], np.cumsum(np.abs(np.diff(primitive.trajectory.positions(t), axis=0)).sum(axis=1))]
        )
        count = max(2, int(np.ceil(moved[-1] / step)))
        found = set()
        for q in primitive.trajectory.positions(np.interp(np.linspace(0, moved[-1], count), moved, t)):
            pin.computeCollisions(self.model, model_data, geometry, data, self.configuration(q), False)
            for k, result in enumerate(data.collisionResults):
                if result.isCollision():
                    both = geometry.collisionPairs[k]
                    found.add(pair(self.links[both.first], self.links[both.second]))
        return found


@pytest.fixture(scope="module")
def independent(cell: Cell, arm: Arm) -> IndependentArm:
    return IndependentArm(cell, arm)


def test_the_tool_goes_where_the_skill_says_by_pinocchios_kinematics(
    independent: IndependentArm, arm: Arm, motion: Motion
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


def test_nothing_touches_by_pinocchios_geometry(independent: IndependentArm, motion: Motion) -> None:
    meant = {"a2": {("cube", "tool_body")}, "a3": {("cube", "tool_body")}, "a4": {("cube", "table")}}
    for index, primitive in enumerate(motion.primitives):
        found = independent.contacts(motion, index, 0.9 * CLEARANCE, 0.01)
        assert found <= meant.get(primitive.name, set()), primitive.name


def test_velocity_acceleration_jerk_and_position_keep_their_limits(cell: Cell, motion: Motion) -> None:
    model = cell.model
    for primitive in motion.primitives:
        steps = np.arange(0, primitive.trajectory.duration, 5e-3)
        t = np.concatenate([steps, phase_samples(primitive.trajectory, 7)])
        n = len(model.arm)
        for order, limit in ((1, model.velocity), (2, model.acceleration), (3, model.jerk)):
            assert (np.abs(primitive.trajectory.derivatives(t, order)[:, :n]) <= limit * (1 + 1e-9)).all()
        q = primitive.trajectory.positions(t)[:, :n]
        assert ((q >= model.lower - 1e-6) & (q <= model.upper + 1e-6)).all()


def test_it_is_ranked(cell: Cell) -> None:
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    assessment = RankJob(FixedCount(5), cell=cell, world=cell.initial_world).assess(candidate)
    assert assessment.feasible
    assert assessment.q_avg is not None


def test_more_positions_of_a_seventh_axis_are_tried_where_few_do_not_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A box hangs where the forearm is in each of the first eight."""
    box = {"type": "box", "size": [0.06, 0.18, 0.17], "pose": {"position": [0.24, 0.11, 0.36]}, "fixed": True}
    cell = make_cell(ARMS["panda"], tmp_path, box=box)
    (candidate,) = read_task("pickup lift=0.05", cell.workspace).candidates
    motion = feasible_motion(cell, candidate, cell.initial_world)
    assert isinstance(motion, Motion)
    independent = IndependentArm(cell, ARMS["panda"])
    for index in range(len(motion.primitives)):
        found = independent.contacts(motion, index, 0.9 * CLEARANCE, 0.01)
        assert not any("box" in names for names in found)
    monkeypatch.setattr(inverse_kinematics, "MORE_REDUNDANCY_SAMPLES", inverse_kinematics.REDUNDANCY_SAMPLES)
    few = feasible_motion(cell, candidate, cell.initial_world)
    assert isinstance(few, Infeasible)
    assert " hits box " in few.reasons[0]
