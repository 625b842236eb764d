"""Links that touch by design, in arms of which that can be told by hand."""

from __future__ import annotations

from pathlib import Path

from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.self_contacts import find_self_contacts
from tests.programming.robots import joint, robot


def arm(folder: Path, home: float) -> RobotModel:
    """Three joints about z, 0.3 m apart; a long bar on the last link, and a disc around the first joint on the third.

    The bar of `l3` sweeps over the post of `base` only where the arm is folded; the disc of `l2` always covers the
    block on the base, whichever way it turns.
    """
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    joints = [
        joint("j1", "base", "l1", "revolute", "0 0 0.2", "0 0 1", limit),
        joint("j2", "l1", "l2", "revolute", "0 0 0.1", "0 0 1", limit),
        joint("j3", "l2", "l3", "revolute", "0.3 0 0.1", "0 0 1", limit),
    ]

    def link(name: str, shape: str, xyz: str) -> str:
        return f'<link name="{name}"><collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision></link>'

    links = [
        link("base", '<box size="0.1 0.1 0.29"/>', "0 0 0.145"),
        link("l1", '<sphere radius="0.02"/>', "0 0 0.5"),
        link("l2", '<cylinder radius="0.2" length="0.05"/>', "0 0 0"),
        link("l3", '<box size="0.3 0.02 0.02"/>', "0.15 0 -0.15"),
    ]
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(links)}{"".join(joints)}</robot>')
    return RobotModel.load(robot(path, "l3", home={"j1": 0.0, "j2": 0.0, "j3": home}))


def test_pairs_that_always_touch_or_touch_at_home_are_told_from_those_that_never_do(tmp_path: Path) -> None:
    stretched = find_self_contacts(arm(tmp_path, home=0.0), seed=0)
    assert stretched.always == {("base", "l2")}
    assert stretched.at_home == {("base", "l2")}
    assert stretched.never == {("l1", "l3")}
    assert stretched.unchecked == {("base", "l2")}
    folded = find_self_contacts(arm(tmp_path, home=3.0), seed=0)
    assert folded.unchecked == {("base", "l2"), ("base", "l3")}


def test_the_seed_alone_decides(tmp_path: Path) -> None:
    assert find_self_contacts(arm(tmp_path, 0.0), 4) == find_self_contacts(arm(tmp_path, 0.0), 4)
