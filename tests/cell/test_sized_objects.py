"""Objects of meshes and of URDFs are as large as these are, where the file's pose puts them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.edits import with_pose
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import inverse
from tests.cells import FILES


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
