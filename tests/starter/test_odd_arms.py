"""Arms that are none of the usual ones get a workspace or a refusal that says why, never an internal error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.starter.make import Starter, make_starter
from tests.programming.robots import LINKAGES, SIX_AXES, joint, turning, written_urdf

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


@pytest.mark.parametrize("solid", [True, False], ids=["solid", "without geometry"])
@pytest.mark.parametrize("name", ODD_ARMS)
def test_an_odd_arm_gets_a_workspace_that_says_if_nothing_is_in_reach(tmp_path: Path, name: str, solid: bool) -> None:
    made = make_starter(tmp_path / "cell", str(urdf_of(tmp_path, ODD_ARMS[name], solid=solid)))
    assert isinstance(made, Starter)
    assert made.cubes or "nothing-in-reach" in [problem.code for problem in made.warnings]
    assert Cell.load(load_workspace(made.folder)).model.arm
