"""Robots of MuJoCo: each stands where MuJoCo itself puts it, with the limits, followers and shapes that it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.files.packages import package_roots
from sqrp_cli.geometry import pose, quaternion_to_matrix, transform
from sqrp_cli.robot.kinematics import JointTree
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.urdf import UrdfModel
from tests.cells import read_cases
from tests.task.robots import REAL_ARMS, ROBOTS, robot

CASES = read_cases("mjcf.yaml")


def links_where_mujoco_says(path: Path, held: Mapping[str, float]) -> tuple[UrdfModel, int]:
    """Compares poses at random positions within limits, with a model of MuJoCo without shapes; of how many links.

    held: positions of joints that stand still, where it is not that of the model's `qpos0`.
    """
    urdf, spec = read_urdf(path), mujoco.MjSpec.from_file(str(path))
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-3
    for kind in ("geoms", "meshes", "materials", "textures", "hfields", "skins", "pairs", "sensors", "keys"):
        for one in getattr(spec, kind):
            spec.delete(one)
    for site in spec.sites:
        site.material = ""
    model = spec.compile()
    data, plain = mujoco.MjData(model), robot(ROBOTS / REAL_ARMS["ur5"][0], REAL_ARMS["ur5"][1])
    tree = JointTree.of(replace(plain, urdf=urdf, tool=None, X_WB=np.eye(4)))
    driven = [index for index, joint in enumerate(tree.joints) if joint.mimic is None]
    limits = np.clip([[tree.joints[index].lower, tree.joints[index].upper] for index in driven], -3.0, 3.0).T
    positions = tree.driven_by(driven, {}).positions(np.random.default_rng(0).uniform(*limits, (4, len(driven))))
    X_WL, names = tree.link_poses(positions), {model.body(index).name for index in range(1, model.nbody)}
    for row, values in enumerate(positions):
        data.qpos[:] = model.qpos0
        at = dict(zip((joint.name for joint in tree.joints), values, strict=True)) | held
        for name, value in at.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco.mj_forward(model, data)
        placed = {
            name: pose(data.body(name).xmat.reshape(3, 3), data.body(name).xpos) for name in names if name in X_WL
        }
        for name, X in placed.items():
            found = placed.get(urdf.root, np.eye(4)) @ X_WL[name][row]
            np.testing.assert_allclose(found, X, atol=1e-9, err_msg=f"{path} {name}")
    return urdf, len(placed)


@pytest.mark.parametrize("name", CASES)
def test_each_part_of_the_format_has_its_joints_and_stands_where_mujoco_says(tmp_path: Path, name: str) -> None:
    case, path = CASES[name], tmp_path / "arm.xml"
    path.write_text(case["mjcf"])
    urdf, compared = links_where_mujoco_says(path, case.get("held", {}))
    assert compared == len([link for link in urdf.links if "/" not in link and link not in case.get("sites", [])])
    assert {*urdf.links} == {*case["links"], *case.get("sites", [])}
    assert [joint.name for joint in urdf.movable_joints] == [*case["joints"]]
    for joint in urdf.movable_joints:
        follows = [joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset] if joint.mimic else []
        stated = [one if isinstance(one, str) else pytest.approx(one, abs=1e-4) for one in case["joints"][joint.name]]
        assert stated == [joint.type, joint.lower, joint.upper, *follows]
        assert joint.effort == case.get("efforts", {}).get(joint.name)
    said = " ".join(warning.message for warning in urdf.warnings)
    assert [text for text in case.get("says", []) if text not in said] == []
    assert bool(urdf.warnings) == ("says" in case)


def test_every_installed_robot_of_mujoco_stands_where_mujoco_says() -> None:
    (assets,) = (
        root / "robosuite_models" / "assets" for root in package_roots() if (root / "robosuite_models").is_dir()
    )
    files = [*assets.glob("robots/*/robot.xml"), *assets.glob("grippers/*.xml")]
    compared = {file: links_where_mujoco_says(file, {})[1] for file in files}
    assert len(compared) >= 20
    assert min(compared.values()) >= 4


def test_meshes_lie_where_mujoco_has_them_and_their_bodies_weigh_as_much(tmp_path: Path) -> None:
    """MuJoCo moves the corners of a mesh into a frame of its own; the file has them elsewhere."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "wedge.obj").write_text(
        "v 0 0 0\nv 30 0 0\nv 0 20 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    path, turned = tmp_path / "arm.xml", 'refpos="1 2 3" refquat="0.8 0.6 0 0"'
    path.write_text(
        f'<mujoco><compiler meshdir="meshes"/><asset><mesh name="w" file="wedge.obj" scale="1e-2 1e-2 1e-2" {turned}/>'
        '<mesh name="m" file="wedge.obj" scale="1e-2 -2e-2 3e-2"/></asset><worldbody><body name="base"><body name="a">'
        '<joint axis="0 0 1"/><inertial pos="0 0 0.1" quat="0.8 0 0.6 0" mass="2" diaginertia="0.3 0.2 0.15"/>'
        '<geom name="w" type="mesh" mesh="w" pos="1 2 3" euler="10 20 30" contype="0" conaffinity="0" group="1"/>'
        '<geom name="m" type="mesh" mesh="m" pos="0 0 1" group="3"/></body></body></worldbody></mujoco>'
    )
    model, link = mujoco.MjModel.from_xml_path(str(path)), read_urdf(path).links["a"]
    assert ([one.name for one in link.visual], [one.name for one in link.collision]) == (["w"], ["m"])
    for piece in (*link.visual, *link.collision):
        geom = model.geom(piece.name)
        first, count = (int(of[geom.dataid[0]]) for of in (model.mesh_vertadr, model.mesh_vertnum))
        X_BG = pose(quaternion_to_matrix(np.roll(geom.quat, -1)), geom.pos)
        theirs = transform(X_BG, model.mesh_vert[first : first + count].astype(float))
        ours = transform(piece.X_LG, read_mesh(tmp_path / piece.shape[0], piece.shape[1]).vertices)
        for corner in theirs:
            assert np.linalg.norm(ours - corner, axis=1).min() < 1e-6
    R, inertial = quaternion_to_matrix([0.0, 0.6, 0.0, 0.8]), link.inertial
    assert (inertial.mass, inertial.X_LI[2, 3]) == (2.0, 0.1)
    np.testing.assert_allclose(inertial.inertia, R @ np.diag([0.3, 0.2, 0.15]) @ R.T, atol=1e-9)
