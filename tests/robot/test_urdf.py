"""Robot descriptions and limits of MoveIt: what is read, and what is refused with its line."""

from __future__ import annotations

import math
import re
from math import radians
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.files.packages import package_roots
from sqrp_cli.robot.moveit import SrdfModel, read_moveit_limits, read_srdf
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from tests.cells import FILES, read_cases, refused

ARM, SRDF = ((FILES / name).read_text() for name in ("arm.urdf", "arm.srdf"))


def written(folder: Path, text: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def find(reference: str, urdf: Path) -> Path:
    return urdf.parent / reference.removeprefix("package://")


def test_a_urdf_is_read_with_its_links_joints_and_root(tmp_path):
    model = read_urdf(written(tmp_path, ARM))
    assert (model.name, model.root, list(model.links)) == ("arm", "base", ["base", "hand", "tip"])
    turn = model.joints["turn"]
    assert (turn.type, turn.parent, turn.child, turn.movable) == ("revolute", "base", "hand", True)
    assert (turn.lower, turn.upper, turn.velocity) == (-1.0, 2.0, 3.0)
    np.testing.assert_array_equal(turn.axis, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(turn.X_PJ[:3, 3], [1.0, 0.0, 0.0])
    assert turn.place.line == 12
    assert [joint.name for joint in model.movable_joints] == ["turn"]


def test_joints_come_parents_first_whatever_their_order_in_the_file(tmp_path):
    first, second = ARM.index('  <joint name="turn"'), ARM.index('  <joint name="end"')
    swapped = ARM[:first] + ARM[second : ARM.index("</robot>")] + ARM[first:second] + "</robot>"
    assert list(read_urdf(written(tmp_path, swapped)).joints) == ["turn", "end"]


def test_a_link_without_the_chosen_geometry_uses_the_other_one(tmp_path):
    model = read_urdf(written(tmp_path, ARM))
    collision = model.parts("collision", find)
    assert [(part.name, part.parent, part.shape) for part in collision] == [
        ("base", "base", Box((1.0, 2.0, 3.0))),
        ("hand", "hand", Sphere(0.1)),
        ("palm", "hand", Cylinder(0.1, 0.2)),
        ("hand_3", "hand", Capsule(0.1, 0.2)),
    ]
    np.testing.assert_allclose(collision[1].X_PG @ [1, 0, 0, 1], [0, 1, 1, 1], atol=1e-12)
    visual = model.parts("visual", find)
    hand = Mesh(tmp_path / "it" / "hand.stl", (1.0, 1.0, 2.0))
    assert [part.shape for part in visual] == [Box((1.0, 2.0, 3.0)), hand]


def test_names_of_parts_are_unique_where_the_urdf_repeats_them(tmp_path):
    text = ARM.replace("<collision>", '<collision name="palm">').replace('name="tip"', 'name="hand_2"')
    text = text.replace('<child link="tip"/>', '<child link="hand_2"/>')
    names = [part.name for part in read_urdf(written(tmp_path, text)).parts("collision", find)]
    assert names == ["base", "hand", "hand_3", "hand_4"]


def test_a_missing_mesh_is_reported_where_the_urdf_names_it(tmp_path):
    def refuse(reference: str, _urdf: Path) -> Path:
        raise InputError(Problem("missing-file", f"`{reference}`: file not found", mend="look elsewhere"))

    problem = refused(read_urdf(written(tmp_path, ARM)).parts, "visual", refuse)
    assert (problem.place.line, problem.mend, "hand.stl" in problem.message) == (9, "look elsewhere", True)


def test_a_continuous_joint_has_no_limits_and_mimic_has_defaults(tmp_path):
    text = ARM.replace('type="revolute"', 'type="continuous"').replace("</robot>", (
        '<link name="finger"/><joint name="follow" type="prismatic"><parent link="hand"/><child link="finger"/>'
        '<limit lower="0" upper="1" velocity="0"/><mimic joint="turn" multiplier="-0.5"/></joint></robot>'
    ))  # fmt: skip
    joints = read_urdf(written(tmp_path, text)).joints
    assert (joints["turn"].lower, joints["turn"].upper) == (-math.inf, math.inf)
    mimic = joints["follow"].mimic
    assert (mimic.joint, mimic.multiplier, mimic.offset, joints["follow"].velocity) == ("turn", -0.5, 0.0, None)


def srdf_of(folder: Path, text: str) -> SrdfModel:
    (folder / "arm.srdf").write_text(text)
    return read_srdf(folder / "arm.srdf", read_urdf(written(folder, ARM)))


def test_an_srdf_gives_groups_states_and_disabled_pairs(tmp_path):
    srdf = srdf_of(tmp_path, SRDF)
    assert srdf.groups == {"arm": ("turn",), "all": ("turn",)}
    assert srdf.states == {"up": {"turn": 1.5}}
    assert srdf.disabled_pairs == {("base", "hand")}


@pytest.mark.parametrize(("old", "new", "said"), [
        ('link1="hand"', 'link1="hnad"', "unknown link `hnad`; did you mean `hand`?"),
        ('<joint name="turn"', '<joint name="trun"', "unknown joint `trun`; did you mean `turn`?"),
])  # fmt: skip
def test_what_an_srdf_says_of_other_robots_is_left_out_with_one_warning(tmp_path, old, new, said):
    more = '<disable_collisions link1="camera" link2="base"/></robot>'
    srdf = srdf_of(tmp_path, SRDF.replace(old, new, 1).replace("</robot>", more))
    (warning,) = srdf.warnings
    assert (warning.severity, warning.place.file) == ("warning", tmp_path / "arm.srdf")
    assert warning.message.startswith(said)
    assert "1 more such mention" in warning.message
    assert srdf.groups == {"arm": ("turn",), "all": ("turn",)}


@pytest.mark.parametrize("case", read_cases("doubtful_urdfs.yaml"), ids=lambda case: case["case"])
def test_what_can_hardly_be_meant_is_a_warning_at_its_line_and_what_is_rounded_is_none(tmp_path, case):
    text = ARM
    for old, new in case["replace"].items():
        assert old in text
        text = text.replace(old, new, 1)
    warnings = read_urdf(written(tmp_path, text)).warnings
    expected = [(case["code"], "warning", case["line"])] if "code" in case else []
    assert [(one.code, one.severity, one.place.line) for one in warnings] == expected
    assert all(case["says"] in one.message and one.mend for one in warnings)


def test_limits_of_endless_turns_are_those_of_a_hundred(tmp_path):
    text = ARM.replace('lower="-1" upper="2"', 'lower="-1e6" upper="3"')
    turn = read_urdf(written(tmp_path, text)).joints["turn"]
    assert (turn.lower, turn.upper) == (pytest.approx(-100 * 2 * math.pi), 3.0)


@pytest.mark.parametrize(("leader", "kind", "y", "said"), [
    ("trun", "prismatic", 0.0, "moves by itself"), ("follow", "prismatic", 0.0, "moves by itself"),
    ("end", "fixed", 0.25, "stands still"),
])  # fmt: skip
def test_a_finger_that_follows_nothing_that_moves_does_not_refuse_the_arm(tmp_path, leader, kind, y, said):
    finger = (
        '<link name="finger"/><joint name="follow" type="prismatic"><parent link="hand"/><child link="finger"/>'
        f'<axis xyz="0 2 0"/><limit lower="0" upper="1"/><mimic joint="{leader}" offset="0.25"/></joint></robot>'
    )
    model = read_urdf(written(tmp_path, ARM.replace("</robot>", finger)))
    (warning,) = (one for one in model.warnings if one.code == "unknown-joint")
    joint = model.joints["follow"]
    assert (joint.type, joint.mimic, joint.X_PJ[1, 3]) == (kind, None, y)
    assert said in warning.message


def test_every_robot_of_example_robot_data_is_read_with_parts_of_different_names():
    """One cannot be: a macro without links. Another one has fingers that follow unknown joints, and still a hand."""
    folder = next(root for root in package_roots() if (root / "example-robot-data").is_dir())
    files = sorted((folder / "example-robot-data" / "robots").rglob("*.urdf"))
    refused = {}
    for file in files:
        try:
            names = [part.name for part in read_urdf(file).parts("collision", find)]
        except InputError as error:
            refused[file.name] = (error.problems[0].code, error.problems[0].place.line is not None)
        else:
            assert len(names) == len(set(names))
    assert len(files) > 60
    assert refused == {"ur3.urdf": ("no-links", True)}
    psyonic = read_urdf(next(file for file in files if file.name == "alex_psyonic_hands.urdf"))
    assert "unknown-joint" in {warning.code for warning in psyonic.warnings}


LIMITS = (FILES / "joint_limits.yaml").read_text()


def limits_file(folder: Path, text: str) -> Path:
    (folder / "joint_limits.yaml").write_text(text, encoding="utf-8")
    return folder / "joint_limits.yaml"


def loaded(cell: Path, limits: str) -> Workspace:
    """The cell of the tests with other limits."""
    limits_file(cell, LIMITS)
    text = (cell / "workspace.yaml").read_text(encoding="utf-8")
    text = re.sub("  limits: .*", f"  limits: {limits}", text)
    assert limits in text
    (cell / "workspace.yaml").write_text(text, encoding="utf-8")
    return load_workspace(cell)


def test_what_is_switched_on_is_stated_and_nothing_else(tmp_path):
    limits = read_moveit_limits(limits_file(tmp_path, LIMITS))
    assert limits.stated == {
        "velocity": {"shoulder": 2.175, "finger_of_another_gripper": 0.2},
        "acceleration": {"shoulder": 0.52},
        "jerk": {"shoulder": 300.0},
    }
    assert limits.positions == {"elbow": (radians(-45), 1.5)}
    assert limits.scaling == {"velocity": 0.5, "acceleration": 0.1}


@pytest.mark.parametrize("above", ["robot_description_planning", "/**"])
def test_a_namespace_around_it_does_not_matter(tmp_path, above):
    inner = "".join(f"  {line}\n" for line in LIMITS.splitlines())
    limits = read_moveit_limits(limits_file(tmp_path, f"{above}:\n{inner}"))
    assert limits.stated["jerk"] == {"shoulder": 300.0}
    assert limits.scaling["velocity"] == 0.5


def test_a_workspace_takes_them_with_their_scaling(cell):
    workspace = loaded(cell, "{moveit: joint_limits.yaml, jerk: {elbow: 40}, acceleration: {slide: 3}}")
    limits = workspace.robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (0.5 * 2.175, 0.1 * 0.52)
    assert limits["shoulder"].jerk == 300.0
    assert (limits["slide"].velocity, limits["slide"].acceleration) == (0.5 * 0.5, 3.0)
    assert limits["elbow"].jerk == 40.0
    assert (limits["elbow"].lower, limits["elbow"].upper) == (radians(-45), 1.5)
    (warning,) = [warning for warning in workspace.warnings if warning.code == "unknown-joint"]
    assert "finger_of_another_gripper" in warning.message


def test_a_workspace_may_scale_otherwise(cell):
    limits = loaded(cell, "{moveit: joint_limits.yaml, velocity_scaling: 1, acceleration_scaling: 0.25}").robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (2.175, 0.25 * 0.52)
