"""Arms that are none of the usual ones get a workspace or a refusal that says why, never an internal error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.starter.make import Starter, make_starter
from tests.programming.robots import joint, written_urdf

pytestmark = pytest.mark.filterwarnings("error")

LIMIT = '<limit lower="-1.5" upper="1.5" velocity="1" effort="100"/>'


def turning(name: str, parent: str, child: str, xyz: str, axis: str, mimics: str = "") -> str:
    follow = f'<mimic joint="{mimics}" multiplier="-1"/>' if mimics else ""
    return joint(name, parent, child, "revolute", xyz, axis, LIMIT + follow)


SIX_AXES = (
    turning("joint_1", "base", "link_1", "0 0 0.4", "0 0 1"),
    turning("joint_2", "link_1", "link_2", "0.3 0 0.3", "0 1 0"),
    turning("joint_3", "link_2", "link_3", "0 0 1", "0 1 0"),
    turning("joint_4", "link_3", "link_4", "0.6 0 0.2", "1 0 0"),
    turning("joint_5", "link_4", "link_5", "0.5 0 0", "0 1 0"),
    turning("joint_6", "link_5", "link_6", "0.2 0 0", "1 0 0"),
    joint("end", "link_6", "tool0", "fixed", "0 0 0", "0 0 1"),
)

RODS = (
    turning("passive_1", "link_1", "crank", "0.3 0 0.3", "0 1 0", mimics="joint_3"),
    turning("passive_2", "crank", "rod", "-0.4 0 0", "0 1 0", mimics="joint_2"),
)
"""A parallel linkage beside the upper arm, as on large industrial robots."""

PALLETIZER = (
    *SIX_AXES[:3],
    turning("level", "link_3", "link_4", "1 0 0", "0 1 0", mimics="joint_3"),
    turning("joint_4", "link_4", "tool0", "0 0 -0.1", "0 0 1"),
)
"""What keeps its flange level is in the arm itself."""


def in_one_point(*axes: str) -> tuple[str, ...]:
    return tuple(turning(f"j{k}", f"l{k}", f"l{k + 1}", "0 0 0", axis) for k, axis in enumerate(axes))


ODD_ARMS = {
    "one joint": (SIX_AXES[0],),
    "one joint that slides": (joint("slide", "base", "tip", "prismatic", "0 0 0", "0 0 1"),),
    "all axes in one point": in_one_point("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0"),
    "one axis, six times": in_one_point(*["0 0 1"] * 6),
    "led by a rod": (
        *SIX_AXES[:2],
        turning("joint_3", "link_2", "link_3", "0 0 1", "0 1 0", mimics="motor_3"),
        *SIX_AXES[3:],
        turning("motor_3", "link_1", "crank", "0.3 0 0.3", "0 1 0"),
    ),
}


def urdf_of(folder: Path, joints: Sequence[str], *, solid: bool) -> Path:
    path = written_urdf(folder / "odd.urdf", *joints)
    box = '<collision><origin xyz="0 0 0.05"/><geometry><box size="0.05 0.05 0.1"/></geometry></collision>'
    if solid:
        path.write_text(re.sub(r'(<link name="\w+")/>', rf"\1>{box}</link>", path.read_text()))
    return path


@pytest.mark.parametrize("solid", [True, False], ids=["solid", "without geometry"])
@pytest.mark.parametrize("name", ODD_ARMS)
def test_an_odd_arm_gets_a_workspace_that_says_if_nothing_is_in_reach(tmp_path: Path, name: str, solid: bool) -> None:
    made = make_starter(tmp_path / "cell", str(urdf_of(tmp_path, ODD_ARMS[name], solid=solid)))
    assert isinstance(made, Starter)
    assert made.cubes or "nothing-in-reach" in [problem.code for problem in made.warnings]
    assert Cell.load(load_workspace(made.folder)).model.arm


@pytest.mark.parametrize("solid", [True, False], ids=["solid", "without geometry"])
@pytest.mark.parametrize(
    ("joints", "follower", "leader"),
    [((*SIX_AXES, *RODS), "passive_1", "joint_3"), (PALLETIZER, "level", "joint_3")],
    ids=["parallel linkage", "palletizer"],
)
def test_an_arm_with_a_parallel_linkage_is_refused_and_told_which_joint_follows_which(
    tmp_path: Path, joints: Sequence[str], follower: str, leader: str, solid: bool
) -> None:
    urdf = urdf_of(tmp_path, joints, solid=solid)
    with pytest.raises(InputError) as caught:
        make_starter(tmp_path / "cell", str(urdf))
    (problem,) = caught.value.problems
    assert problem.code == "coupled-arm"
    assert problem.message.startswith(f"joint `{follower}` mimics `{leader}`, a joint of the arm")
    assert problem.place is not None
    assert (problem.place.file, problem.place.line) == (urdf, 1)
    assert not (tmp_path / "cell").exists()
