"""Whole runs in a small, fast cell: two cameras, few frames, a quick arm; `make trials` has the long ones."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import yaml

from sqrp_cli.ask.api.program import OpenProgram
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.record.events import Event
from sqrp_cli.run.record.report import FaultRecord, RunReport
from tests.cells import made_cell, read_cell, write_cell
from tests.cli.conftest import press_ctrl_c
from tests.cli.slip_run import RATE, Cell

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cell(quick_cell):
    return quick_cell


@pytest.fixture(scope="module")
def slip(slip_run):
    """A run with a slip in the lift, whose log and frames are kept."""
    return slip_run.outcome


def test_a_slip_is_seen_retried_and_the_task_done_as_images_were_predicted_to_show(slip):
    # A slip is seen retried and the task done.
    assert slip.code == 0, slip.err
    (fault,) = slip.document["faults"]
    (step,) = slip.document["steps"]
    assert slip.document["outcome"] == "done"
    assert (fault["name"], step["attempts"]) == ("slip", 2)
    assert fault["injected"] <= fault["happened"] <= fault["detected"] < fault["acted"] < fault["recovered"]
    assert fault["recovered"] <= step["end"] + 1e-6
    assert 0 < fault["delay"] <= fault["predicted_delay"] + 0.002
    # What was predicted to be seen is seen.
    (step,) = slip.document["prediction"]
    counts = [found for cameras in step.values() for found in cameras.values()]
    right, wrong = sum(found["tp"] for found in counts), sum(found["fp"] for found in counts)
    assert right > 30
    assert right >= 0.97 * (right + wrong)
    assert all(found.keys() == {"tp", "tn", "fp", "fn"} for found in counts)
    # Images that were not promised show what they usually do and hardly anything else.
    (promised,), (usual,) = slip.document["prediction"], slip.document["usual"]
    assert {atom: set(cameras) for atom, cameras in usual.items()} == {atom: set(of) for atom, of in promised.items()}
    told, wrong, others = (
        sum(counts[key] for of in usual.values() for counts in of.values()) for key in ("tp", "fp", "fn")
    )
    assert told + others == sum(counts["fn"] for of in promised.values() for counts in of.values())
    assert told > others
    assert wrong == 0


def test_recorded_frames_confirm_the_predictions(asked, slip, cell):
    assert slip.code == 0
    found = asked("audit", cell.program, cell.folder / "frames", "--json")
    assert found.code == 0, found.err
    assert found.document["precision"] >= 0.97
    assert found.document["images"] > 40
    assert found.document["skipped"] > 0  # those after the slip


@pytest.mark.parametrize(
    ("fault", "says"), [("camera-loss:cam3@0.3", "cam3 is lost"), ("perception-crash:cam3@1.0", "has ended")]
)
def test_a_lost_camera_or_a_killed_process_stops_the_robot_in_time_and_a_loss_gives_the_same_log_again(
    sqrp, cell, tmp_path, fault, says
):
    logs = [tmp_path / f"{number}.jsonl" for number in range(2 if "loss" in fault else 1)]
    for log in logs:
        run = sqrp("run", cell.program, "--sim", "--fault", fault, "--json", "--log", log)
        assert (run.code, run.document["outcome"]) == (3, "stopped")
        assert says in run.document["reason"]
        assert run.document["stop"]["standing"] - run.document["faults"][0]["injected"] <= 0.5
    assert len({log.read_bytes() for log in logs}) == 1
    lines = [json.loads(line) for line in logs[0].read_bytes().splitlines()]
    assert [lines[0]["event"], lines[-1]["event"]] == ["run", "report"]


@pytest.fixture(scope="module")
def uneven(sqrp, cell, tmp_path_factory):
    """A run with a slip, whose cameras are late by different times; the one that sees the slip is the slower one."""
    folder = tmp_path_factory.mktemp("uneven")
    workspace = read_cell(cell.folder)
    workspace["cameras"]["cam3"]["latency"] = "80 ms"
    write_cell(workspace, folder)
    program = folder / "pick.yaml"
    assert sqrp("rank", folder, "pickup g2", "--ways", "fastest", "--program", program).code == 0
    outputs = ("--log", folder / "run.jsonl", "--report", folder / "run.html")
    return sqrp("run", program, "--sim", "--fault", "slip@a4+1", "--json", *outputs), folder


def test_cameras_may_be_late_by_different_times(uneven, slip):
    run, _ = uneven
    assert run.code == 0, run.err
    (fault,), (evenly,) = run.document["faults"], slip.document["faults"]
    assert fault["predicted_delay"] == pytest.approx(evenly["predicted_delay"] + 0.03)
    assert (fault["detected"] - 0.08) * RATE == pytest.approx(round((fault["detected"] - 0.08) * RATE), abs=1e-6)
    assert 0 < fault["delay"] <= fault["predicted_delay"]


def test_a_log_of_cameras_that_are_late_by_different_times_shows_the_run_again(sqrp, uneven):
    run, folder = uneven
    page = folder / "again.html"
    again = sqrp("run", folder / "pick.yaml", "--replay", folder / "run.jsonl", "--report", page, "--json")
    assert again.code == 0, again.err
    assert {**again.document, "wall": 0} == {**run.document, "wall": 0}
    assert page.stat().st_size > 0.9 * (folder / "run.html").stat().st_size
    told = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    evidence = [event for event in told if event["event"] == "evidence"]
    assert {round(event["t"] - event["exposed"], 2) for event in evidence} == {0.05, 0.08}


def test_faults_come_several_at_once_and_outlast_a_retry(sqrp, cell):
    (step,) = yaml.safe_load(cell.program.read_text(encoding="utf-8"))["steps"]
    lift = next(primitive["start"] for primitive in step["primitives"] if primitive["name"] == "a4")
    found = sqrp(
        "run", cell.program, "--sim", "--fault", f"slip@{lift + 1}", "--fault", f"camera-loss:cam3@{lift + 4}", "--json"
    )
    assert found.code == 3, found.err
    slip, loss = found.document["faults"]
    assert (slip["name"], loss["name"]) == ("slip", "camera-loss")
    assert slip["acted"] < loss["injected"] < loss["detected"]
    assert slip["recovered"] is None
    assert "cam3 is lost" in found.document["reason"]


@pytest.fixture(scope="module")
def two_steps(sqrp, tmp_path_factory):
    """A program that puts down what the tool holds before it picks up something else, with a faster arm."""
    folder = tmp_path_factory.mktemp("two")
    made_cell("two_steps", folder)
    program = folder / "two.yaml"
    assert sqrp("check", folder, "pickup blue", "--program", program).code == 0
    return Cell(program, folder)


def test_a_fault_happens_in_the_step_that_is_told(sqrp, two_steps):
    log = two_steps.folder / "run.jsonl"
    faults = ("--fault", "2:camera-loss:right@0.3", "--fault", "2:camera-loss:left@0.3")
    found = sqrp("run", two_steps.program, "--sim", *faults, "--json", "--log", log)
    assert found.code == 3, found.err
    events = map(json.loads, log.read_text(encoding="utf-8").splitlines())
    second = next(event["t"] for event in events if event.get("number") == 2)
    times = {fault["camera"]: (fault["injected"] - second, fault["detected"]) for fault in found.document["faults"]}
    assert [fault["name"] for fault in found.document["faults"]] == ["camera-loss"] * 2
    assert all(0.3 <= since <= 0.5 for since, _ in times.values()), "after a first look at where things are"
    assert "left and right are lost" in found.document["reason"]
    assert times["left"][1] == times["right"][1] is not None
    again = sqrp("run", "--replay", log, "--json")
    assert {**again.document, "wall": 0} == {**found.document, "wall": 0}


@pytest.mark.parametrize(("number", "more"), [(1, ["--json"]), (2, [])])
def test_ctrl_c_in_a_step_keeps_those_before(sqrp, two_steps, monkeypatch, number, more):
    def interrupted(event: Event) -> None:
        if event.event == "step" and event.number == number:
            raise KeyboardInterrupt

    monkeypatch.setattr("sqrp_cli.show.terminal.run_view.live_view", lambda *_, **__: nullcontext(interrupted))
    found = sqrp("run", two_steps.program, "--sim", *more)
    assert found.code == 130
    assert "Traceback" not in found.err
    assert f"when {number - 1} of 2 steps were finished" in found.err
    assert re.fullmatch("" if more else r"1: place red table in two\S*: done, \d+\.\d\d s\n", found.out)


def test_a_sweep_goes_to_the_step_in_which_something_can_slip(sqrp, two_steps, monkeypatch):
    def run(_: OpenProgram, _cell: object, faults: Sequence[InjectedFault]) -> RunReport:
        injected.extend(faults)
        return RunReport()

    injected: list[InjectedFault] = []
    monkeypatch.setattr(OpenProgram, "simulate", run)
    monkeypatch.setattr(OpenProgram, "simulated_cell", nullcontext)  # in which nothing runs
    _, second = yaml.safe_load(two_steps.program.read_text(encoding="utf-8"))["steps"]
    found = sqrp("run", two_steps.program, "--sim", "--sweep", "slip@a4", "--n", 1, "--json").document
    (middle,) = ((one["start"] + one["end"]) / 2 for one in second["primitives"] if one["name"] == "a4")
    assert (found["sweep"], found["step"]) == ("slip@a4", 2)
    assert [one["x"] for one in found["runs"]] == [pytest.approx(middle)]
    assert [(fault.kind, fault.step, fault.t) for fault in injected] == [("slip", 2, pytest.approx(middle))]


@pytest.mark.usefixtures("heeded_ctrl_c")
@pytest.mark.parametrize("finished", [0, 2])
def test_ctrl_c_in_a_sweep_keeps_the_slips_that_are_finished(sqrp, cell, monkeypatch, finished):
    def run(*_: object, **__: object) -> RunReport:
        if len(done) == finished:
            press_ctrl_c()
        t = 5.0 + len(done)
        done.append(t)
        return RunReport(faults=[FaultRecord("slip", t, t, t + 0.1, None, 14.0, 0.2)])

    monkeypatch.setattr(OpenProgram, "simulate", run)
    monkeypatch.setattr(OpenProgram, "simulated_cell", nullcontext)
    done: list[float] = []
    arguments = ("run", cell.program, "--sim", "--sweep", "slip@a4", "--n", 3)
    found = sqrp(*arguments)
    assert found.code == 130
    assert [line.split()[1:5] for line in found.out.splitlines()[-1 - finished : -1]] == [
        [f"{t:.2f}", f"{t + 0.1:.2f}", "0.10", "<=0.20"] for t in done
    ]
    assert found.out.endswith(f"Interrupted: {finished} of 3 slips are finished.\n")
    done.clear()
    found = sqrp(*arguments, "--json")
    assert (found.code, found.document["interrupted"]) == (130, True)
    assert [run["delay"] for run in found.document["runs"]] == pytest.approx([0.1] * finished)


def run_in(cell: str, folder: Path, sqrp: Callable[..., Any], task: str, fault: str) -> Any:
    """A run of the fastest way of doing a task in a made cell, with a fault."""
    program = folder / "pick.yaml"
    assert sqrp("rank", made_cell(cell, folder), task, "--ways", "fastest", "--program", program).code == 0
    return sqrp("run", program, "--sim", "--fault", fault, "--json", "--log", folder / "run.jsonl")


@pytest.fixture(scope="module")
def moved_on(sqrp, tmp_path_factory):
    """A folder, and what was run in it: a slip of red2 in a lift that is out of sight.

    With a faster arm, fewer cameras, few and small images.
    """
    folder = tmp_path_factory.mktemp("screws")
    return folder, run_in("moved_on", folder, sqrp, "pickup_two_finger red2", "slip@a4+1.7").document


def test_the_robot_moves_on_to_where_the_retry_can_be_judged_and_tells_what_no_image_shows(moved_on):
    # The robot moves on to where the retry can be judged.
    run = moved_on[1]
    assert run["outcome"] == "done", run["reason"]
    (fault,) = run["faults"]
    assert run["steps"][0]["attempts"] == 2
    assert fault["moved_on"] > 0.3
    assert fault["detected"] + fault["moved_on"] < fault["acted"] < fault["recovered"]
    # Images usually show that the place between open fingers is empty.
    (usual,) = moved_on[1]["usual"]
    told, wrong, others = (sum(counts[key] for counts in usual["hold(red2)"].values()) for key in ("tp", "fp", "fn"))
    assert wrong == 0
    assert told > 5 * others  # of images at the edge of a time
    # What no image shows at the end is told with the last that did.
    folder, run = moved_on
    events = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    (retry,) = (event["t"] for event in events if event["event"] == "retry")
    looks = [event for event in events if event["event"] == "evidence" and event["exposed"] > retry]
    last = {
        atom: look["exposed"] for look in looks for atom, found in look["literals"].items() if found["value"] != "blind"
    }
    asked = [atom for look in looks[-3:] for atom, found in look["literals"].items() if found["asked"]]
    unseen = run["steps"][0]["unseen"]
    assert unseen == {atom: last.get(atom) for atom in asked if last.get(atom) != looks[-1]["exposed"]}
    assert set(unseen) == {"hold(red2)", "obj_on_table(red2)", "open"}


@pytest.fixture(scope="module")
def from_the_hand(sqrp, tmp_path_factory):
    """A run of g2 that a fixed camera and one beside the suction cup watch, with a slip."""
    return run_in("from_the_hand", tmp_path_factory.mktemp("hand"), sqrp, "pickup g2", "slip@a4+1")


def test_a_camera_on_the_arm_sees_what_it_was_predicted_to_see(from_the_hand):
    assert from_the_hand.code == 0, from_the_hand.document["reason"]
    counts = [cameras["hand"] for step in from_the_hand.document["prediction"] for cameras in step.values()]
    right, wrong = sum(found["tp"] for found in counts), sum(found["fp"] for found in counts)
    assert right > 20
    assert right >= 0.97 * (right + wrong), from_the_hand.document["disagreements"]


@pytest.mark.trial
@pytest.mark.parametrize("offset", [0.3, 0.7])
def test_a_jaw_that_turns_drops_what_slips_and_picks_it_up_again(tmp_path, sqrp, offset):
    """At 0.3 s the part falls 12 mm and still stands between the jaws, at 0.7 s it falls clear of them."""
    cell, program = tmp_path / "cell", tmp_path / "pick.yaml"
    for command in (
        ["init", cell, "--robot", "so101", "--no-run"],
        ["rank", cell, "pickup green", "--program", program],
    ):
        assert sqrp(*command).code == 0
    ran = sqrp("run", program, "--sim", "--fault", f"slip@lift+{offset}", "--json")
    (fault,), (step,) = ran.document["faults"], ran.document["steps"]
    assert (ran.code, ran.document["outcome"], step["attempts"]) == (0, "done", 2)
    assert fault["happened"] <= fault["detected"] < fault["recovered"]
