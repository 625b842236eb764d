"""How the simulated arm moves, and how its tools hold."""

from __future__ import annotations

import re
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import Array, inverse, pose, transform
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.run.cell.mujoco_model import _slices, mujoco
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.shapes import Mesh
from sqrp_cli.sight.solids import load_solid
from tests.cells import ROOT
from tests.run.cell.scenes import TABLE, Quintic, Rest, camera, cell, thing, workspace, world
from tests.task.robots import REAL_ARMS, ROBOTS, robot


def at_pose(base: Workspace, X_WT: Array) -> dict[str, float]:
    """Joint positions of the arm that bring the tool frame to a pose: those nearest to home."""
    model = RobotModel.load(base.robot)
    found = all_solutions(model, X_WT)
    best = min(found, key=lambda q: float(np.abs(q - model.home).max()))
    return dict(zip(model.arm, best.tolist(), strict=True))


def above(position: Sequence[float]) -> Array:
    """A pose of the tool frame that points down at a position."""
    return pose(np.diag([1.0, -1.0, -1.0]), position)


CUBE_TOP = (0.4, 0.1, 0.04)
CUBE = thing("cube", (0.4, 0.1, 0.02))


def suction_cell(*things: SceneObject) -> Workspace:
    """The tabletop's robot with a cube before it."""
    return cell(workspace("workspaces/tabletop"), [TABLE, CUBE, *things])


def started(base: Workspace, X_WT: Array) -> tuple[SimulatedCell, dict[str, float]]:
    """SimulatedCell with the tool at a pose, and the joint positions."""
    q = at_pose(base, X_WT)
    return SimulatedCell(base, world(base, q)), q


def torques(physics: SimulatedCell) -> Array:
    """What each motor gave in the last time step [Nm or N]."""
    model = physics.model
    return physics._data.qfrc_actuator[model.jnt_dofadr[model.actuator_trnid[:, 0]]]


def test_the_arm_follows_a_fast_motion_within_a_tenth_of_a_millimetre() -> None:
    base = workspace("workspaces/tabletop")
    physics = SimulatedCell(base, world(base))
    home = dict(base.robot.home)
    there = {name: value + 1.2 * (-1) ** k for k, (name, value) in enumerate(home.items())}
    physics.advance(2.5, Quintic(home, there, 0.2, 2.0))  # up to 1.1 rad/s, 1.7 rad/s^2
    assert physics.truth().tracking < 1e-4
    assert physics.measured_joints() == pytest.approx(there, abs=1e-4)


def test_torque_stays_within_the_effort_that_the_urdf_states() -> None:
    """A jump of the reference by 1 rad asks for thousands of newton metres."""
    base = workspace("workspaces/tabletop")
    physics = SimulatedCell(base, world(base))
    away = {name: value + 1.0 for name, value in base.robot.home.items()}
    effort = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
    for k in range(1, 30):
        physics.advance(0.01 * k, Rest(away))
        assert (np.abs(torques(physics)) <= effort + 1e-9).all()
    assert (np.abs(torques(physics)) >= 0.9 * effort).any()


def test_suction_holds_only_what_it_touches() -> None:
    physics, _ = started(suction_cell(), above((0.4, 0.1, 0.05)))
    physics.grasp()
    assert physics.held() is None
    touching, _ = started(suction_cell(), above((0.4, 0.1, 0.0405)))
    touching.misses_next_grasp = True
    touching.grasp()
    assert touching.held() is None
    touching.grasp()
    assert touching.held() == "cube"


def test_suction_carries_a_thing_rigidly_and_loses_it_for_good() -> None:
    base = suction_cell()
    physics, q = started(base, above(CUBE_TOP))
    model = RobotModel.load(base.robot)
    assert physics.tool_pose() == pytest.approx(model.tool_pose(np.array([q[name] for name in model.arm])), abs=1e-9)
    physics.advance(0.2, Rest(q))
    physics.grasp()
    X_TO = inverse(physics.tool_pose()) @ physics.truth().X_WO["cube"]
    lifted = at_pose(base, above((0.45, 0.05, 0.19)))
    physics.advance(1.5, Quintic(q, lifted, 0.2, 1.2))
    now = inverse(physics.tool_pose()) @ physics.truth().X_WO["cube"]
    assert now[:3, 3] == pytest.approx(X_TO[:3, 3], abs=3e-4)
    assert now[:3, :3] == pytest.approx(X_TO[:3, :3], abs=3e-3)
    before = physics.truth().X_WO["cube"][2, 3]
    physics.slip()
    assert physics.held() is None
    physics.advance(1.5 + 0.1, Rest(lifted))
    assert before - physics.truth().X_WO["cube"][2, 3] == pytest.approx(9.81 / 2 * 0.1**2, rel=0.05)
    physics.advance(2.5, Rest(lifted))
    assert physics.truth().X_WO["cube"][2, 3] == pytest.approx(0.02, abs=5e-4)


def test_the_arm_knows_the_weight_that_it_holds() -> None:
    """A block of 4 kg at arm's length would else pull the tool down by millimetres."""
    block = thing("cube", (0.4, 0.1, 0.1), (0.2, 0.2, 0.2))
    base = cell(workspace("workspaces/tabletop"), [TABLE, block])
    physics, q = started(base, above((0.4, 0.1, 0.2)))
    physics.grasp()
    lifted = at_pose(base, above((0.4, 0.1, 0.3)))
    physics.advance(2.0, Quintic(q, lifted, 0.0, 1.5))
    assert physics.tool_pose()[:3, 3] == pytest.approx([0.4, 0.1, 0.3], abs=5e-4)


def test_a_cell_may_begin_with_something_in_the_tool() -> None:
    base, X_WT, X_TO = suction_cell(), above((0.3, 0.2, 0.3)), pose(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 0.02))
    q = at_pose(base, X_WT)
    start = world(base, q)
    elsewhere = {name: X for name, X in start.X_WO.items() if name != "cube"}
    physics = SimulatedCell(base, replace(start, X_WO=elsewhere, held="cube", X_TO=X_TO))
    physics.advance(1.0, Rest(q))
    assert physics.held() == "cube"
    assert physics.truth().X_WO["cube"] == pytest.approx(X_WT @ X_TO, abs=5e-4)


def test_the_same_calls_give_the_same_bytes_also_in_a_cell_that_is_reset() -> None:
    base = suction_cell()
    q, frames, positions = at_pose(base, above(CUBE_TOP)), [], []
    start, seen = world(base, q), cell(base, list(base.objects.values()), [camera()])
    for _ in range(2):
        with SimulatedCell(seen, start, 3) as simulated:
            for _ in range(2):
                simulated.grasp()
                simulated.advance(0.3, Rest(q))
                simulated.slip()
                simulated.advance(0.4, Rest(q))
                frames.append(simulated.frames(["cam"])["cam"])
                positions.append(simulated.positions.tobytes())
                assert simulated.truth().tracking < 1e-3
                simulated.reset(start)
                assert (simulated.t, simulated.truth().held) == (0.0, None)
    assert len(set(positions)) == 1
    assert len({(frame.t, frame.image.tobytes()) for frame in frames}) == 1


@pytest.mark.usefixtures("heeded_ctrl_c")
def test_ctrl_c_inside_a_call_of_mujoco_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bindings convert arguments in Python, and make a TypeError of what is raised there."""
    base = suction_cell()
    q = at_pose(base, above(CUBE_TOP))
    real = mujoco.mj_step1

    def step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise TypeError("incompatible function arguments") from None
        real(model, data)

    with SimulatedCell(cell(base, list(base.objects.values()), [camera()]), world(base, q), 3) as simulated:
        monkeypatch.setattr(mujoco, "mj_step1", step)
        with pytest.raises(KeyboardInterrupt):
            simulated.advance(0.01, Rest(q))
        assert simulated.t == pytest.approx(0.01)


def gripper_cell(*things: SceneObject) -> Workspace:
    return cell(workspace("tests/cases/gripper"), [TABLE, CUBE, *things])


OPEN, TOUCHING = {"left_finger_joint": 0.04}, {"left_finger_joint": 0.0201}


def grasped(base: Workspace) -> tuple[SimulatedCell, dict[str, float]]:
    """The gripper around the cube, closed with a force."""
    arm = at_pose(base, above((0.4, 0.1, 0.02)))
    physics = SimulatedCell(base, world(base, arm | OPEN))
    physics.advance(1.0, Quintic(arm | OPEN, arm | TOUCHING, 0.0, 0.8))
    assert physics.held() is None
    physics.grasp()
    physics.advance(1.3, Rest(arm | TOUCHING))
    return physics, arm | TOUCHING


def fingers(physics: SimulatedCell) -> list[float]:
    return [physics.measured_joints()[f"{side}_finger_joint"] for side in ("left", "right")]


def test_fingers_hold_by_friction_while_the_arm_moves_and_let_go() -> None:
    base = gripper_cell()
    physics, q = grasped(base)
    assert physics.held() == "cube"
    X_TO = inverse(physics.tool_pose()) @ physics.truth().X_WO["cube"]
    lifted = q | at_pose(base, above((0.42, 0.05, 0.2)))
    physics.advance(4.0, Quintic(q, lifted, 1.3, 1.2))
    now = inverse(physics.tool_pose()) @ physics.truth().X_WO["cube"]
    assert physics.held() == "cube"
    assert now[:3, 3] == pytest.approx(X_TO[:3, 3], abs=1e-3)
    physics.release()
    physics.advance(4.7, Quintic(lifted, lifted | OPEN, 4.0, 0.5))  # released fingers follow the reference
    assert physics.held() is None
    assert fingers(physics) == pytest.approx([0.04, 0.04], abs=5e-4)


def test_a_jaw_that_moves_alone_holds_against_the_one_that_stands_still(tmp_path: Path) -> None:
    robots = ROOT / "workspaces" / "robots"
    still = re.sub(
        r'<joint name="right_finger_joint" type="prismatic">\s*<origin xyz="0 0 0.05"/>(.*?)<axis.*?</joint>',
        r'<joint name="right_finger_joint" type="fixed"><origin xyz="0 -0.0202 0.05"/>\1</joint>',
        (robots / "two_finger_gripper.urdf").read_text(),
        flags=re.DOTALL,
    )
    (tmp_path / "jaw.urdf").write_text(still)
    text = (ROOT / "tests" / "cases" / "gripper" / "workspace.yaml").read_text()
    text = text.replace("../../../workspaces/robots/two_finger_gripper.urdf", str(tmp_path / "jaw.urdf"))
    stated = load_workspace(ROOT / "tests" / "cases" / "gripper" / "workspace.yaml", text.encode())
    base = cell(stated, [TABLE, CUBE])
    physics, q = grasped(base)
    physics.advance(1.6, Rest(q))
    assert physics.held() == "cube"
    physics.advance(2.8, Quintic(q, q | at_pose(base, above((0.4, 0.1, 0.12))), 1.6, 1.0))
    assert physics.held() == "cube"
    assert physics.truth().X_WO["cube"][2, 3] == pytest.approx(0.12, abs=2e-3)
    physics.slip()
    assert physics.held() is None


def test_fingers_close_from_afar_at_five_centimetres_per_second() -> None:
    base = gripper_cell()
    arm = at_pose(base, above((0.4, 0.1, 0.02)))
    physics = SimulatedCell(base, world(base, arm | OPEN))
    physics.grasp()
    for k in range(1, 7):
        physics.advance(0.05 * k, Rest(arm | OPEN))
        assert physics.held() is None
        assert fingers(physics)[0] > 0.04 - 0.05 * 0.05 * k
    physics.advance(0.6, Rest(arm | OPEN))
    assert physics.held() == "cube"
    assert fingers(physics)[0] == pytest.approx(0.02, abs=5e-4)


def test_what_slips_out_of_fingers_falls_and_they_close() -> None:
    base = gripper_cell()
    physics, q = grasped(base)
    lifted = q | at_pose(base, above((0.4, 0.1, 0.12)))
    physics.advance(2.5, Quintic(q, lifted, 1.3, 1.0))
    physics.slip()
    assert physics.held() is None
    physics.advance(3.5, Rest(lifted))
    assert physics.truth().X_WO["cube"][2, 3] == pytest.approx(0.02, abs=1e-3)
    assert fingers(physics) == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("name", REAL_ARMS)
def test_real_arms_stand_where_they_are_told_to(name: str) -> None:
    path, tool_frame = REAL_ARMS[name]
    arm = robot(ROBOTS / path, tool_frame)
    base = replace(cell(workspace("workspaces/tabletop"), []), robot=arm)
    physics = SimulatedCell(base, World(frozenset(), {}, None, None, {}))
    start = physics.measured_joints()
    physics.advance(0.5, Rest({name: start[name] for name in RobotModel.load(arm).arm}))
    assert physics.measured_joints() == pytest.approx(start, abs=1e-3)


LED = ("led", "arm", {"motor": 0.2}, {"motor": 1.0}, {"motor": 1.0, "elbow": -0.4})
BARE = ("bare", "tip", {"one": 0.0, "two": 0.1}, {"one": 1.0, "two": 0.4}, {"one": 1.0, "two": 0.4})


@pytest.mark.parametrize(("name", "tip", "start", "wanted", "ends", "effort"), [(*LED, None), (*LED, 5), (*BARE, None)])
def test_an_arm_moves_whatever_its_file_says_of_inertia_and_effort(
    tmp_path: Path, name: str, tip: str, start: dict, wanted: dict, ends: dict, effort: int | None
) -> None:
    """Holding the led arm takes 31 Nm: where its motors could not, it is balanced, and 5 Nm are left beyond that."""
    text, limit = (Path(__file__).parent / f"{name}.urdf").read_text(), "" if effort is None else f' effort="{effort}"'
    (tmp_path / "arm.urdf").write_text(text.replace('upper="2"/>', f'upper="2"{limit}/>'))
    base = replace(cell(workspace("workspaces/tabletop"), []), robot=robot(tmp_path / "arm.urdf", tip))
    physics = SimulatedCell(base, World(frozenset(), {}, None, None, start))
    physics.advance(2.5, Quintic(start, wanted, 0.0, 2.0))
    assert physics.measured_joints() == pytest.approx(ends, abs=1e-3)
    assert effort is None or np.abs(torques(physics)).max() < 31.4 / 2 + effort


def test_a_mesh_of_a_hand_keeps_its_hollow_and_all_its_corners(tmp_path: Path) -> None:
    """An L of two bars: its slices fill what it fills, where its hull would be a third larger."""
    bars = [trimesh.creation.box(size) for size in ((0.02, 0.06, 0.02), (0.02, 0.02, 0.1))]
    bars[1].apply_translation((0.0, -0.02, 0.06))
    shape = trimesh.util.concatenate(bars)
    shape.export(tmp_path / "l.stl")
    hulls = [trimesh.convex.convex_hull(corners) for corners in _slices(Mesh(tmp_path / "l.stl", (1.0, 1.0, 1.0)))]
    assert sum(hull.volume for hull in hulls) == pytest.approx(sum(bar.volume for bar in bars), rel=0.15)
    assert shape.convex_hull.volume > 1.3 * sum(hull.volume for hull in hulls)
    found = np.concatenate([hull.vertices for hull in hulls])
    assert np.linalg.norm(shape.vertices[:, None] - found, axis=2).min(axis=1).max() < 1e-5


def test_meshes_are_as_large_as_the_planner_takes_them() -> None:
    for part in RobotModel.load(replace(workspace("workspaces/tabletop").robot, geometry="visual")).parts:
        if isinstance(part.shape, Mesh):
            scaled = replace(part.shape, scale=(0.5, 1.0, -2.0))
            for mesh in (part.shape, scaled):
                solid = load_solid(replace(part, shape=mesh))
                vertices = transform(part.X_PG, read_mesh(mesh.path, mesh.scale).vertices)
                assert vertices.min(axis=0) == pytest.approx(solid.vertices.min(axis=0), abs=1e-6)
                assert vertices.max(axis=0) == pytest.approx(solid.vertices.max(axis=0), abs=1e-6)
