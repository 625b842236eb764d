"""Finding files by path and by package."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from sqrp_cli.errors import Place
from sqrp_cli.files.packages import from_folder, package_roots, resolve
from tests.cells import refused

PLACE = Place(Path("workspace.yaml"), 3, 9)


def make(root: Path, name: str) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def test_roots_are_tried_in_order_stated_ros_ament_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stated, ros, ament, python = (tmp_path / name for name in ("stated", "ros", "ament", "python"))
    expected = [stated, ros, ament / "share", python / "cmeel.prefix" / "share"]
    files = [make(root, "arm/arm.urdf") for root in expected]
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{ros}:{tmp_path / 'missing'}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(ament))
    monkeypatch.setattr(sys, "path", [str(python)])
    roots = package_roots([stated])
    assert list(roots[:4]) == expected
    for index, file in enumerate(files):
        assert resolve("package://arm/arm.urdf", tmp_path, roots[index:], PLACE) == file


def test_a_root_may_be_the_package_itself_and_a_third_slash_means_nothing(tmp_path):
    file = make(tmp_path, "arm/urdf/arm.urdf")
    for slashes, root in (("//", tmp_path / "arm"), ("///", tmp_path)):
        assert resolve(f"package:{slashes}arm/urdf/arm.urdf", tmp_path, [root], PLACE) == file


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path) -> None:
    file = make(tmp_path, "robots/my arm.urdf")
    assert resolve("../robots/my arm.urdf", tmp_path / "cell", [], PLACE) == file
    assert resolve(f"file://{tmp_path}/robots/my%20arm.urdf", tmp_path, [], PLACE) == file
    assert resolve(str(file), Path("/"), [], PLACE) == file


def test_a_missing_package_lists_the_roots_and_the_command_that_installs_it(tmp_path: Path) -> None:
    problem = refused(resolve, "package://example-robot-data/robots/ur5.urdf", tmp_path, [tmp_path], PLACE)
    assert problem.code == "missing-package"
    assert f"roots tried: {tmp_path}" in problem.message
    assert problem.mend == "pip install example-robot-data"
    assert problem.place == PLACE


@pytest.mark.parametrize(("reference", "says"), [
    ("arm/meshes/link_2.stl", "has no `link_2.stl`; did you mean `link_1.stl`"),
    ("arm/mesh/link_1.stl", "has no `mesh`; did you mean `meshes`"),
    ("arm/meshes", "is a folder"), ("amr/meshes", "did you mean `arm`"),
])  # fmt: skip
def test_a_missing_file_or_package_names_what_is_there(tmp_path, reference, says):
    make(tmp_path, "arm/meshes/link_1.stl")
    assert says in refused(resolve, f"package://{reference}", tmp_path, [tmp_path], PLACE).message


@pytest.mark.parametrize(
    "reference", ["~nobody-of-that-name/arm.urdf", "x" * 5000 + ".urdf", "a/" * 5000, "a\0b.urdf", "\udcff"]
)
def test_names_that_no_file_has_are_refused_where_they_stand(reference: str, tmp_path: Path) -> None:
    problem = refused(resolve, reference, tmp_path, [], PLACE)
    assert "no such file or folder" in problem.message
    assert problem.place == PLACE


def named(folder: Path, name: str) -> Path:
    make(folder, "package.xml").write_text(f"<package>\n  <name>{name}</name>\n</package>")
    return folder


def test_the_name_in_package_xml_counts_also_within_repositories_of_several(tmp_path: Path) -> None:
    clone = named(tmp_path / "src" / "vendor" / "Arm_ROS2_Description", "arm_description")
    file = make(clone, "meshes/link.stl")
    for root in (tmp_path / "src", clone.parent, clone):
        assert resolve("package://arm_description/meshes/link.stl", tmp_path, [root], PLACE) == file
    problem = refused(resolve, "package://arm_descripton/meshes/link.stl", tmp_path, [tmp_path], PLACE)
    assert "did you mean `arm_description`" in problem.message


def test_a_folder_of_that_name_that_is_another_package_comes_last(tmp_path: Path) -> None:
    file = make(named(tmp_path / "a" / "copy", "arm"), "arm.urdf")
    other = make(named(tmp_path / "a" / "arm", "other"), "arm.urdf")
    assert resolve("package://arm/arm.urdf", tmp_path, [tmp_path / "a"], PLACE) == file
    file.unlink()
    assert resolve("package://arm/arm.urdf", tmp_path, [tmp_path / "a"], PLACE) == other


def test_a_path_through_a_link_is_what_the_file_system_makes_of_it(tmp_path: Path) -> None:
    (tmp_path / "far" / "cell").mkdir(parents=True)
    (tmp_path / "far" / "skills").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "far" / "cell")
    assert from_folder(tmp_path / "link", "../skills") == tmp_path / "far" / "skills"
    assert from_folder(tmp_path / "far" / "cell", "../skills") == tmp_path / "far" / "skills"
    assert from_folder(Path("far/cell"), "../skills") == Path("far/skills")
