"""The program file that `rank --program` writes, against `explain --json`; what lists and shortens it."""

from __future__ import annotations

import shutil
import stat
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from sqrp_cli.ask.api import session
from sqrp_cli.cli.completion import tasks
from sqrp_cli.program.file import check_unedited, load_program, save_program
from tests.cells import edit

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


def test_a_program_holds_nothing_but_plain_yaml_and_can_be_executed_as_it_stands(program, tabletop):
    text = program.read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    assert (program.parent / document["workspace"]).resolve() == (tabletop / "workspace.yaml").resolve()
    assert document["digest"]
    assert len(document["steps"]) == 1
    assert text.splitlines()[0] == SHEBANG
    assert program.stat().st_mode & (stat.S_IXUSR | stat.S_IRUSR) == stat.S_IXUSR | stat.S_IRUSR


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
    times = [{name: primitive[name] for name in ("name", "does", "start", "end")} for primitive in step["primitives"]]
    assert times == best["primitives"]


def test_it_is_read_back_with_its_trajectory_and_formulas_in_seconds(program, best, step):
    # Reading it back gives the same trajectory.
    read = load_program(program)
    joints = read.joints
    for primitive in read.steps[0].primitives:
        trajectory = primitive.trajectory
        assert trajectory.duration == pytest.approx(primitive.end - primitive.start, abs=1e-9)
        for sample in best["samples"]:
            if primitive.start <= sample["t"] <= primitive.end:
                q = trajectory.positions(np.array([sample["t"] - primitive.start]))[0]
                assert q == pytest.approx([sample["q"][joint] for joint in joints], abs=1e-9)
    # Formulas carry their times in seconds.
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


def test_what_cameras_see_and_worlds_agree_with_the_document(step, best, shown):
    # What each camera sees when agrees with the samples.
    found = 0
    for atom, target in step["targets"].items():
        for camera, intervals in target["seen"].items():
            expected = seen_intervals(best, (atom, f"not {atom}"), camera)
            assert intervals == [pytest.approx(interval, abs=1e-9) for interval in expected], (atom, camera)
            found += len(intervals)
    assert found
    assert {name.removeprefix("not ") for name in best["targets"]} == set(step["targets"])
    # The worlds before and after are the workspace and what the action makes of it.
    show, before, after = shown.document, step["before"], step["after"]
    grasped, last = best["parameters"]["object"], best["samples"][-1]
    assert sorted(before["facts"]) == sorted(show["state"])
    assert before["objects"] == {name: thing["pose"] for name, thing in show["objects"].items() if thing["pose"]}
    assert (before["held"], before["held_pose"]) == (None, None)
    assert before["joints"] == pytest.approx({name: show["robot"]["home"][name] for name in before["joints"]})
    effect = {f"obj_on_table({grasped})", "hand_empty"}
    assert set(after["facts"]) == (set(before["facts"]) - effect) | {f"hold({grasped})"}
    assert after["held"] == grasped == last["held"]
    for name, pose in last["objects"].items():
        assert np.array(after["objects"][name]) == pytest.approx(np.array(pose), abs=1e-9)
        assert name == grasped or after["objects"][name] == before["objects"][name]
    assert after["joints"] == pytest.approx({name: last["q"][name] for name in after["joints"]}, abs=1e-9)


@pytest.fixture(scope="module")
def two(sqrp, watch, tmp_path_factory):
    """A copy of the hand-worked cell, and a program of 4 s `seen`, all the time, and 4 s `turned`, at 60 % of it."""
    folder = tmp_path_factory.mktemp("two")
    shutil.copytree(watch, folder / "watch")
    for task, *choice in (["watch seen"], ["watch cube", "--choose", "turned"]):
        assert sqrp("rank", folder / "watch", task, *choice, "--program", folder / "program.yaml").code == 0
    return folder


@pytest.fixture
def folder(two, tmp_path):
    """A copy of both, to be changed."""
    return Path(shutil.copytree(two, tmp_path / "own"))


def test_a_second_step_begins_where_the_first_ends_and_totals_weight_quality_with_time(sqrp, two, tmp_path):
    text = (two / "program.yaml").read_text(encoding="utf-8")
    assert text.splitlines()[0] == SHEBANG
    first, then = steps = yaml.safe_load(text)["steps"]
    assert [step["parameters"] for step in steps] == [{"object": "seen"}, {"object": "turned"}]
    assert first["after"] == then["before"]
    assert "watched(seen)" in then["before"]["facts"]
    assert {"watched(seen)", "watched(turned)"} <= set(then["after"]["facts"])
    assert then["q_avg"] == pytest.approx(0.6, abs=1e-9)
    figures = {"delay_mean": 0.1, "delay_worst": 0.15, "blind_longest": 0.0, "unseen": 0.0, "expected_time": 6.6}
    assert then["faults"] == {"moved": pytest.approx(figures, abs=1e-9)}
    assert then["targets"]["in_place(turned)"]["seen"] == {"eye": [[0.0, 1.5], [2.0, 3.0]]}
    assert then["targets"]["faces(turned)"]["seen"] == {"eye": []}
    assert (then["primitives"][0]["start"], then["primitives"][-1]["end"]) == (0.0, 4.0)
    outcome = sqrp("program", two / "program.yaml", "--json")
    document, total = outcome.document, outcome.document["total"]
    assert (outcome.code, outcome.err, document["stale"], document["tool"]) == (0, "", False, [])
    assert [(step["start"], step["end"]) for step in document["steps"]] == [(0.0, 4.0), (4.0, 8.0)]
    assert (total["time"], total["q_avg"], total["delay_worst"]) == (8.0, pytest.approx(0.8), pytest.approx(0.15))
    for step, listed in zip(steps, document["steps"], strict=True):
        assert all(step[name] == listed[name] for name in ("task", "skill", "time", "q_avg", "faults"))
    (tmp_path / "listing.json").write_text(outcome.out, encoding="utf-8")
    assert sqrp("show", tmp_path / "listing.json").out == sqrp("program", two / "program.yaml").out


def test_a_program_that_could_not_be_read_again_is_not_written(sqrp, folder, monkeypatch):
    path = folder / "program.yaml"
    before = path.read_bytes()
    monkeypatch.setattr("sqrp_cli.program.file.MAX_BYTES", len(before))
    outcome = sqrp("rank", folder / "watch", "watch seen", "--program", path)
    assert (outcome.code, "3 steps" in outcome.err, f"--after {path}" in outcome.err) == (2, True, True)
    assert path.read_bytes() == before


def test_what_a_program_keeps_of_its_workspace_is_believed_only_as_it_was_written(sqrp, folder):
    edit(folder / "watch", "near: 50 cm", "near: 51 cm")
    edit(folder / "program.yaml", "near: 0.5", "near: 0.51")
    assert sqrp("program", folder / "program.yaml", "--json").document["stale"] is True


def test_a_program_holds_when_the_order_of_keys_changes(sqrp, folder):
    file = folder / "watch" / "workspace.yaml"
    parts = file.read_text(encoding="utf-8").split("\n\n")
    file.write_text("\n\n".join([parts[0], *reversed(parts[1:])]), encoding="utf-8")
    outcome = sqrp("program", folder / "program.yaml", "--json")
    assert (outcome.code, outcome.err, outcome.document["stale"]) == (0, "", False)


@pytest.mark.parametrize("command", [["check"], ["rank"], ["explain"], ["advise", "--want", "q_avg 1 %"]])
def test_a_program_in_place_of_a_workspace_starts_where_it_ends(sqrp, two, command):
    (name, *options), program, task = command, two / "program.yaml", "watch high"
    told = sqrp(name, program, task, *options, "--jobs", 1, "--json")
    assert told.out == sqrp(name, two / "watch", task, "--after", program, *options, "--jobs", 1, "--json").out
    assert told.code in (0, 1)
    assert told.document["task"] == task


def test_a_shell_proposes_tasks_after_a_program(two):
    parameters = {"workspace": two / "program.yaml"}
    assert "watch seen" in tasks(SimpleNamespace(params=parameters), "watch s")


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


def test_a_program_of_a_version_that_knew_no_usual_images_is_not_taken_for_edited(program, tmp_path):
    path, written = tmp_path / "old.yaml", load_program(program)
    (step,) = written.steps
    targets = {atom: target.model_copy(update={"usual": {}}) for atom, target in step.targets.items()}
    save_program(written.model_copy(update={"steps": (step.model_copy(update={"targets": targets}),)}), path)
    assert "usual" not in path.read_text(encoding="utf-8")
    check_unedited(load_program(path), path)
