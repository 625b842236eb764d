"""Which joint a recording's numbers are of, and in which unit, follows from names, stated units and ranges."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.recording.episode import Episode, Recording
from sqrp_cli.starter.from_recording import guess_joints
from tests.cells import refused

LIMITS = {"shoulder_pan": (-1.9, 1.9), "elbow_flex": (-1.7, 1.7), "gripper": (-0.2, 1.8)}


def recorded(names: list[str], units: str = "") -> Recording:
    return Recording(
        path=Path("demo"),
        kind="table",
        names=tuple(names),
        units=dict.fromkeys(names, units),
        episodes=("0",),
        read=lambda _: Episode(np.arange(2.0), np.zeros((2, len(names))), np.arange(2)),
    )


def spans(*ends: tuple[float, float]) -> np.ndarray:
    return np.array(ends).T


@pytest.mark.parametrize(
    ("names", "units", "numbers", "meant"),
    [
        (["shoulder_pan.pos", "elbow_flex.pos", "gripper.pos"], "", [(-90, 80), (10, 70), (2, 95)], "deg"),
        (["main_shoulder_pan", "main_elbow_flex", "main_gripper"], "", [(-100, 99), (-80, 99.5), (2, 95)], "percent"),
        (
            ["observation.state.main_shoulder_pan.pos", "elbow_flex", "gripper"],
            "",
            [(-1.5, 1.2), (0.2, 1.0), (0.1, 1.5)],
            "rad",
        ),
        (["shoulder_pan", "elbow_flex"], "", [(-99.3, 80), (10, 70)], "deg"),  # one alone is near 100
        (["shoulder_pan", "elbow_flex"], "", [(-100, 80), (10, 70)], "percent"),
        (["j1", "j2", "j3"], "deg", [(-90, 80), (10, 70), (0, 80)], "deg"),  # in the order of the joints
        (["rax_1", "rax_2"], "deg", [(-90, 80), (10, 70)], "deg"),  # which a gripper does not count among
    ],
)
def test_units_and_joints_are_guessed(names, units, numbers, meant):
    found = guess_joints(recorded(names, units), spans(*numbers), LIMITS, "gripper", frozenset())
    assert [(one.name, one.joint) for one in found] == list(zip(names, LIMITS, strict=False))
    scale = {"deg": pi / 180, "rad": 1.0, "percent": 3.8 / 200}[meant]
    assert (found[0].scale, found[0].offset) == pytest.approx((scale, 0.0))
    jaw = found[-1]
    if meant != "rad" and not units and len(names) > 2:  # 0 to 100 from closed to open
        assert (jaw.offset, jaw.offset + 100 * jaw.scale) == pytest.approx((-0.2, 1.8))


@pytest.mark.parametrize(("stated", "scale"), [("deg", 1e-3), ("", 1e-3), ("mm", 1e-3), ("rad", 1.0)])
def test_a_rail_in_millimetres_is_no_joint_in_degrees(stated, scale):
    limits = {"j1": (-3.0, 3.0), "j2": (-2.0, 2.0), "j3": (0.0, 0.8)}
    recording = recorded(list(limits), "deg")
    recording.units["j3"] = stated
    rail = guess_joints(recording, spans((-90, 80), (10, 70), (20, 750)), limits, None, frozenset({"j3"}))[-1]
    assert (rail.scale, rail.offset) == (scale, 0.0)


def test_numbers_near_100_are_told_to_be_either():
    found = guess_joints(recorded(["shoulder_pan"]), spans((-99.3, 80)), LIMITS, "gripper", frozenset())
    assert found[0].why.endswith("taken as deg, though they may be percent")


def test_a_gripper_that_closes_upwards_is_closed_at_0():
    limits = {**LIMITS, "gripper": (1.8, -0.2)}
    names = [f"{name}.pos" for name in LIMITS]
    found = guess_joints(recorded(names), spans((-90, 80), (10, 70), (2, 95)), limits, "gripper", frozenset())
    assert (found[-1].offset, found[-1].offset + 100 * found[-1].scale) == pytest.approx((1.8, -0.2))


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["left/shoulder_pan.pos", "right/shoulder_pan.pos"], "two arms"),
        (["left_shoulder_pan.pos", "right_shoulder_pan.pos"], "two arms"),
        (["x", "y", "z"], "`x`, `y`, `z` are poses of a tool; expected positions of joints"),
        (["x", "y"], "none of its names is a joint of the robot: `x`, `y`; call its columns `shoulder_pan`, "),
    ],
)
def test_two_arms_and_another_robot_are_refused(names, says):
    problem = refused(guess_joints, recorded(names), np.zeros((2, 2)), LIMITS, "gripper", frozenset())
    assert says in f"{problem.message}; {problem.mend}"
