"""Objects of scenes, worlds, meshes and URDFs stand in a cell where their files put them, as large as these are."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.edits import with_pose
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import inverse
from sqrp_cli.shapes import Box, Cylinder, Mesh, Sphere
from tests.cells import FILES


@pytest.fixture
def files(cell: Path) -> Path:
    """The files of tests/cases/files in a folder of the cell, of packages as well."""
    return Path(shutil.copytree(FILES, cell / "files"))


def loaded(files: Path, name: str, pose: str = "{}") -> Workspace:
    """The cell with one of its files as fixtures."""
    file = files.parent / "workspace.yaml"
    entry = f"fixtures: [{{file: files/{name}, pose: {pose}}}]\nobjects:"
    content = re.sub("^objects:", entry, file.read_text(), count=1, flags=re.MULTILINE)
    file.write_text(content.replace("  base:", "  package_roots: [files]\n  base:", 1))
    return load_workspace(files.parent)


def test_a_scene_has_its_objects_where_it_puts_them(files):
    objects = loaded(files, "shelf.scene", "{position: [0, 0, 5]}").objects
    shelf, ball = objects["shelf"], objects["ball_1"]
    assert [type(part.shape) for part in (*shelf.parts, *ball.parts)] == [Box, Cylinder, Sphere]
    np.testing.assert_allclose((shelf.X_WO @ shelf.parts[1].X_PG)[:3, 3], [1, 0, 5.25])
    assert (shelf.fixed, shelf.type, shelf.size) == (True, "obstacle", pytest.approx((0.4, 0.6, 0.51)))
    np.testing.assert_allclose(ball.X_WO[:3, 3], [2, 0, 6])


def test_a_scene_of_newer_versions_has_poses_of_objects(files):
    workspace = loaded(files, "poses.scene")
    shelf, wedge = workspace.objects["shelf"], workspace.objects["wedge"]
    np.testing.assert_allclose((shelf.X_WO @ shelf.parts[0].X_PG)[:3, 3], [1, 2.1, 3], atol=1e-6)
    assert wedge.size == pytest.approx((1, 2, 4))
    np.testing.assert_allclose(wedge.X_WO[:3, 3], [5.5, 1, 2])
    (warning,) = [warning for warning in workspace.warnings if warning.code == "fixture-simplified"]
    assert "mesh of `wedge` is taken as the box around it" in warning.message


def test_a_world_in_sdf_has_the_shapes_of_its_models(files):
    (files / "door").rename(files / "elsewhere")
    workspace = loaded(files, "hall.sdf")
    bench = workspace.objects["bench"]
    assert "ground" not in workspace.objects
    top, leg = (bench.X_WO @ part.X_PG for part in bench.parts)
    np.testing.assert_allclose(top[:3, 3], [3, 0.5, 0.72], atol=1e-12)
    np.testing.assert_allclose(leg[:3, 3], [3, 0, 0], atol=1e-12)
    assert any("`model://door` is left out" in warning.message for warning in workspace.warnings)


def test_models_that_a_world_includes_stand_where_it_puts_them(files):
    exit_too = "<include><name>exit</name><uri>model://door</uri><pose>1 0 0 0 0 0</pose></include></world>"
    (files / "hall.sdf").write_text((files / "hall.sdf").read_text().replace("</world>", exit_too))
    workspace = loaded(files, "hall.sdf")
    for name, at in (("door", [9, 9, 9]), ("exit", [1, 0, 0])):
        obj = workspace.objects[name]
        panel, handle = ((obj.X_WO @ part.X_PG)[:3, 3] for part in obj.parts)
        np.testing.assert_allclose(panel, np.add(at, [0, 0, 1]), atol=1e-12)
        np.testing.assert_allclose(handle, np.add(at, [0.4, 0, 1]), atol=1e-12)
    shutil.copy(files / "door" / "model.sdf", files / "handle" / "model.sdf")
    with pytest.raises(InputError, match="`model://handle` includes itself"):
        load_workspace(files.parent)


def test_a_world_of_mujoco_is_as_mujoco_itself_has_it(files):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(files / "hall.xml"))
    massless = (files / "hall.xml").read_text().replace("<freejoint/><geom", '<freejoint/><geom mass="0"')
    (files / "hall.xml").write_text(massless)  # which MuJoCo alone refuses
    workspace = loaded(files, "hall.xml")
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
    assert any("bodies that can move are left out" in warning.message for warning in workspace.warnings)
    assert any(isinstance(part.shape, Mesh) for part in workspace.objects["bench"].parts)


def test_names_that_are_taken_are_numbered(files):
    scene = files / "shelf.scene"
    scene.write_text(scene.read_text().replace("* shelf", "* table"))
    assert "table_2" in loaded(files, "shelf.scene").objects


def with_entry(cell: Path, entry: str) -> Path:
    for name in ("bench.urdf", "corner.obj"):
        shutil.copy(FILES / name, cell)
    file = cell / "workspace.yaml"
    file.write_text(re.sub(r"^objects:.*$", f"objects:\n  new: {entry}", file.read_text(), count=1, flags=re.MULTILINE))
    return cell


def new(cell: Path, entry: str) -> SceneObject:
    return load_workspace(with_entry(cell, entry)).objects["new"]


def test_a_urdf_stands_where_its_root_is_put(cell):
    bench = new(cell, "{type: bench, urdf: bench.urdf, fixed: true, pose: {position: [5, 0, 1], rpy: [0, 0, 90 deg]}}")
    assert bench.size == pytest.approx((1.2, 0.8, 0.74))
    np.testing.assert_allclose(bench.X_WO[:3, 3], [5, 0.1, 1.37], atol=1e-12)
    assert [part.name for part in bench.parts] == ["new/top", "new/leg"]
    leg = bench.X_WO @ bench.parts[1].X_PG
    np.testing.assert_allclose(leg[:3, 3], [5, 0.1, 1.35], atol=1e-12)


def test_a_mesh_without_a_size_has_its_own(cell):
    part = new(cell, "{type: part, parts: [{mesh: corner.obj, scale: 0.1}], pose: {position: [4, 4, 4]}}")
    assert part.size == pytest.approx((0.2, 0.1, 0.3))
    np.testing.assert_allclose(part.X_WO[:3, 3], [4.1, 4.05, 4.15])
    np.testing.assert_allclose((part.X_WO @ part.parts[0].X_PG)[:3, 3], [4, 4, 4])


def test_a_stated_size_leaves_the_mesh_where_it_is(cell):
    parts = "parts: [{mesh: corner.obj, scale: 0.1}]"
    part = new(cell, f"{{type: part, size: [1, 1, 1], {parts}, pose: {{position: [4, 4, 4]}}}}")
    np.testing.assert_allclose(part.X_WO[:3, 3], [4, 4, 4])
    np.testing.assert_allclose(part.parts[0].X_PG, np.eye(4))


def test_a_moved_object_is_written_as_its_file_states_it(cell):
    part = new(cell, "{type: part, parts: [{mesh: corner.obj}], pose: {position: [4, 4, 4]}}")
    moved = part.X_WO.copy()
    moved[:3, 3] += [1, 0, 0]
    text = with_pose(
        read_workspace_document(cell / "workspace.yaml"), ("objects", "new", "pose"), moved @ inverse(part.X_FO)
    )
    assert "position: [5, 4, 4]" in text.decode()


@pytest.mark.parametrize(("entry", "said"), [
        ("{type: part, pose: unknown}", "`objects.new` lacks the key `size`"),
        ("{type: part, urdf: bensh.urdf, pose: unknown}", "did you mean `bench.urdf`"),
        ("{type: part, parts: [{mesh: part.step}], pose: unknown}", "found a mesh with the ending `.step`"),
])  # fmt: skip
def test_what_has_no_size_is_named(cell, entry, said):
    (cell / "part.step").write_text("ISO-10303-21;")
    with pytest.raises(InputError) as caught:
        load_workspace(with_entry(cell, entry))
    (problem,) = [problem for problem in caught.value.problems if said in problem.message]
    assert ".step" not in said or "gmsh part.step" in (problem.mend or "")
