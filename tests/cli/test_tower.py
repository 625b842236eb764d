"""A tower of three, built with `stack` by three calls of `sqrp rank` from a cell whose tool holds the first part."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.replay import Replay, assert_continuous, assert_limits, assert_straight

TASKS = ("stack red green", "pickup blue", "stack blue red")


@pytest.fixture(scope="module")
def tower(tabletop) -> Path:
    return tabletop.parent / "tower"


@pytest.fixture(scope="module")
def program(sqrp, tower, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("tower") / "tower.yaml"
    for index, task in enumerate(TASKS):
        after = ("--after", path) if index else ()
        assert sqrp("rank", tower, task, "--program", path, *after).code == 0
    return path


@pytest.fixture(scope="module")
def steps(program) -> list[Mapping]:
    return yaml.safe_load(program.read_text(encoding="utf-8"))["steps"]


def height(world: Mapping, name: str) -> float:
    return float(world["objects"][name][2][3])


def test_each_part_stands_where_the_tool_left_it_on_the_one_below(steps):
    world = steps[-1]["after"]
    assert height(world, "green") == pytest.approx(0.025)
    assert height(world, "red") == pytest.approx(0.05 + 0.02)
    assert height(world, "blue") == pytest.approx(0.05 + 0.04 + 0.02)
    poses = {name: np.array(world["objects"][name]) for name in ("green", "red", "blue")}
    for name in ("red", "blue"):
        assert poses[name][:2, 3] == pytest.approx(poses["green"][:2, 3], abs=1e-9)
        assert poses[name][:3, 2] == pytest.approx([0, 0, 1], abs=1e-9)  # upright


def test_literals_follow_the_parts(steps):
    facts = [set(step["after"]["facts"]) for step in steps]
    standing = {"obj_on_table(green)", "on(red, green)"}
    assert facts[0] == {*standing, "hand_empty", "obj_on_table(blue)"}
    assert facts[1] == {*standing, "hold(blue)"}
    assert facts[2] == {*standing, "hand_empty", "on(blue, red)"}
    assert [step["before"]["held"] for step in steps] == ["red", None, "blue"]
    assert [step["after"]["held"] for step in steps] == [None, "blue", None]


def test_the_program_lists_and_totals_its_steps(sqrp, program):
    listed = sqrp("program", program, "--json").document
    assert [step["task"] for step in listed["steps"]] == list(TASKS)
    assert listed["total"]["time"] == pytest.approx(sum(step["time"] for step in listed["steps"]))


def test_its_export_is_honest_in_pinocchio(sqrp, tower, program):
    export = program.with_name("tower.csv")
    assert sqrp("program", program, "--export", export, "--rate", "50 Hz").code == 0
    replay = Replay(sqrp("show", tower, "--json").document, export)
    assert_limits(replay)
    assert_continuous(replay)
    assert_straight(replay)
    assert replay.contacts() == set()


def test_a_full_hand_is_explained_with_a_plan_that_is_scored(sqrp, tower):
    outcome = sqrp("check", tower, "pickup blue", "--json")
    (candidate,) = outcome.document["candidates"]
    assert outcome.code == 1
    assert any("hand_empty" in reason for reason in candidate["reasons"])
    assert candidate["plan"]
    for step in candidate["plan"]:
        assert step["feasible"]
        assert 0.0 <= step["q_avg"] <= 1.0
        assert 0.0 <= step["q_eoi"] <= 1.0


def test_what_has_something_on_it_cannot_be_picked_up_before_that_is_taken_off(sqrp, tower, program):
    outcome = sqrp("check", tower, "pickup green", "--after", program, "--json")
    (candidate,) = outcome.document["candidates"]
    assert "`pickup` needs `not on(red, green)`, which does not hold" in candidate["reasons"]
    actions = [step["action"].split("(")[0] for step in candidate["plan"]]
    assert actions == ["unstack", "place", "unstack", "place"]
    assert all(step["feasible"] for step in candidate["plan"])


def test_what_is_shown_to_the_cameras_stays_in_the_tool(sqrp, tower):
    document = sqrp("explain", tower, "inspect red turn=0", "--json", "--samples", 5).document
    shown = next(p for p in document["primitives"] if p["name"] == "a2")
    assert shown["end"] - shown["start"] == pytest.approx(2.0)
    assert {sample["held"] for sample in document["samples"]} == {"red"}
    assert document["targets"]["inspected(red)"]["k"] == 2
