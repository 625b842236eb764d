"""A mesh file either is what it says, or is refused at once with the line of what is wrong."""

from __future__ import annotations

import os
import re
import resource
import shutil
import time
import tracemalloc
from pathlib import Path
from random import Random

import numpy as np
import pytest

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import pose
from sqrp_cli.shapes import Mesh, Part
from sqrp_cli.sight.solids import load_solid
from tests.cell.mesh.mesh_bombs import bombs, dae, obj, sound_meshes, text_stl
from tests.cells import edit, refusal
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


def test_a_damaged_mesh_neither_crashes_the_reader_nor_takes_it_long(tmp_path):
    contents = [(Path(name).suffix, content) for name, content in SOUND.items()]
    ends = {}
    for number in range(60):
        suffix, content = contents[number % len(contents)]
        path = write(tmp_path / f"mesh{suffix}", damage(content, Random(number)).content)  # noqa: S311
        ends[number] = end_of_child(path)
    assert set(ends.values()) == {"loaded", "refused"}, ends


def end_of_child(path: Path) -> str:
    """What comes of loading a mesh in a process that may take 10 s, and 1 GB beside what it shares with this one."""
    shared = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize() // 1024
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_AS, (4_000_000_000, 4_000_000_000))
        resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
        code = 3
        try:
            load_solid(Part("cube", "cube", Mesh(path), pose()))
            code = 1
        except InputError:
            code = 2
        finally:
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    if used.ru_maxrss - shared > 1_000_000:  # in kilobytes
        return f"took {used.ru_maxrss - shared:,} kB"
    return {1: "loaded", 2: "refused"}.get(os.waitstatus_to_exitcode(status), f"ended with {status}")


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


def test_a_mesh_of_another_format_is_refused_by_its_name(cell):
    write(cell / "cube.ply", b"ply\n")
    edit(cell, "cube.stl", "cube.ply")
    problem = refusal(cell)
    assert problem.code == "unknown-mesh"
    assert "`.ply`, expected .stl, .obj or .dae" in problem.message


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
