"""Arms of any kind, and a sample of `python -m tests.trials arms`: a workspace, or a refusal that says why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.starter import search
from sqrp_cli.starter.arm_guess import guess_arm
from sqrp_cli.starter.make import make_starter
from tests.cells import refused
from tests.task.robots import FEW_AXES, LINKAGES, ROBOTS, SIX_AXES, joint, turning, written_urdf
from tests.trials.arms import BOX, PEDESTAL, side, solid

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("error")]


def in_one_point(*axes: str) -> tuple[str, ...]:
    return tuple(turning(f"j{k}", f"l{k}", f"l{k + 1}", "0 0 0", axis) for k, axis in enumerate(axes))


ODD_ARMS = {
    "one joint": (SIX_AXES[0],),
    "one joint that slides": (joint("slide", "base", "tip", "prismatic", "0 0 0", "0 0 1"),),
    "all axes in one point": in_one_point("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0"),
    "one axis, six times": in_one_point(*["0 0 1"] * 6),
    **LINKAGES,
}


def urdf_of(folder: Path, joints: Sequence[str], *, boxes: bool) -> Path:
    path = written_urdf(folder / "odd.urdf", *joints)
    box = '<collision><origin xyz="0 0 0.05"/><geometry><box size="0.05 0.05 0.1"/></geometry></collision>'
    if boxes:
        path.write_text(re.sub(r'(<link name="\w+")/>', rf"\1>{box}</link>", path.read_text()))
    return path


@pytest.mark.parametrize("boxes", [True, False], ids=["solid", "without geometry"])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.trial] * (name in LINKAGES)) for name in ODD_ARMS]
)
def test_an_odd_arm_gets_a_workspace_that_says_if_nothing_is_in_reach(tmp_path: Path, name: str, boxes: bool) -> None:
    made = make_starter(tmp_path / "cell", str(urdf_of(tmp_path, ODD_ARMS[name], boxes=boxes)))
    assert made.cubes or "nothing-in-reach" in [problem.code for problem in made.warnings]
    assert Cell.load(load_workspace(made.folder)).model.arm


LOOP = (
    joint("there", "a", "b", "fixed", "0 0 1", "0 0 1"), joint("back", "b", "a", "fixed", "0 0 1", "0 0 1"), SIX_AXES[0]
)  # fmt: skip
WELD, FINGER = (
    joint("weld", "base", "tip", "fixed", "0 0 1", "0 0 1"),
    turning("left_finger", "base", "tip", "0 0 0", "0 0 1"),
)
UNUSABLE = {
    "nothing moves": ((WELD,), None, "all its joints are fixed", "arm"),
    "only a gripper": ((FINGER,), None, "`left_finger` look", "--tip"),
    "links in a circle": (LOOP, None, "links form a cycle", "such as `there`: a URDF is a tree"),
    "an axis of length zero": ((turning("j0", "base", "tip", "0 0 0", "0 0 0"),), None, "length zero", 'xyz="0 0 1"'),
    "no such tip": (SIX_AXES, "nolink", "`nolink`, which is no link", "`--tip LINK`"),
    "a tip that stands still": (SIX_AXES, "base", "no joint moves `base`", "`--tip LINK`"),
    "an empty file": (None, None, "the file is empty, expected <robot>", "completely"),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_robot_that_cannot_be_used_is_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    joints, tip, said, mend = UNUSABLE[name]
    urdf = tmp_path / "odd.urdf"
    urdf.write_text("\n") if joints is None else urdf_of(tmp_path, joints, boxes=True)
    problem = refused(make_starter, tmp_path / "cell", str(urdf), tip=tip)
    assert said in problem.message
    assert mend in (problem.mend or "")
    assert (problem.place.file, (tmp_path / "cell").exists()) == (urdf, False)


def test_warnings_of_a_new_workspace_name_files_that_are_there(tmp_path: Path) -> None:
    urdf = written_urdf(tmp_path / "odd.urdf", *SIX_AXES)
    urdf.write_text(re.sub(r'velocity="[^"]*"', 'velocity="0"', urdf.read_text()))
    warnings = make_starter(tmp_path / "cell", str(urdf)).warnings
    places = [warning.place.file for warning in warnings if warning.place is not None]
    assert tmp_path / "cell" / "workspace.yaml" in places
    assert all(place.exists() for place in places)


@pytest.mark.trial
@pytest.mark.parametrize("lifts", [search.LIFTS, ()], ids=["all", "tables"])
def test_an_arm_with_a_pedestal_works_at_a_table_of_its_height(tmp_path, monkeypatch, lifts):
    monkeypatch.setattr(search, "LIFTS", lifts)  # trying each takes long, in vain
    made = make_starter(tmp_path / "cell", str(solid(tmp_path, "pedestal", PEDESTAL)))
    assert len(made.cubes) == 4
    written = (made.folder / "workspace.yaml").read_text()
    assert "base: {position: [0, 0, 0.9" in written or "base: {position: [0, 0, -" in written


def test_of_two_arms_the_first_is_taken_and_the_other_is_named(tmp_path: Path) -> None:
    urdf = read_urdf(solid(tmp_path, "two", (*side("left", 0.25), *side("right", -0.25))))
    guessed, chosen = guess_arm(urdf), guess_arm(urdf, "right_hand")
    assert (guessed.tip, guessed.others) == ("left_hand", ("right_hand",))
    assert [joint.name for joint in chosen.joints] == [f"right_joint_{k}" for k in range(1, 7)]
    assert "did you mean `right_hand`" in refused(guess_arm, urdf, "right_hnd").message


@pytest.mark.trial
def test_cubes_count_that_can_be_picked_up_with_the_tool_turned(tmp_path: Path) -> None:
    made = make_starter(tmp_path / "cell", str(solid(tmp_path, "two", (*side("left", 0.25), *side("right", -0.25)))))
    assert (made.tip, len(made.cubes)) == ("left_hand", 4)


TIAGO = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
ELBOW = ["joint_1", "joint_2", "motor_3", "joint_4", "joint_5", "joint_6"]
GUESSES = {
    "legs of a robot without arms": (
        "go1_description/urdf/go1.urdf", {"tip": "FR_foot", "others": ("FL_foot", "RR_foot", "RL_foot")}
    ),
    "fingers of a hand are not of the arm": ("tiago_description/robots/tiago.urdf", {"joints": TIAGO, "others": ()}),
    "a level flange": (LINKAGES["a level flange"], {"joints": [f"joint_{k}" for k in range(1, 5)], "tip": "tool0"}),
    "an elbow led by a rod": (LINKAGES["an elbow led by a rod"], {"joints": ELBOW, "tip": "tool0"}),
    "a wrist without roll points across its last axis": (FEW_AXES["four axes"], {"out": [1.0, 0.0, 0.0]}),
}  # fmt: skip


@pytest.mark.parametrize("name", GUESSES)
def test_the_arm_is_what_drives_the_tool_and_no_finger_or_rod(name: str, tmp_path: Path) -> None:
    urdf, expected = GUESSES[name]
    path = ROBOTS / urdf if isinstance(urdf, str) else written_urdf(tmp_path / "arm.urdf", *urdf)
    guessed = guess_arm(read_urdf(path))
    found = {"joints": [joint.name for joint in guessed.joints], "tip": guessed.tip, "others": guessed.others}
    assert expected == {key: {**found, "out": guessed.out.tolist()}[key] for key in expected}


def test_where_no_frame_says_which_way_a_wrist_points_its_shape_does(tmp_path: Path) -> None:
    urdf = solid(tmp_path, "wrist", FEW_AXES["four axes"][:-1])
    urdf.write_text(urdf.read_text().replace(f'"l4">{BOX}', f'"l4">{BOX.replace("0 0 0.03", "0.1 0.005 0")}'))
    made = make_starter(tmp_path / "cell", str(urdf))
    assert (made.tip, len(made.cubes)) == ("l4", 4)
    written = (made.folder / "workspace.yaml").read_text()
    assert "pose: {position: [0.127, 0, 0], rpy: [90 deg, 0 deg, 90 deg]}" in written


def test_where_nothing_is_in_reach_the_first_check_that_fails_is_named_with_its_figure(tmp_path: Path) -> None:
    made = make_starter(tmp_path / "cell", str(solid(tmp_path, "short", FEW_AXES["SCARA"][:1])))
    (warning,) = [problem for problem in made.warnings if problem.code == "nothing-in-reach"]
    assert made.task is None
    assert "home positions is possible; the first, pointing down" in warning.message
