"""A tower of three, built by three `rank` calls and played from its export by Pinocchio alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.show.pages.assembly import tidy
from tests.cli.pages import detail_in
from tests.replay import Replay, assert_continuous, assert_limits, assert_straight

TOWER = Path(__file__).parents[2] / "workspaces" / "tower"
STEPS = ("stack red green", "pickup blue", "stack blue red")


@pytest.fixture(scope="module")
def program(sqrp, tmp_path_factory):
    path = tmp_path_factory.mktemp("tower") / "tower.yaml"
    for task in STEPS:
        assert sqrp("rank", TOWER, task, "--program", path).code == 0
    return path


@pytest.fixture(scope="module")
def replay(sqrp, program):
    export = program.with_suffix(".csv")
    assert sqrp("program", program, "--export", export, "--rate", 40).code == 0
    return Replay(sqrp("show", TOWER, "--json").document, export)


def test_the_program_lists_its_steps_and_what_the_tool_does(sqrp, program):
    document = sqrp("program", program, "--json").document
    assert [step["task"] for step in document["steps"]] == list(STEPS)
    assert document["total"]["time"] == pytest.approx(sum(step["time"] for step in document["steps"]))
    told = [(command["action"], command["object"]) for command in document["tool"]]
    assert told == [("release", "red"), ("grasp", "blue"), ("release", "blue")]


def test_the_export_keeps_limits_and_is_continuous_and_straight(replay):
    assert_limits(replay)
    assert_continuous(replay)
    assert_straight(replay)


def test_nothing_touches_and_a_tower_stands_in_the_end(replay):
    assert replay.contacts() == set()
    green, red, blue = (replay.X_WO[name].translation for name in ("green", "red", "blue"))
    # Cubes of 5, 4 and 4 cm; what is put down stands at most 1 mm above what it stands on.
    for below, above, height in ((green, red, 0.045), (red, blue, 0.04)):
        np.testing.assert_allclose((above - below)[:2], 0, atol=1e-3)
        assert height - 1e-6 <= (above - below)[2] <= height + 2e-3


def test_a_page_of_scores_begins_with_the_object_in_the_tool_as_the_scores_do(sqrp, tmp_path):
    page = tmp_path / "page.html"
    assert sqrp("score", TOWER, "--report", page).code == 0
    explained = sqrp("explain", TOWER, STEPS[0], "--json").document
    shown = detail_in(page)
    assert shown["samples"][0]["held"] == explained["samples"][0]["held"] == "red"
    for figures in ("q_avg", "q_eoi", "time", "primitives", "formulas"):
        assert shown[figures] == tidy(explained[figures])
