"""What users are told about bad input: the cases of bad_inputs.yaml and damaged_files.yaml, one after the other."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from sqrp_cli.cell.fixture_file import read_fixtures
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError
from sqrp_cli.robot.moveit import read_moveit_limits, read_srdf
from sqrp_cli.robot.read_urdf import read_urdf
from tests.cells import FILES, read_cases
from tests.damage.mutations import damage

CELL = Path(__file__).parents[1] / "cases" / "cell"
CASES = read_cases("bad_inputs.yaml")


@pytest.mark.parametrize("case", CASES, ids=[case["case"] for case in CASES])
def test_bad_input_is_refused_with_place_reason_and_remedy(case, damaged, position_of):
    cell = damaged(case)
    with pytest.raises(InputError) as caught:
        load_workspace(cell)
    problem, *others = caught.value.problems
    assert len(others) == case.get("others", 0), "one mistake, one problem"
    assert problem.code == case["code"], str(problem)
    assert problem.place.file == cell / case.get("in", case["file"])
    if "at" in case:
        assert (problem.place.line, problem.place.column) == position_of(case["at"], problem.place.file), str(problem)
    if "line" in case:
        assert problem.place.line == case["line"], str(problem)
    assert re.match(r"(`[^`]+`): \1:", problem.message) is None, "a name is said once"
    for piece in case.get("says", []):
        assert str(piece) in problem.message
    assert case.get("mend", "") in (problem.mend or "")
    if case.get("caret"):
        line, caret = problem.excerpt.split("\n")
        assert caret.strip() == "^"
        assert line.replace("\t", " ").rstrip() in problem.place.file.read_text(encoding="utf-8").replace("\t", " ")


@pytest.mark.parametrize("file", sorted(str(path.relative_to(CELL)) for path in CELL.rglob("*.*") if path.is_file()))
def test_random_damage_loads_or_names_a_place(file, cell):
    path = cell / file
    original, random = path.read_bytes(), Random(file)  # noqa: S311
    for _ in range(40):
        path.write_bytes(damage(original, random).content)
        try:
            load_workspace(cell)
        except InputError as error:
            places = [problem.place for problem in error.problems]
            assert all(place is not None and cell in place.file.parents for place in places)


def test_every_problem_of_a_file_is_reported_at_once(damaged):
    edits = {"urdf: arm.urdf": "urfd: arm.urdf", "padding: 5 mm": "padding: 5 s", "rate: 30": "rate: -1"}
    with pytest.raises(InputError) as caught:
        load_workspace(damaged({"file": "workspace.yaml", "replace": edits}))
    assert [problem.code for problem in caught.value.problems] == ["unknown-key", "wrong-value", "wrong-unit"]


DAMAGED = read_cases("damaged_files.yaml")
PACKAGE = "My_ROS2_Description"


def as_fixtures(path: Path) -> object:
    return read_fixtures(path, path.read_bytes(), (path.parent,), [])


READERS: dict[str, Callable[[Path], object]] = {
    ".urdf": read_urdf,
    ".srdf": lambda path: read_srdf(path, read_urdf(path.with_suffix(".urdf"))),
    ".yaml": read_moveit_limits,
    **dict.fromkeys((".dae", ".obj", ".stl"), read_mesh),
}


@pytest.mark.parametrize("case", DAMAGED, ids=[f"{case['file']}-{index}" for index, case in enumerate(DAMAGED)])
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
