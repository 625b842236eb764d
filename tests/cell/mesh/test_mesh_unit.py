"""Every reader of a mesh takes it in the unit that its file states, and along the axes of what it belongs to."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.checks.cell_warnings import doubtful_meshes
from sqrp_cli.errors import Place
from sqrp_cli.files.input_file import SourceFile
from sqrp_cli.geometry import Array, pose, read_only
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.run.cell.mujoco_model import build_model, mujoco
from sqrp_cli.run.robot_body import Surface
from sqrp_cli.shapes import Mesh, Part
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.candidate_page import STEP, scene_model
from sqrp_cli.sight.solids import load_solid
from tests.cells import FILES, edit, refused

CORNERS = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.06, 0], [0, 0, 0.12]])
"""Of a tetrahedron, all extents of which differ [m]."""

UNITS = {"": 1.0, '<unit meter="1"/>': 1.0, '<unit name="inch" meter="0.0254"/>': 0.0254,
         '<unit name="mm" meter="1e-3"/>': 1e-3, "<unit meter='0.01' name='cm'/>": 0.01}  # fmt: skip
UP_AXES = ("", "<up_axis>X_UP</up_axis>", "<up_axis>Y_UP</up_axis>", "<up_axis>Z_UP</up_axis>")

DAE = (FILES / "tetrahedron.dae").read_text()


def dae(path: Path, asset: str = "", unit: float = 1.0) -> Path:
    """The tetrahedron in a COLLADA file, with its numbers in a unit; a node of the scene moves it by a centimetre."""
    places = CORNERS - [0.01, 0.0, 0.0]
    numbers, shift = (" ".join(f"{value / unit:.12g}" for value in values) for values in (places.flat, (0.01, 0, 0)))
    path.write_text(DAE.format(asset=asset, numbers=numbers, shift=shift))
    return path


def spans(vertices: Array) -> Array:
    """Least and greatest coordinates, shape (2, 3)."""
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


@pytest.mark.parametrize("up", UP_AXES)
@pytest.mark.parametrize("asset", UNITS)
def test_all_readers_of_a_mesh_take_it_in_its_unit_and_along_its_axes(asset, up, tmp_path):
    mesh = Mesh(dae(tmp_path / "tetrahedron.DAE", asset + up, UNITS[asset]), (1.0, 1.0, -2.0))
    part = Part("g1/0", "g1", mesh, read_only(pose()))
    # Of sight, collision, pictures and pages; of perception; of simulation.
    for vertices in (load_solid(part).vertices, Surface.of(part).vertices, read_mesh(mesh.path, mesh.scale).vertices):
        np.testing.assert_allclose(spans(vertices), [[0, 0, -0.24], [0.03, 0.06, 0]], atol=1e-6)


def test_physics_and_pages_show_a_mesh_in_inches_as_large_as_it_is(tabletop, tmp_path):
    asset = '<unit name="inch" meter="0.0254"/>'
    g1 = tabletop.objects["g1"]
    file = dae(tmp_path / "it.dae", asset, 0.0254)
    mesh = Mesh(file)
    g1 = replace(g1, parts=(Part("g1/0", "g1", mesh, read_only(pose())),), size=(0.12, 0.12, 0.12))
    files = {**tabletop.files, "mesh": SourceFile(file, sha256(file.read_bytes()).hexdigest())}
    workspace = replace(tabletop, objects={**tabletop.objects, "g1": g1}, files=files)
    assert list(doubtful_meshes(workspace, RobotModel.load(workspace.robot))) == []

    cell = Cell.load(workspace)
    (shown,) = (part for part in ShowDocument.of(cell).opaque if part.parent == "g1")
    assert shown.scale == [0.0254] * 3
    (drawn,) = (solid for solid in scene_model(cell)["solids"] if solid["parent"] == "g1")
    np.testing.assert_allclose(spans(STEP * np.array(drawn["vertices"]).reshape(-1, 3)), spans(CORNERS), atol=STEP)

    model = build_model(workspace, {"g1": pose()})
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geoms = [geom for geom in range(model.ngeom) if model.body(model.geom_bodyid[geom]).name == "g1"]
    assert geoms
    for geom in geoms:
        first = model.mesh_vertadr[model.geom_dataid[geom]]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[geom]]]
        placed = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        np.testing.assert_allclose(spans(placed), spans(CORNERS), atol=1e-6)


def test_the_unit_of_a_mesh_that_a_workspace_names_counts(cell):
    dae(cell / "it.dae", '<unit meter="0.01"/>', 0.01)
    edit(cell, "marker: 7}", "marker: 7, parts: [{mesh: it.dae, scale: [1, 2, 1]}]}")
    (part,) = load_workspace(cell).objects["red"].parts
    np.testing.assert_allclose(spans(load_solid(part).vertices), [[0, 0, 0], [0.03, 0.12, 0.12]], atol=1e-6)


def test_the_unit_counts_for_links_as_for_objects(tmp_path):
    dae(tmp_path / "hand.dae", '<unit meter="0.001"/><up_axis>Y_UP</up_axis>', 0.001)
    urdf = tmp_path / "hand.urdf"
    geometry = '<geometry><mesh filename="hand.dae" scale="1 1 2"/></geometry>'
    urdf.write_text(f'<robot name="r"><link name="hand"><collision>{geometry}</collision></link></robot>')
    (part,) = read_urdf(urdf).parts("collision", lambda reference, of: of.parent / reference)
    np.testing.assert_allclose(spans(load_solid(part).vertices), [[0, 0, 0], [0.03, 0.06, 0.24]], atol=1e-6)


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "one", "1e9", ""])
def test_a_unit_that_is_no_length_is_refused_with_its_line(unit, tmp_path):
    path = dae(tmp_path / "it.dae", f'<unit meter="{unit}"/>')
    problem = refused(read_mesh, path)
    assert problem.place == Place(path, 2)
    assert f'`<unit meter="{unit}">`' in problem.message


def test_a_doubt_about_a_mesh_says_that_its_unit_counts_already(tabletop, tmp_path):
    mesh = Mesh(dae(tmp_path / "it.dae", '<unit meter="0.001"/>', 0.001), (0.001, 0.001, 0.001))
    g1 = replace(tabletop.objects["g1"], parts=(Part("g1/0", "g1", mesh, read_only(pose())),))
    model = RobotModel.load(tabletop.robot)
    (problem,) = doubtful_meshes(replace(tabletop, objects={"g1": g1}), model)
    assert "gives its unit as 0.001 m" in (problem.mend or "")
