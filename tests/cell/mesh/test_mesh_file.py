"""A mesh file is what it says, in its unit, for all its readers, or refused at once with the line of what is wrong."""

from __future__ import annotations

import os
import re
import shutil
import time
import tracemalloc
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from random import Random

import numpy as np
import pytest
import trimesh

from sqrp_cli.cell.mesh import mesh_unit, read_mesh
from sqrp_cli.checks.cell_warnings import doubtful_meshes
from sqrp_cli.errors import InputError, Place
from sqrp_cli.files.input_file import SourceFile
from sqrp_cli.files.packages import package_roots
from sqrp_cli.geometry import Array, pose, read_only
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.run.cell.mujoco_model import build_model, mujoco
from sqrp_cli.run.robot_body import Surface
from sqrp_cli.shapes import Mesh, Part, Triangles
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.candidate_page import STEP, scene_model
from sqrp_cli.sight.solids import load_solid
from tests.cell.mesh.mesh_bombs import bombs, dae, obj, sound_meshes, text_stl
from tests.cells import FILES, edit, refusal, refused
from tests.damage.mutations import damage

BOMBS = bombs()
SOUND = sound_meshes()
TRIANGLES = {"polygon.obj": 15, "continued.obj": 13, "doubled.dae": 24}
"""Where they are not the 12 of a cube."""


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", BOMBS)
def test_a_mesh_that_contradicts_itself_is_refused_with_what_is_wrong(name, tmp_path):
    content, says = BOMBS[name]
    path = write(tmp_path / f"mesh.{name[:3]}", content)
    before = time.process_time()
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert re.search(says, str(caught.value)), str(caught.value)
    assert len(str(caught.value)) < 600
    assert peak < 300e6
    assert time.process_time() - before < 30.0


@pytest.mark.parametrize("name", SOUND)
def test_every_way_of_writing_a_mesh_gives_its_triangles_to_collision_and_sight(name, tmp_path):
    solid = load_solid(Part("cube", "cube", Mesh(write(tmp_path / name, SOUND[name])), pose()))
    assert len(solid.triangles) == TRIANGLES.get(name, 12)
    assert np.ptp(solid.vertices, axis=0) == pytest.approx([0.1, 0.1, 0.1])


def test_a_mesh_of_several_materials_is_all_of_it(tmp_path):
    lines = obj().splitlines()
    materials = b"\n".join([*lines[:14], b"usemtl red", *lines[14:17], b"g handle\nusemtl blue", *lines[17:]])
    parts = re.sub(rb"(<triangles count=)\S+ *(>.*?<p>)(.*)(</p>\s*</triangles>)", split_in_two, dae(), flags=re.DOTALL)
    surfaces = []
    for name, content in {"one.obj": obj(), "two.obj": materials, "two.dae": parts}.items():
        solid = load_solid(Part("cube", "cube", Mesh(write(tmp_path / name, content)), pose()))
        surfaces.append(sorted(map(sorted, solid.vertices[solid.triangles].round(6).tolist())))
    assert len(surfaces[0]) == 12
    assert all(surface == surfaces[0] for surface in surfaces)


def split_in_two(triangles: re.Match[bytes]) -> bytes:
    """The triangles of a COLLADA file in two parts of a mesh."""
    begin, inputs, numbers, end = triangles.groups()
    words = numbers.split()
    return b"".join(begin + b'"6"' + inputs + b" ".join(half) + end for half in (words[:36], words[36:]))


def test_a_damaged_mesh_is_read_or_refused_and_takes_neither_long_nor_much_memory(tmp_path):
    contents, before = [(Path(name).suffix, content) for name, content in SOUND.items()], time.process_time()
    tracemalloc.start()
    for number in range(28):
        suffix, content = contents[number % len(contents)]
        path = write(tmp_path / f"mesh{suffix}", damage(content, Random(number)).content)  # noqa: S311
        with suppress(InputError):
            load_solid(Part("cube", "cube", Mesh(path), pose()))
    assert tracemalloc.get_traced_memory()[1] < 300e6
    tracemalloc.stop()
    assert time.process_time() - before < 30.0


def test_a_refusal_names_the_mesh_and_the_entry_of_the_workspace_that_names_it(cell):
    write(cell / "other.stl", text_stl().replace(b"vertex", b"vertx", 1))
    edit(cell, "cube.stl", "other.stl")
    problem = refusal(cell)
    assert (problem.place.file, problem.place.line) == (cell / "other.stl", 2)
    number = re.search(rf"{re.escape(str(cell / 'workspace.yaml'))}:(\d+):\d+ names this file", problem.message)
    assert "other.stl" in (cell / "workspace.yaml").read_text(encoding="utf-8").splitlines()[int(number[1]) - 1]


def test_a_refusal_names_the_line_of_the_urdf_that_names_the_mesh(cell):
    write(cell / "part.obj", obj("f 1 2 9\n"))
    urdf = cell / "arm.urdf"
    text, mesh = urdf.read_text(encoding="utf-8"), '<mesh filename="part.obj"/>'
    changed = re.sub(r"<(box|cylinder|sphere)\b[^>]*/>", f"\n{mesh}", text, count=1)
    urdf.write_text(changed, encoding="utf-8")
    problem = refusal(cell)
    assert str(problem.place) == f"{cell / 'part.obj'}:21"
    line = next(number for number, words in enumerate(changed.splitlines(), 1) if mesh in words)
    assert f"{urdf}:{line}:" in problem.message


def test_a_mesh_is_loaded_from_a_path_that_is_not_utf8(tmp_path):
    for name, content in SOUND.items():
        folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xe9"))
        folder.mkdir(exist_ok=True)
        path = write(folder / name, content)
        assert len(load_solid(Part("cube", "cube", Mesh(path), pose())).triangles) > 0


def test_triangles_without_area_are_said_to_have_none(tmp_path):
    flat = write(tmp_path / "flat.stl", re.sub(rb"vertex .*", b"vertex 0 0 0", text_stl()))
    with pytest.raises(InputError, match=r"no triangle of this mesh has an area; it is the mesh of `cube/0`"):
        load_solid(Part("cube/0", "cube", Mesh(flat), pose()))


def test_no_texture_or_material_of_a_drawn_mesh_is_opened(tmp_path):
    os.mkfifo(tmp_path / "waits.png")
    image = '<library_images><image id="i"><init_from>waits.png</init_from></image></library_images>'
    read_mesh(write(tmp_path / "mesh.dae", dae(library=image)))
    write(tmp_path / "m.mtl", b"newmtl a\nmap_Kd waits.png\n")
    read_mesh(write(tmp_path / "mesh.obj", obj("mtllib m.mtl\nusemtl a\n")))
    shutil.rmtree(tmp_path)


CORNERS = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.06, 0], [0, 0, 0.12]])
"""Of a tetrahedron, all extents of which differ [m]."""

UNITS = {"": 1.0, '<unit meter="1"/>': 1.0, '<unit name="inch" meter="0.0254"/>': 0.0254,
         '<unit name="mm" meter="1e-3"/>': 1e-3, "<unit meter='0.01' name='cm'/>": 0.01}  # fmt: skip
UP_AXES = ("", "<up_axis>X_UP</up_axis>", "<up_axis>Y_UP</up_axis>", "<up_axis>Z_UP</up_axis>")

DAE = (FILES / "tetrahedron.dae").read_text()


def tetrahedron(path: Path, asset: str = "", unit: float = 1.0) -> Path:
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
    mesh = Mesh(tetrahedron(tmp_path / "tetrahedron.DAE", asset + up, UNITS[asset]), (1.0, 1.0, -2.0))
    part = Part("g1/0", "g1", mesh, read_only(pose()))
    # Of sight, collision, pictures and pages; of perception; of simulation.
    for vertices in (load_solid(part).vertices, Surface.of(part).vertices, read_mesh(mesh.path, mesh.scale).vertices):
        np.testing.assert_allclose(spans(vertices), [[0, 0, -0.24], [0.03, 0.06, 0]], atol=1e-6)


def test_physics_and_pages_show_a_mesh_in_inches_as_large_as_it_is(tabletop, tmp_path):
    asset = '<unit name="inch" meter="0.0254"/>'
    g1 = tabletop.objects["g1"]
    file = tetrahedron(tmp_path / "it.dae", asset, 0.0254)
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


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "one", "1e9", ""])
def test_a_unit_that_is_no_length_is_refused_with_its_line(unit, tmp_path):
    path = tetrahedron(tmp_path / "it.dae", f'<unit meter="{unit}"/>')
    problem = refused(read_mesh, path)
    assert problem.place == Place(path, 2)
    assert f'`<unit meter="{unit}">`' in problem.message


def test_a_doubt_about_a_mesh_says_that_its_unit_counts_already(tabletop, tmp_path):
    mesh = Mesh(tetrahedron(tmp_path / "it.dae", '<unit meter="0.001"/>', 0.001), (0.001, 0.001, 0.001))
    g1 = replace(tabletop.objects["g1"], parts=(Part("g1/0", "g1", mesh, read_only(pose())),))
    model = RobotModel.load(tabletop.robot)
    (problem,) = doubtful_meshes(replace(tabletop, objects={"g1": g1}), model)
    assert "gives its unit as 0.001 m" in (problem.mend or "")


PACKAGES = ("example-robot-data", "airo_models", "rtbdata")

REASONS = {
    "alexander_description/meshes": "trimesh cuts polygons that are not convex into fans, which reach out of them",
    "anymal_foot.dae": "trimesh finds nothing in it",
    "link6.stl-old.stl": "trimesh takes this text for a damaged binary file",
    "base_link2.dae": "it is no XML",
}
"""Why files differ, by the end of their folder or name."""


def meshes() -> list[Path]:
    folders = [root / name for root in package_roots() for name in PACKAGES]
    found = {
        path.resolve()
        for folder in folders
        for path in folder.rglob("*")
        if path.suffix.lower() in (".dae", ".obj", ".stl")
    }
    return sorted(path for path in found if path.is_file())


MESHES = meshes()


def corners(triangles: Triangles) -> Array:
    return triangles.vertices[triangles.faces]


def area(corners: Array) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def difference(path: Path) -> str:
    """The first figure in which the two readers differ; empty if none."""
    try:
        # Meshes in millimetres reach far.
        ours = corners(read_mesh(path, (1e-3, 1e-3, 1e-3))) * 1e3 / mesh_unit(path)
    except InputError:
        return "refused"
    try:
        with path.open("rb") as file:
            options = {"skip_materials": True} if path.suffix.lower() == ".obj" else {}
            loaded = trimesh.load_mesh(file, file_type=path.suffix.lower().removeprefix("."), **options)
        mesh = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
        theirs = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    except ValueError:
        return "refused there"
    if len(theirs) == 0:
        return "empty there"
    size = np.ptp(theirs, axis=(0, 1)).max()
    flat = sum((theirs[:, one] == theirs[:, other]).all(axis=1) for one, other in ((0, 1), (1, 2), (2, 0))) > 0
    if not len(theirs) - flat.sum() <= len(ours) <= len(theirs):  # it merges corners that are nearly equal, too
        return f"{len(ours)} triangles, {len(theirs)} there"
    for name, found, expected in (
        ("area", area(ours), area(theirs)),
        ("lower end", ours.min(axis=(0, 1)), theirs.min(axis=(0, 1))),
        ("upper end", ours.max(axis=(0, 1)), theirs.max(axis=(0, 1))),
    ):
        if np.abs(found - expected).max() > 1e-4 * (expected if name == "area" else size):
            return f"{name} {found}, {expected} there"
    return ""


def differing(paths: list[Path]) -> dict[str, str]:
    found = {str(path): difference(path) for path in paths}
    return {path: why for path, why in found.items() if why and not any(reason in path for reason in REASONS)}


def test_meshes_of_robots_have_the_area_the_bounds_and_the_triangles_that_another_library_finds():
    assert len(MESHES) > 1000
    assert set(Counter(path.suffix.lower() for path in MESHES)) == {".dae", ".obj", ".stl"}
    assert differing([path for path in MESHES if path.stat().st_size < 400_000][::12]) == {}


@pytest.mark.trial
def test_all_meshes_of_robots_have_the_area_the_bounds_and_the_triangles_that_another_library_finds():
    assert differing(MESHES) == {}


@pytest.mark.parametrize("seed", range(20))
def test_a_polygon_that_is_not_convex_is_cut_into_triangles_inside_of_it(seed, tmp_path):
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(4, 60)))
    rim = random.uniform(0.1, 1.0, len(angles))[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    x, y = rim.T
    own = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    plane = np.linalg.qr(random.normal(size=(3, 3)))[0][:, :2]
    vertices = "".join(f"v {' '.join(map(str, point))}\n" for point in rim @ plane.T)
    file = tmp_path / "star.obj"
    file.write_text(f"{vertices}f {' '.join(map(str, range(1, len(rim) + 1)))}\n", encoding="ascii")
    triangles = corners(read_mesh(file))
    assert len(triangles) == len(rim) - 2
    assert area(triangles) == pytest.approx(own, rel=1e-9)
    a, b, c = np.moveaxis(triangles, 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a).sum(axis=0)) / 2 == pytest.approx(own, rel=1e-9)
