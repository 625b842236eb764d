"""Every mesh of the installed robot packages has the triangles that another library finds."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sqrp_cli.cell.mesh import mesh_unit, read_mesh
from sqrp_cli.errors import InputError
from sqrp_cli.files.packages import package_roots
from sqrp_cli.geometry import Array
from sqrp_cli.shapes import Triangles

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
