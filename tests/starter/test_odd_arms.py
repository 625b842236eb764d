"""Arms that are none of the usual ones get a workspace or a refusal that says why, never an internal error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.motion.cell import Cell
from sqrp_cli.starter.make import Starter, make_starter
from tests.task.robots import LINKAGES, SIX_AXES, joint, turning, written_urdf

pytestmark = pytest.mark.filterwarnings("error")


def in_one_point(*axes: str) -> tuple[str, ...]:
    return tuple(turning(f"j{k}", f"l{k}", f"l{k + 1}", "0 0 0", axis) for k, axis in enumerate(axes))


ODD_ARMS = {
    "one joint": (SIX_AXES[0],),
    "one joint that slides": (joint("slide", "base", "tip", "prismatic", "0 0 0", "0 0 1"),),
    "all axes in one point": in_one_point("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0"),
    "one axis, six times": in_one_point(*["0 0 1"] * 6),
    **LINKAGES,
}


def urdf_of(folder: Path, joints: Sequence[str], *, solid: bool) -> Path:
    path = written_urdf(folder / "odd.urdf", *joints)
    box = '<collision><origin xyz="0 0 0.05"/><geometry><box size="0.05 0.05 0.1"/></geometry></collision>'
    if solid:
        path.write_text(re.sub(r'(<link name="\w+")/>', rf"\1>{box}</link>", path.read_text()))
    return path


@pytest.mark.parametrize(
    ("name", "solid"),
    [
        *(pytest.param(name, True, id=f"{name}-solid") for name in ODD_ARMS),
        *(
            pytest.param(
                name, False, id=f"{name}-without geometry", marks=[pytest.mark.trial] if name in LINKAGES else []
            )
            for name in ODD_ARMS
        ),
    ],
)
def test_an_odd_arm_gets_a_workspace_that_says_if_nothing_is_in_reach(tmp_path: Path, name: str, solid: bool) -> None:
    made = make_starter(tmp_path / "cell", str(urdf_of(tmp_path, ODD_ARMS[name], solid=solid)))
    assert isinstance(made, Starter)
    assert made.cubes or "nothing-in-reach" in [problem.code for problem in made.warnings]
    assert Cell.load(load_workspace(made.folder)).model.arm


LOOP = (
    joint("there", "a", "b", "fixed", "0 0 1", "0 0 1"),
    joint("back", "b", "a", "fixed", "0 0 1", "0 0 1"),
    SIX_AXES[0],
)
UNUSABLE = {
    "nothing moves": (
        (joint("weld", "base", "tip", "fixed", "0 0 1", "0 0 1"),),
        None,
        "all its joints are fixed",
        "arm",
    ),
    "only a gripper": ((turning("left_finger", "base", "tip", "0 0 0", "0 0 1"),), None, "`left_finger` look", "--tip"),
    "links in a circle": (LOOP, None, "links form a cycle", "such as `back`: a URDF is a tree"),
    "an axis of length zero": ((turning("j0", "base", "tip", "0 0 0", "0 0 0"),), None, "length zero", 'xyz="0 0 1"'),
    "no such tip": (SIX_AXES, "nolink", "`nolink`, which is no link", "`--tip LINK`"),
    "a tip that stands still": (SIX_AXES, "base", "no joint moves `base`", "`--tip LINK`"),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_robot_that_cannot_be_used_is_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    joints, tip, said, mend = UNUSABLE[name]
    with pytest.raises(InputError) as caught:
        make_starter(tmp_path / "cell", str(urdf_of(tmp_path, joints, solid=True)), tip=tip)
    (problem,) = caught.value.problems
    assert said in problem.message
    assert mend in (problem.mend or "")
    assert problem.place is not None
    assert (problem.place.file, (tmp_path / "cell").exists()) == (tmp_path / "odd.urdf", False)


def test_an_empty_urdf_is_said_to_be_empty(tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text("\n")
    with pytest.raises(InputError, match=r"odd\.urdf: the file is empty, expected <robot>") as caught:
        make_starter(tmp_path / "cell", str(tmp_path / "odd.urdf"))
    assert "completely" in (caught.value.problems[0].mend or "")


def test_warnings_of_a_new_workspace_name_files_that_are_there(tmp_path: Path) -> None:
    urdf = written_urdf(tmp_path / "odd.urdf", *SIX_AXES)
    urdf.write_text(re.sub(r'velocity="[^"]*"', 'velocity="0"', urdf.read_text()))
    warnings = make_starter(tmp_path / "cell", str(urdf)).warnings
    places = [warning.place.file for warning in warnings if warning.place is not None]
    assert tmp_path / "cell" / "workspace.yaml" in places
    assert all(place.exists() for place in places)
