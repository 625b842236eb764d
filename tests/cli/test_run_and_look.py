"""A run in which the robot has to move on before its cameras can judge a retry, and one with a camera on the arm."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.cells import shipped_cell, write_cell

ROOT = Path(__file__).parents[2]
ARM = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")


def run_in(cell: dict[str, Any], folder: Path, sqrp: Callable[..., Any], task: str, fault: str) -> Any:
    """A run of the fastest way of doing a task in a cell, with a fault."""
    write_cell(cell, folder)
    program = folder / "pick.yaml"
    assert sqrp("rank", folder, task, "--ways", "fastest", "--program", program).code == 0
    return sqrp("run", program, "--sim", "--fault", fault, "--json", "--log", folder / "run.jsonl")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("screws")


@pytest.fixture(scope="module")
def moved_on(sqrp: Callable[..., Any], folder: Path) -> Any:
    """A slip of red2 in a lift that is out of sight; a faster arm, fewer cameras, few and small images."""
    cell = shipped_cell("screws")
    cell["cameras"] = {name: {**cell["cameras"][name], "rate": "4 Hz"} for name in ("cam3", "cam4")}
    for camera in cell["cameras"].values():
        camera["image"] |= {"width": 1024, "height": 768}
    for limit, value in (("velocity", "45 deg/s"), ("acceleration", "300 deg/s^2"), ("jerk", "2000 deg/s^3")):
        cell["robot"]["limits"][limit] |= dict.fromkeys(ARM, value)
    return run_in(cell, folder, sqrp, "pickup_two_finger red2", "slip@a4+1.7")


def test_the_robot_moves_on_to_where_the_retry_can_be_judged(moved_on: Any) -> None:
    assert moved_on.code == 0, moved_on.document["reason"]
    (fault,) = moved_on.document["faults"]
    assert moved_on.document["steps"][0]["attempts"] == 2
    assert fault["moved_on"] > 0.3
    assert fault["detected"] + fault["moved_on"] < fault["acted"] < fault["recovered"]


def test_images_usually_show_that_the_place_between_open_fingers_is_empty(moved_on: Any) -> None:
    (usual,) = moved_on.document["usual"]
    told, wrong, others = (sum(counts[key] for counts in usual["hold(red2)"].values()) for key in ("tp", "fp", "fn"))
    assert wrong == 0
    assert told > 5 * others  # of images at the edge of a time


def test_what_no_image_shows_at_the_end_is_told_with_the_last_that_did(moved_on: Any, folder: Path) -> None:
    events = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    (retry,) = (event["t"] for event in events if event["event"] == "retry")
    looks = [event for event in events if event["event"] == "evidence" and event["exposed"] > retry]
    last = {
        atom: look["exposed"] for look in looks for atom, found in look["literals"].items() if found["value"] != "blind"
    }
    asked = [atom for look in looks[-3:] for atom, found in look["literals"].items() if found["asked"]]
    unseen = moved_on.document["steps"][0]["unseen"]
    assert unseen == {atom: last.get(atom) for atom in asked if last.get(atom) != looks[-1]["exposed"]}
    assert set(unseen) == {"hold(red2)", "obj_on_table(red2)", "open"}


@pytest.fixture(scope="module")
def from_the_hand(sqrp: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run of g2 that a fixed camera and one beside the suction cup watch, with a slip."""
    folder = tmp_path_factory.mktemp("hand")
    cell = shipped_cell("tabletop")
    hand = {"frame": "tool0", "pose": {"position": [0.0, -0.2, -0.1], "look_at": [0.0, 0.0, 0.2]}}
    seen = {"image": {"width": 640, "height": 480, "horizontal_fov": "60 deg"}, "near": "2 cm"}
    cell["cameras"] = {
        "cam3": {**cell["cameras"]["cam3"], "rate": "8 Hz"},
        "hand": {**hand, **seen, "rate": "8 Hz", "latency": "50 ms"},
    }
    cell["robot"]["limits"] = {"velocity": "120 deg/s", "acceleration": "400 deg/s^2", "jerk": "3000 deg/s^3"}
    return run_in(cell, folder, sqrp, "pickup g2", "slip@a4+1")


def test_a_camera_on_the_arm_sees_what_it_was_predicted_to_see(from_the_hand: Any) -> None:
    assert from_the_hand.code == 0, from_the_hand.document["reason"]
    counts = [cameras["hand"] for step in from_the_hand.document["prediction"] for cameras in step.values()]
    right, wrong = sum(found["tp"] for found in counts), sum(found["fp"] for found in counts)
    assert right > 20
    assert right >= 0.97 * (right + wrong), from_the_hand.document["disagreements"]
