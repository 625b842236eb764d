"""What is found of an arm around its URDF."""

from pathlib import Path

import pytest

from sqrp_cli.starter.description import OwnRobot, describe_robot

URDF = '<robot name="ur5"><link name="base"/><link name="tip"/><joint name="j" type="fixed"><parent link="base"/>'
URDF += '<child link="tip"/></joint></robot>'


@pytest.mark.parametrize(
    ("named", "beside", "taken"),
    [
        ("ur5_robot", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5"),
        ("ur5_gripper", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5_gripper"),
        ("ur5_limited", ["ur3_gripper", "ur5_lim", "ur5_gripper"], "ur5_lim"),
    ],
)
def test_of_several_srdfs_the_one_is_taken_that_is_named_like_the_arm(
    tmp_path: Path, named: str, beside: list[str], taken: str
) -> None:
    (tmp_path / "urdf").mkdir()
    (tmp_path / "srdf").mkdir()
    (tmp_path / "urdf" / f"{named}.urdf").write_text(URDF)
    for name in beside:
        (tmp_path / "srdf" / f"{name}.srdf").write_text('<robot name="ur5"/>')
    found = describe_robot(OwnRobot(urdf=str(tmp_path / "urdf" / f"{named}.urdf")), tmp_path)
    assert Path(found.srdf.path).stem == taken
