"""The joint trajectory that `program --export` writes, played by Pinocchio, which knows nothing of how it was made."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from sqrp_cli.recording.recording import open_recording
from sqrp_cli.show.pages.assembly import tidy
from tests.cli.browser import detail_in
from tests.replay import Replay, assert_continuous

RATE = 50


@pytest.fixture(scope="module")
def program(sqrp, tabletop, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "pick.yaml"
    assert sqrp("rank", tabletop, "pickup g2", "--program", path).code == 0
    return path


@pytest.fixture(scope="module")
def listed(sqrp, program):
    return sqrp("program", program, "--json").document


@pytest.fixture(scope="module")
def export(sqrp, program):
    path = program.with_name("pick.csv")
    assert sqrp("program", program, "--export", path, "--rate", f"{RATE} Hz").code == 0
    return path


@pytest.fixture(scope="module")
def replay(shown, export):
    return Replay(shown.document, export)


def test_what_is_exported_is_read_back_as_the_same_motion(sqrp, program, export, replay):
    ros = export.with_name("again.yaml")
    assert sqrp("program", program, "--export", ros, "--rate", RATE).code == 0
    for file, rate in ((program, RATE), (export, None), (ros, None)):
        found = open_recording(file, rate=rate)
        episode = found.read(0)
        np.testing.assert_allclose(episode.times, replay.t, atol=1e-9)
        columns = [found.names.index(name) for name in replay.joints if name in found.names]
        np.testing.assert_allclose(episode.values[:, columns], replay.q[:, : len(columns)], atol=1e-9)
        if "held" in found.names:
            held = [float(row["held"] != "") for row in replay.rows]
            np.testing.assert_array_equal(episode.values[:, found.names.index("held")], held)


def test_rows_and_the_ros_message_say_the_same_and_the_tool_is_told_once(replay, listed, shown, sqrp, program, export):
    # Every multiple of the period and every edge of a primitive has a row.
    end = listed["total"]["time"]
    edges = [edge for step in listed["steps"] for p in step["primitives"] for edge in (p["start"], p["end"])]
    assert np.abs(np.array(edges)[:, None] - replay.t).min(axis=1).max() < 1e-9
    multiples = np.arange(0, int(end * RATE) + 1) / RATE
    assert np.abs(multiples[:, None] - replay.t).min(axis=1).max() <= 0.01 / RATE
    assert (replay.t[0], replay.t[-1]) == (0.0, pytest.approx(end, abs=1e-9))
    assert len(replay.t) <= len(multiples) + len(set(edges))
    # The tool is told once to grasp when its tip is on the object.
    told = [index for index, row in enumerate(replay.rows) if row["tool"]]
    assert [replay.rows[index]["tool"] for index in told] == ["grasp g2"]
    top = np.array(shown.document["objects"]["g2"]["pose"])[:3, 3] + [0, 0, 0.02]
    np.testing.assert_allclose(replay.tool_pose(replay.q[told[0]]).translation, top, atol=1e-6)
    (command,) = listed["tool"]
    assert (command["action"], command["object"], command["step"]) == ("grasp", "g2", 1)
    assert command["start"] == pytest.approx(replay.t[told[0]], abs=1e-9)
    first_held = next(index for index, row in enumerate(replay.rows) if row["held"])
    assert command["end"] == pytest.approx(replay.t[first_held], abs=1e-9)
    assert {row["held"] for row in replay.rows[first_held:]} == {"g2"}
    assert np.abs(replay.v[told[0] : first_held + 1]).max() < 1e-8
    # The ros message says the same.
    path = export.with_name("ros.yaml")
    assert sqrp("program", program, "--export", path, "--rate", RATE).code == 0
    text = path.read_text(encoding="utf-8")
    message = yaml.load(text, Loader=yaml.CSafeLoader)
    assert set(message) == {"header", "joint_names", "points"}
    fields = {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    assert all(set(point) == fields for point in message["points"])
    columns = [message["joint_names"].index(joint) for joint in replay.joints]
    for field, expected in (("positions", replay.q), ("velocities", replay.v), ("accelerations", replay.a)):
        np.testing.assert_array_equal(np.array([point[field] for point in message["points"]])[:, columns], expected)
    times = [point["time_from_start"] for point in message["points"]]
    assert all(0 <= time["nanosec"] < 10**9 for time in times)
    np.testing.assert_allclose([time["sec"] + 1e-9 * time["nanosec"] for time in times], replay.t, atol=1e-12)
    assert "# step 1, a3: grasp, grasp g2" in text


@pytest.mark.parametrize("of", ["replay", "tower_replay"])
def test_derivatives_belong_together(request, of):
    assert_continuous(request.getfixturevalue(of))


def test_the_check_for_contacts_does_see_some(replay, monkeypatch):
    monkeypatch.setattr(replay, "q", replay.q[0] + np.outer(np.ones(len(replay.q)), [0, 1.3, 0, 0, 0, 0]))
    assert any("table" in pair for pair in replay.contacts())


def test_fingers_move_in_the_table_but_are_left_out_of_the_arm_controllers_message(sqrp, gripper, tmp_path):
    program = tmp_path / "fingers.yaml"
    assert sqrp("rank", gripper, "pickup_two_finger can", "--program", program).code == 0
    for name in ("out.csv", "out.yaml"):
        assert sqrp("program", program, "--export", tmp_path / name, "--rate", 10).code == 0
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    fingers = [float(row["position_left_finger_joint"]) for row in rows]
    assert fingers[0] == pytest.approx(0.04)
    assert fingers[-1] < fingers[0]
    grasping = [index for index, row in enumerate(rows) if row["action"] == "grasp"]
    assert all(fingers[index] == fingers[0] for index in range(grasping[0] + 1))
    message = yaml.load((tmp_path / "out.yaml").read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    assert len(message["joint_names"]) == 6
    assert not any("finger" in joint for joint in message["joint_names"])
    assert all(len(point["positions"]) == 6 for point in message["points"])


# A tower of three, built by three `rank` calls

TOWER = Path(__file__).parents[2] / "workspaces" / "tower"
STEPS = ("stack red green", "pickup blue", "stack blue red")


@pytest.fixture(scope="module")
def tower(sqrp, tmp_path_factory):
    path = tmp_path_factory.mktemp("tower") / "tower.yaml"
    for task in STEPS:
        assert sqrp("rank", TOWER, task, "--program", path).code == 0
    return path


@pytest.fixture(scope="module")
def tower_replay(sqrp, tower):
    export = tower.with_suffix(".csv")
    assert sqrp("program", tower, "--export", export, "--rate", 40).code == 0
    return Replay(sqrp("show", TOWER, "--json").document, export)


def test_the_program_lists_its_steps_and_what_the_tool_does(sqrp, tower):
    document = sqrp("program", tower, "--json").document
    assert [step["task"] for step in document["steps"]] == list(STEPS)
    assert document["total"]["time"] == pytest.approx(sum(step["time"] for step in document["steps"]))
    told = [(command["action"], command["object"]) for command in document["tool"]]
    assert told == [("release", "red"), ("grasp", "blue"), ("release", "blue")]


def test_a_tower_stands_in_the_end(tower_replay):
    assert tower_replay.contacts() == set()  # which follows the objects to where they end
    green, red, blue = (tower_replay.X_WO[name].translation for name in ("green", "red", "blue"))
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
