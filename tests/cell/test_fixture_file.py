"""Scenes of MoveIt and worlds in SDF and MJCF stand in a cell where their files put them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.fixture_file import read_fixtures
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.shapes import Box, Cylinder, Mesh, Sphere
from tests.cells import refused

OLD = """(a scene)+
* shelf
2
box
0.4 0.6 0.02
1 0 0.5
0 0 0 1
0 0 0 0
cylinder
0.05 0.5
1 0 0.25
0 0 0 1
0 0 0 0
* ball 1
1
sphere
0.1
2 0 1
0 0 0 1
0.5 0.5 0.5 1
.
"""

NEW = """(a scene)
* shelf
1 2 3
0 0 0.7071068 0.7071068
1
box
0.4 0.6 0.02
0.1 0 0
0 0 0 1
0 0 0 0
1
handle
0 0 0
0 0 0 1
* wedge
0 0 0
0 0 0 1
1
mesh
3 1
0 0 0
1 0 0
0 2 4
0 1 2
5 0 0
0 0 0 1
0 0 0 0
0
.
"""

SDF = """<?xml version="1.0"?>
<sdf version="1.9"><world name="hall">
  <model name="ground"><link name="l"><collision name="c"><geometry><plane><normal>0 0 1</normal></plane></geometry>
  </collision></link></model>
  <model name="bench"><pose>3 0 0 0 0 1.5707963267948966</pose>
    <link name="top"><pose>0.5 0 0.7 0 0 0</pose>
      <collision name="c"><pose>0 0 0.02 0 0 0</pose><geometry><box><size>1 0.5 0.04</size></box></geometry></collision>
      <visual name="v"><geometry><sphere><radius>9</radius></sphere></geometry></visual>
    </link>
    <link name="leg"><collision name="c"><geometry><mesh>
      <uri>model://things/leg.obj</uri><scale>0.1 0.1 0.1</scale></mesh>
    </geometry></collision></link>
  </model>
  <include><uri>model://door</uri></include>
</world></sdf>
"""

MJCF = """<mujoco>
  <compiler eulerseq="XYz" meshdir="things"/>
  <default><geom size="0.1 0.2 0.3"/><default class="post"><geom type="capsule" size="0.05 0.4"/></default></default>
  <asset><mesh name="leg" file="leg.obj" scale="0.1 0.1 0.1"/></asset>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <geom type="box" pos="1 2 3" euler="10 20 30"/>
    <body name="bench" pos="3 0 0" axisangle="1 1 0 50" childclass="post">
      <geom pos="0 0 1" quat="0.5 0.5 -0.5 0.5"/>
      <geom fromto="0 0 0 0.3 0.4 0.5" type="cylinder" size="0.02"/>
      <geom type="mesh" mesh="leg" pos="0 0 -1"/>
      <frame pos="0 1 0" euler="0 0 40"><geom type="sphere" size="0.3" pos="1 0 0"/></frame>
      <body pos="0 0 2" quat="1 1 0 0">
        <geom type="box" size="1 2 3" pos="0.1 0 0"/><geom class="main" type="box" pos="0 9 0"/>
      </body>
    </body>
    <body name="ball" pos="0 0 9"><freejoint/><geom size="0.1"/></body>
    <geom type="box" pos="7 0 0" xyaxes="1 2 0 -1 1 3"/>
    <geom type="box" pos="8 0 0" zaxis="1 2 -3"/>
    <geom type="box" pos="9 0 0" zaxis="0 0 -1"/>
    <include file="things/more.xml"/>
  </worldbody>
</mujoco>
"""

MORE = """<mujocoinclude>
  <body name="shelf" pos="0 8 0"><geom type="box" class="post" size="0.1 0.2 0.3" euler="0 0 10"/></body>
</mujocoinclude>
"""

DOOR = """<sdf version="1.9"><model name="door"><pose>9 9 9 0 0 0</pose><link name="l">
  <collision name="c"><pose>0 0 1 0 0 0</pose><geometry><box><size>1 0.1 2</size></box></geometry></collision>
</link><include><uri>model://handle</uri><pose>0.4 0 1 0 0 0</pose></include></model></sdf>
"""
HANDLE = """<sdf version="1.9"><model name="handle"><link name="l">
  <collision name="c"><geometry><sphere><radius>0.03</radius></sphere></geometry></collision></link></model></sdf>
"""

LEG = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def loaded(cell: Path, name: str, text: str, pose: str = "{}") -> Workspace:
    (cell / "things").mkdir(exist_ok=True)
    (cell / "things" / "leg.obj").write_text(LEG)
    (cell / "things" / "more.xml").write_text(MORE)
    (cell / name).write_text(text)
    file = cell / "workspace.yaml"
    entry = f"fixtures: [{{file: {name}, pose: {pose}}}]\nobjects:"
    content = re.sub("^objects:", entry, file.read_text(), count=1, flags=re.MULTILINE)
    file.write_text(content.replace("  base:", "  package_roots: [.]\n  base:", 1))
    return load_workspace(cell)


def test_a_scene_has_its_objects_where_it_puts_them(cell: Path) -> None:
    objects = loaded(cell, "shelf.scene", OLD, "{position: [0, 0, 5]}").objects
    shelf, ball = objects["shelf"], objects["ball_1"]
    assert [type(part.shape) for part in (*shelf.parts, *ball.parts)] == [Box, Cylinder, Sphere]
    assert shelf.X_WO is not None
    np.testing.assert_allclose((shelf.X_WO @ shelf.parts[1].X_PG)[:3, 3], [1, 0, 5.25])
    assert (shelf.fixed, shelf.type, shelf.size) == (True, "obstacle", pytest.approx((0.4, 0.6, 0.51)))
    np.testing.assert_allclose(ball.X_WO[:3, 3], [2, 0, 6])


def test_a_scene_of_newer_versions_has_poses_of_objects(cell: Path) -> None:
    workspace = loaded(cell, "shelf.scene", NEW)
    shelf, wedge = workspace.objects["shelf"], workspace.objects["wedge"]
    assert shelf.X_WO is not None
    np.testing.assert_allclose((shelf.X_WO @ shelf.parts[0].X_PG)[:3, 3], [1, 2.1, 3], atol=1e-6)
    assert wedge.size == pytest.approx((1, 2, 4))
    np.testing.assert_allclose(wedge.X_WO[:3, 3], [5.5, 1, 2])
    (warning,) = [warning for warning in workspace.warnings if warning.code == "fixture-simplified"]
    assert "mesh of `wedge` is taken as the box around it" in warning.message


def test_a_world_in_sdf_has_the_shapes_of_its_models(cell: Path) -> None:
    workspace = loaded(cell, "hall.sdf", SDF)
    bench = workspace.objects["bench"]
    assert "ground" not in workspace.objects
    assert bench.X_WO is not None
    top, leg = (bench.X_WO @ part.X_PG for part in bench.parts)
    np.testing.assert_allclose(top[:3, 3], [3, 0.5, 0.72], atol=1e-12)
    np.testing.assert_allclose(leg[:3, 3], [3, 0, 0], atol=1e-12)
    assert any("`model://door` is left out" in warning.message for warning in workspace.warnings)


def test_models_that_a_world_includes_stand_where_it_puts_them(cell: Path) -> None:
    for name, text in (("door", DOOR), ("handle", HANDLE)):
        (cell / name).mkdir()
        (cell / name / "model.sdf").write_text(text)
    two = "<uri>model://door</uri></include><include><name>exit</name><uri>model://door</uri><pose>1 0 0 0 0 0</pose>"
    workspace = loaded(cell, "hall.sdf", SDF.replace("<uri>model://door</uri>", two))
    for name, at in (("door", [9, 9, 9]), ("exit", [1, 0, 0])):
        obj = workspace.objects[name]
        assert obj.X_WO is not None
        panel, handle = ((obj.X_WO @ part.X_PG)[:3, 3] for part in obj.parts)
        np.testing.assert_allclose(panel, np.add(at, [0, 0, 1]), atol=1e-12)
        np.testing.assert_allclose(handle, np.add(at, [0.4, 0, 1]), atol=1e-12)
    (cell / "handle" / "model.sdf").write_text(DOOR)
    with pytest.raises(InputError, match="`model://handle` includes itself"):
        load_workspace(cell)


def test_a_world_of_mujoco_is_as_mujoco_itself_has_it(cell: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    workspace = loaded(cell, "hall.xml", MJCF)
    model = mujoco.MjModel.from_xml_path(str(cell / "hall.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = {
        geom: (data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom], model.geom_type[geom])
        for geom in range(model.ngeom)
        if int(model.geom_type[geom]) not in (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_MESH))
        and model.body_dofnum[model.geom_bodyid[geom]] == 0
    }
    stands = [(obj.X_WO @ part.X_PG, part.shape) for obj in workspace.objects.values() if obj.type == "obstacle"
              for part in obj.parts if obj.X_WO is not None and not isinstance(part.shape, Mesh)]  # fmt: skip
    assert len(stands) == len(expected) == 10
    for position, rotation, sizes, kind in expected.values():
        near = [(X, shape) for X, shape in stands if np.allclose(X[:3, 3], position, atol=1e-9)]
        ((X, shape),) = near
        np.testing.assert_allclose(X[:3, 2], rotation[:, 2], atol=1e-9)
        if int(kind) == int(mujoco.mjtGeom.mjGEOM_BOX):
            np.testing.assert_allclose(X[:3, :3], rotation, atol=1e-9)
            assert isinstance(shape, Box)
            np.testing.assert_allclose(shape.size, 2 * sizes)
        else:
            assert shape.radius == pytest.approx(sizes[0])  # type: ignore[union-attr]
    assert any("can move, and is left out" in warning.message for warning in workspace.warnings)
    assert any(isinstance(part.shape, Mesh) for part in workspace.objects["bench"].parts)


def test_names_that_are_taken_are_numbered(cell: Path) -> None:
    assert "table_2" in loaded(cell, "shelf.scene", OLD.replace("* shelf", "* table")).objects


@pytest.mark.parametrize(("name", "text", "old", "new", "line", "said"), [
        ("a.scene", OLD, "cylinder\n", "cylindre\n", 9, "did you mean `cylinder`"),
        ("a.scene", OLD, "0.4 0.6 0.02", "0.4 0.6", 5, "expected 3 numbers"),
        ("a.scene", OLD, "0 0 0 1", "0 0 0 0", 7, "a quaternion of length 0"),
        ("a.scene", OLD, "* ball 1\n1\nsphere\n0.1", "* ball 1\n1", 16, "found the shape `2 0 1`"),
        ("a.scene", OLD, "0.5 0.5 0.5 1\n.\n", "", 19, "ends within an object"),
        ("a.scene", OLD, OLD, "", None, "is empty"),
        ("a.scene", OLD, OLD, "a scene\n.\n", None, "0 objects with shapes"),
        ("a.sdf", SDF, "1 0.5 0.04", "1 0.5", 7, "expected 3 numbers"),
        ("a.sdf", SDF, "<pose>0.5", '<pose relative_to="leg">0.5', 6, "relative to another frame"),
        ("a.sdf", SDF, "things/leg.obj", "things/lge.obj", 10, "did you mean `leg.obj`"),
        ("a.sdf", SDF, "</sdf>", "", None, "not well-formed"),
        ("a.xml", MJCF, 'class="main"', 'class="mian"', 14, "did you mean `main`"),
        ("a.xml", MJCF, 'mesh="leg"', 'mesh="lge"', 11, "did you mean `leg`"),
        ("a.xml", MJCF, 'size="1 2 3"', 'size="1 2"', 14, "expected 3 above 0"),
        ("a.xml", MJCF, 'zaxis="1 2 -3"', 'zaxis="0 0 0"', 19, "an axis has length 0"),
        ("a.xml", MJCF, "1 2 0 -1 1 3", "1 2 0 2 4 0", 18, "both have one direction"),
        ("a.xml", MJCF, "things/more", "things/mroe", 21, "did you mean `more.xml`"),
        ("a.xml", MJCF, "things/more.xml", "a.xml", 21, "is included twice"),
        ("a.xml", MJCF, "things/more.xml", "things/leg.obj", None, "not well-formed"),
        ("a.blend", OLD, "", "", None, "expected .scene of MoveIt"),
])  # fmt: skip
def test_a_damaged_file_has_one_good_message(cell, name, text, old, new, line, said):
    problem = refused(loaded, cell, name, text.replace(old, new, 1) if old else text)
    assert said in problem.message
    assert line is None or problem.place.line == line


@pytest.mark.parametrize("order", ["world", "xy", ""])
def test_an_order_of_angles_that_is_none_is_refused_with_its_line(tmp_path: Path, order: str) -> None:
    path = tmp_path / "world.xml"
    body = '<body><geom type="box" size="1 1 1" euler="10 20 30"/></body>'
    path.write_text(f'<mujoco>\n<compiler eulerseq="{order}"/><worldbody>{body}</worldbody></mujoco>')
    with pytest.raises(InputError, match=r"`eulerseq` is .*, expected three of the letters") as caught:
        read_fixtures(path, path.read_bytes(), (), [])
    assert caught.value.problems[0].place.line == 2
