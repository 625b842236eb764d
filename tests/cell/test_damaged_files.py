"""Files that a workspace names are refused with one good message: one case after the other of damaged_files.yaml."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from sqrp_cli.cell.fixture_file import read_fixtures
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError
from sqrp_cli.robot.moveit import read_moveit_limits, read_srdf
from sqrp_cli.robot.read_urdf import read_urdf
from tests.cells import FILES, read_cases

CASES = read_cases("damaged_files.yaml")
PACKAGE = "My_ROS2_Description"


def as_fixtures(path: Path) -> object:
    return read_fixtures(path, path.read_bytes(), (path.parent,), [])


READERS: dict[str, Callable[[Path], object]] = {
    ".urdf": read_urdf,
    ".srdf": lambda path: read_srdf(path, read_urdf(path.with_suffix(".urdf"))),
    ".yaml": read_moveit_limits,
    **dict.fromkeys((".dae", ".obj", ".stl"), read_mesh),
}


@pytest.mark.parametrize("case", CASES, ids=[f"{case['file']}-{index}" for index, case in enumerate(CASES)])
def test_a_damaged_file_has_one_good_message(case, tmp_path):
    folder = Path(shutil.copytree(FILES, tmp_path / "files"))
    path = folder / case["file"]
    text = case.get("text", path.read_text(encoding="utf-8")) + case.get("append", "")
    for old, new in case.get("replace", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text.replace("NINES", "9" * 5000), encoding="utf-8")
    path = path.rename(path.with_name(case.get("called", path.name)))
    read = READERS.get(path.suffix, as_fixtures)
    if PACKAGE in path.parts:
        read, path = read_urdf, folder / PACKAGE / "urdf" / "my_arm.urdf.xacro"
    with pytest.raises(InputError) as caught:
        read(path)
    problem = caught.value.problems[0]
    assert problem.place is not None
    assert problem.code == case.get("code", problem.code)
    assert problem.place.line == case.get("line", problem.place.line)
    assert case.get("says", "") in problem.message
    assert re.search(case.get("matches", ""), str(problem)), str(problem)
    assert len(str(caught.value)) < 1200
