"""The program file that `rank --program` writes, against what `explain --json` says of the same candidate."""

from __future__ import annotations

import errno
import os
import stat
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sqrp_cli.ask.api import session
from sqrp_cli.program.file import check_unedited, load_program, save_program

Document = dict[str, Any]

TASK = "pickup green"
SHEBANG = "#!/usr/bin/env -S sqrp run --sim"


@pytest.fixture(scope="module")
def program(tabletop_written):
    """The best way of the tabletop's task as a program."""
    return tabletop_written.program


@pytest.fixture(scope="module")
def step(program):
    (step,) = yaml.safe_load(program.read_text(encoding="utf-8"))["steps"]
    return step


@pytest.fixture(scope="module")
def best(explained):
    return explained.document["candidates"][0]


@pytest.mark.slow
def test_a_program_can_be_executed_as_it_stands(program):
    assert program.read_text(encoding="utf-8").splitlines()[0] == SHEBANG
    mode = program.stat().st_mode
    assert mode & stat.S_IXUSR
    assert mode & stat.S_IRUSR


def test_a_program_holds_nothing_but_plain_yaml(program, tabletop):
    document = yaml.safe_load(program.read_text(encoding="utf-8"))
    assert (program.parent / document["workspace"]).resolve() == (tabletop / "workspace.yaml").resolve()
    assert document["digest"]
    assert len(document["steps"]) == 1


def test_the_step_is_the_best_candidate_with_its_figures(step, best, ranked):
    ways = [document["ways"]["pareto"][0] for document in (best, ranked.document["candidates"][0])]
    assert [step["parameters"]] * 2 == [way["parameters"] for way in ways]
    assert best["parameters"] == ranked.document["candidates"][0]["parameters"]
    assert step["parameters"]["object"] == best["parameters"]["object"]
    assert "any" not in step["parameters"].values()
    assert (step["task"], step["skill"]) == (TASK, "pickup")
    assert step["time"] == best["time"]
    for figure in ("q_avg", "q_eoi"):
        assert step[figure] == pytest.approx(best[figure], abs=2e-3)
    assert set(step["faults"]) == set(best["faults"])


def test_primitives_have_the_times_of_the_explanation(step, best):
    times = [{name: primitive[name] for name in ("name", "does", "start", "end")} for primitive in step["primitives"]]
    assert times == best["primitives"]


def test_reading_it_back_gives_the_same_trajectory(program, best):
    (step,) = load_program(program).steps
    joints = load_program(program).joints
    for primitive in step.primitives:
        trajectory = primitive.trajectory
        assert trajectory.duration == pytest.approx(primitive.end - primitive.start, abs=1e-9)
        for sample in best["samples"]:
            if primitive.start <= sample["t"] <= primitive.end:
                q = trajectory.positions(np.array([sample["t"] - primitive.start]))[0]
                assert q == pytest.approx([sample["q"][joint] for joint in joints], abs=1e-9)


def test_formulas_carry_their_times_in_seconds(step, best):
    texts = " ".join(formula["formula"] for formula in step["formulas"])
    assert not any(primitive["name"] in texts for primitive in best["primitives"])
    for primitive in best["primitives"]:
        if primitive["name"] in ("a4", "a5"):
            assert f"{primitive['start']:.3f}" in texts or repr(primitive["start"]) in texts
    faults = [formula for formula in step["formulas"] if formula["fault"]]
    assert {formula["fault"] for formula in faults} == set(best["faults"])
    assert all(formula["response"]["action"] in ("stop", "retry", "continue") for formula in step["formulas"])


def seen_intervals(document: Document, literals: tuple[str, str], camera: str) -> list[list[float]]:
    """From the first to the last of neighbouring samples in which a camera covers a literal or its negation."""
    intervals: list[list[float]] = []
    going = False
    for sample in document["samples"]:
        found = next((sample["literals"][name] for name in literals if name in sample["literals"]), None)
        if found is None or not found["cameras"][camera]["covered"]:
            going = False
            continue
        if going or (intervals and intervals[-1][1] == sample["t"]):
            intervals[-1][1] = sample["t"]
        else:
            intervals.append([sample["t"], sample["t"]])
        going = True
    return intervals


def test_what_each_camera_sees_when_agrees_with_the_samples(step, best):
    found = 0
    for atom, target in step["targets"].items():
        for camera, intervals in target["seen"].items():
            expected = seen_intervals(best, (atom, f"not {atom}"), camera)
            assert intervals == [pytest.approx(interval, abs=1e-9) for interval in expected], (atom, camera)
            found += len(intervals)
    assert found
    assert {name.removeprefix("not ") for name in best["targets"]} == set(step["targets"])


def test_the_world_before_is_the_workspace_as_it_stands(step, shown):
    show = shown.document
    before = step["before"]
    assert sorted(before["facts"]) == sorted(show["state"])
    assert before["objects"] == {name: thing["pose"] for name, thing in show["objects"].items() if thing["pose"]}
    assert (before["held"], before["held_pose"]) == (None, None)
    assert before["joints"] == pytest.approx({name: show["robot"]["home"][name] for name in before["joints"]})


def test_the_world_after_has_the_effect_of_the_action_and_where_things_are_then(step, best):
    grasped = best["parameters"]["object"]
    before, after = step["before"], step["after"]
    assert set(after["facts"]) == (set(before["facts"]) - {f"obj_on_table({grasped})", "hand_empty"}) | {
        f"hold({grasped})"
    }
    last = best["samples"][-1]
    assert after["held"] == grasped == last["held"]
    for name, pose in last["objects"].items():
        assert np.array(after["objects"][name]) == pytest.approx(np.array(pose), abs=1e-9)
        assert name == grasped or after["objects"][name] == before["objects"][name]
    assert after["joints"] == pytest.approx({name: last["q"][name] for name in after["joints"]}, abs=1e-9)


def test_after_a_pickup_nothing_else_can_be_picked_up(sqrp, tabletop, program):
    outcome = sqrp("rank", tabletop, TASK, "--after", program, "--json")
    assert outcome.code == 1, outcome.err
    for candidate in outcome.document["candidates"]:
        assert any("hand_empty" in reason for reason in candidate["reasons"])
    assert sqrp("explain", tabletop, TASK, "--after", program, "--json").code == 1


def test_a_second_step_begins_where_the_first_ends(sqrp, watch, tmp_path):
    path = tmp_path / "program.yaml"
    assert sqrp("rank", watch, "watch seen", "--program", path).code == 0
    assert sqrp("rank", watch, "watch turned", "--program", path).code == 0
    steps = yaml.safe_load(path.read_text(encoding="utf-8"))["steps"]
    assert [step["parameters"]["object"] for step in steps] == ["seen", "turned"]
    assert all(first["after"] == then["before"] for first, then in pairwise(steps))
    assert "watched(seen)" in steps[1]["before"]["facts"]
    assert {"watched(seen)", "watched(turned)"} <= set(steps[1]["after"]["facts"])
    assert path.read_text(encoding="utf-8").splitlines()[0] == SHEBANG


def test_a_program_that_changes_while_its_next_step_is_computed_is_left_as_it_is(sqrp, tabletop, tmp_path, monkeypatch):
    path, other = tmp_path / "program.yaml", tmp_path / "other.yaml"
    assert sqrp("rank", tabletop, "pickup g2", "--program", other).code == 0
    finished = session.make_step

    def made_too_late(*arguments):
        path.write_text(other.read_text())
        return finished(*arguments)

    monkeypatch.setattr(session, "make_step", made_too_late)
    outcome = sqrp("rank", tabletop, "pickup g5", "--program", path)
    assert (outcome.code, outcome.out) == (2, "")
    told = " ".join(outcome.err.split())
    assert "another command has changed this program meanwhile: it ends with step 1, pickup g2, and `pickup g5`" in told
    assert "with another file after --program both are kept" in told
    assert path.read_text() == other.read_text()


def test_a_chosen_candidate_becomes_the_step(sqrp, watch, tmp_path):
    path = tmp_path / "program.yaml"
    assert sqrp("rank", watch, "watch cube", "--program", path, "--choose", "turned").code == 0
    (step,) = yaml.safe_load(path.read_text(encoding="utf-8"))["steps"]
    assert step["parameters"] == {"object": "turned"}
    assert step["q_avg"] == pytest.approx(0.6, abs=1e-9)
    figures = {"delay_mean": 0.1, "delay_worst": 0.15, "blind_longest": 0.0, "unseen": 0.0, "expected_time": 6.6}
    assert step["faults"] == {"moved": pytest.approx(figures, abs=1e-9)}


def test_a_program_says_when_the_hand_worked_cell_is_seen(sqrp, watch, tmp_path):
    path = tmp_path / "program.yaml"
    assert sqrp("rank", watch, "watch turned", "--program", path).code == 0
    (step,) = yaml.safe_load(path.read_text(encoding="utf-8"))["steps"]
    assert step["targets"]["in_place(turned)"]["seen"] == {"eye": [[0.0, 1.5], [2.0, 3.0]]}
    assert step["targets"]["faces(turned)"]["seen"] == {"eye": []}
    assert (step["primitives"][0]["start"], step["primitives"][-1]["end"]) == (0.0, 4.0)


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_program_as_it_was(sqrp, watch, tmp_path, monkeypatch, call):
    path = tmp_path / "program.yaml"
    assert sqrp("rank", watch, "watch seen", "--program", path).code == 0
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, call, full)
    monkeypatch.setattr(Path, "replace", full) if call == "replace" else None
    outcome = sqrp("rank", watch, "watch turned", "--program", path)
    assert outcome.code == 2
    assert "No space left" in outcome.err
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_the_same_choice_writes_the_same_program(sqrp, tabletop, tmp_path):
    one, other = tmp_path / "one.yaml", tmp_path / "other.yaml"
    for path in (one, other):
        assert sqrp("rank", tabletop, "pickup g2", "--program", path).code == 0
    assert one.read_bytes() == other.read_bytes()


def test_a_program_of_a_version_that_knew_no_usual_images_is_not_taken_for_edited(program, tmp_path):
    path, written = tmp_path / "old.yaml", load_program(program)
    (step,) = written.steps
    targets = {atom: target.model_copy(update={"usual": {}}) for atom, target in step.targets.items()}
    save_program(written.model_copy(update={"steps": (step.model_copy(update={"targets": targets}),)}), path)
    assert "usual" not in path.read_text(encoding="utf-8")
    check_unedited(load_program(path), path)
