"""`sqrp score` and `sqrp diff`: what passes, what fails and why, and that nothing is computed twice or lost."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.platform.files import os as files_os
from sqrp_cli.show.terminal.score_table import column_titles
from sqrp_cli.study.pipeline import Assignment
from tests.cli.ctrl_c import press_ctrl_c

ROOT = Path(__file__).parents[2]


def edit(workspace: Path, old: str, new: str) -> None:
    file = workspace / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")


def computed(outcome) -> int:
    """How many candidates a run says that it computed."""
    return int(outcome.err.split(" of ")[0].split()[-1])


@pytest.fixture
def cells(own_watch, tmp_path) -> Path:
    """A folder with three workspaces: one that passes, one that fails, one that is broken."""
    folder = tmp_path / "cells"
    for name in ("good", "low", "broken"):
        shutil.copytree(own_watch, folder / name)
    # `behind` is never seen.
    edit(folder / "low", "task: watch green, min_q_avg: 60 %", "task: watch behind, min_q_avg: 60 %, max_time: 3 s")
    edit(folder / "broken", "near: 50 cm", "near: 50 kg")
    return folder


def test_a_task_that_is_listed_twice_is_two_cases_of_a_test_server(sqrp, own_watch, tmp_path):
    junit = tmp_path / "junit.xml"
    task = "- {task: watch green, min_q_avg: 60 %}"
    edit(own_watch, task, f"{task}\n  - {{task: watch green, min_q_avg: 70 %}}")
    sqrp("score", own_watch, "--junit", junit)
    names = [case.get("name") for case in ElementTree.parse(junit).getroot().iter("testcase")]  # noqa: S314
    assert names == ["watch green", "watch green (2)"]


def test_a_broken_workspace_is_an_error_and_the_others_are_scored(sqrp, cells, tmp_path):
    junit, summary = tmp_path / "junit.xml", tmp_path / "summary.md"
    outcome = sqrp("score", cells, "--json", "--junit", junit, "--summary", summary)
    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    results = {result["workspace"]: result for result in outcome.document["results"]}
    assert {name: result["status"] for name, result in results.items()} == {
        "broken": "error", "good": "passed", "low": "failed",
    }  # fmt: skip
    assert "workspace.yaml" in results["broken"]["reasons"][0]
    assert "50 kg" in results["broken"]["reasons"][0]
    assert len(results["low"]["reasons"]) == 2
    assert results["good"]["best"]["parameters"] == {"object": "seen"}
    assert results["good"]["best"]["q_avg"] == pytest.approx(1.0)
    assert not outcome.document["passed"]
    root = ElementTree.parse(junit).getroot()  # noqa: S314  # noqa: S314 - our own file
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("3", "1", "1")
    assert {suite.get("name") for suite in root} == set(results)
    assert root.find(".//error").get("message") == results["broken"]["reasons"][0]
    assert "Q_avg" in root.find(".//failure").get("message")
    rows = [line for line in summary.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    assert len(rows) == 1 + 3


def test_without_the_broken_one_the_exit_code_says_that_a_task_failed(sqrp, cells):
    outcome = sqrp("score", cells / "good", cells / "low")
    assert outcome.code == 1
    assert "1 of 2 tasks passed, 1 failed." in outcome.out
    assert sqrp("score", cells / "good").code == 0


@pytest.mark.parametrize(
    ("thresholds", "words"),
    [
        ("min_q_avg: 100 %", None),
        ("max_time: 4.1 s", None),
        ("max_time: 3.9 s", ["4.00 s", "at most 3.9 s"]),
        ("max_delay: 0.2 s", None),
        ("max_delay: 0.1 s", ["moved", "0.15 s", "at most 0.1 s"]),
        ("winner: seen", None),
        ("winner: turned", ["seen is best", "turned"]),
        ("feasible: true", None),
        ("feasible: false", ["can be done", "no candidate was expected"]),
    ],
)
def test_each_threshold_is_held_against_the_best_candidate(sqrp, own_watch, thresholds, words):
    edit(own_watch, "min_q_avg: 60 %", thresholds)
    outcome = sqrp("score", own_watch, "--json")
    (result,) = outcome.document["results"]
    assert outcome.code == (0 if words is None else 1)
    assert len(result["reasons"]) == (0 if words is None else 1)
    for word in words or ():
        assert word in result["reasons"][0]


def test_a_task_that_cannot_be_done_fails_unless_that_is_expected(sqrp, own_watch):
    edit(own_watch, "task: watch green, min_q_avg: 60 %", "task: watch lost, min_q_avg: 60 %")
    outcome = sqrp("score", own_watch, "--json")
    assert outcome.code == 1
    assert "not known where `lost` is" in outcome.document["results"][0]["reasons"][0]
    edit(own_watch, "min_q_avg: 60 %", "feasible: false")
    assert sqrp("score", own_watch).code == 0


def test_a_camera_moved_by_10_cm_turns_the_build_red_and_restoring_it_green(sqrp, own_watch, tmp_path):
    baseline = tmp_path / "baseline.json"
    arguments = ("score", own_watch, "--json", "--baseline", baseline)
    # `seen` is 2.022 m away, and 2.121 m from 10 cm further back. It must be seen until 1.5 s and from 2 s to 3 s.
    edit(own_watch, "body: {kind: color, distance: [1 m, 3 m]", "body: {kind: color, distance: [1 m, 2.1 m]")
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    assert sqrp(*arguments).code == 0
    edit(own_watch, "position: [0, 0, 1], look_at", "position: [-0.1, 0, 1], look_at")
    outcome = sqrp(*arguments)
    assert outcome.code == 1
    (result,) = outcome.document["results"]
    (reason,) = (reason for reason in result["reasons"] if "got worse for seen" in reason)
    for words in (
        "watch green",
        "Q_avg fell from 100.0 % to 0.0 %",
        "eye no longer sees in_place(seen) from 0.0 s to 1.5 s: too far for its detector (1 more such stretch)",
        "cameras.eye.pose.position.0: 0 -> -0.1",
    ):
        assert words in reason
    assert result["baseline"]["verdict"] == "regressed"
    lost = next(way for way in result["baseline"]["ways"] if way["way"] == "seen")["lost"]
    assert [(loss["start"], loss["end"]) for loss in lost] == [(0.0, 1.5), (2.0, 3.0)]
    edit(own_watch, "position: [-0.1, 0, 1], look_at", "position: [0, 0, 1], look_at")
    restored = sqrp(*arguments)
    assert restored.code == 0
    assert restored.document["results"][0]["baseline"]["verdict"] == "unchanged"


def test_what_vanished_fails_unless_that_is_allowed(sqrp, own_watch, tmp_path):
    baseline, junit = tmp_path / "baseline.json", tmp_path / "junit.xml"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    edit(own_watch, "watch green", "watch seen")
    outcome = sqrp("score", own_watch, "--baseline", baseline, "--junit", junit, "--json")
    assert (outcome.code, outcome.document["passed"]) == (1, False)
    assert outcome.document["results"][0]["baseline"]["verdict"] == "new"
    assert outcome.document["vanished"] == [{"workspace": "watch", "task": "watch green"}]
    root = ElementTree.parse(junit).getroot()  # noqa: S314
    assert root.attrib["failures"] == "1"
    assert [case.attrib["name"] for case in root.iter("testcase") if case.find("failure") is not None] == [
        "watch green"
    ]
    printed = sqrp("score", own_watch, "--baseline", baseline)
    assert printed.code == 1
    assert "--allow-missing" in printed.out
    assert printed.out.endswith("1 of 1 task passed, 1 vanished.\n")
    outcome = sqrp("score", own_watch, "--baseline", baseline, "--allow-missing", "--json")
    assert (outcome.code, outcome.document["passed"]) == (0, True)


def test_a_choice_of_objects_that_vanished_fails_its_task(sqrp, own_watch, tmp_path):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    edit(own_watch, "turned: {type: cube, color: green", "turned: {type: cube, color: blue")
    outcome = sqrp("score", own_watch, "--baseline", baseline, "--json")
    assert outcome.code == 1
    (reason,) = outcome.document["results"][0]["reasons"]
    assert reason.startswith("watch green for turned is in the baseline, and no longer here; since the baseline ")
    assert sqrp("score", own_watch, "--baseline", baseline, "--allow-missing").code == 0


@pytest.mark.parametrize("edited", [False, True], ids=["", "and edited"])
def test_a_workspace_whose_folder_is_renamed_is_still_compared(sqrp, own_watch, tmp_path, edited):
    """The file's own task got worse: 60 % is asked of `turned`, which is seen for 60 % of the time, not of `seen`."""
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    renamed = own_watch.rename(tmp_path / "renamed")
    if edited:
        edit(renamed, "position: [0, 0, 1], look_at: [1, 0, 1]", "position: [0, 0, 1], look_at: [-1, 0, 1]")
    outcome = sqrp("score", renamed, "--baseline", baseline, "--json")
    assert outcome.code == (1 if edited else 0)
    assert outcome.document["renamed"] == {"renamed": "watch"}
    assert outcome.document["vanished"] == []
    assert outcome.document["results"][0]["baseline"]["verdict"] == ("regressed" if edited else "unchanged")


def test_workspaces_that_swap_their_names_keep_their_baselines(sqrp, own_watch, tmp_path):
    cells = tmp_path / "cells"
    (first := cells / "a").parent.mkdir()
    shutil.copytree(own_watch, first)
    shutil.copytree(own_watch, cells / "b")
    edit(cells / "b", "near: 50 cm", "near: 51 cm")
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", cells, "--save-baseline", baseline).code == 0
    first.rename(cells / "c")
    (cells / "b").rename(first)
    (cells / "c").rename(cells / "b")
    outcome = sqrp("score", cells, "--baseline", baseline, "--json")
    assert outcome.code == 0
    assert outcome.document["renamed"] == {"a": "b", "b": "a"}
    assert [one["baseline"]["verdict"] for one in outcome.document["results"]] == ["unchanged"] * 2


def test_a_baseline_of_an_earlier_version_knows_a_workspace_by_its_bytes(sqrp, own_watch, tmp_path):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    data = json.loads(baseline.read_text(encoding="utf-8"))
    data["workspaces"]["watch"]["digest"] = load_workspace(own_watch).file_digest
    baseline.write_text(json.dumps(data), encoding="utf-8")
    outcome = sqrp("score", own_watch.rename(tmp_path / "renamed"), "--baseline", baseline, "--json")
    assert (outcome.code, outcome.document["renamed"]) == (0, {"renamed": "watch"})


def test_allow_missing_is_about_a_baseline(sqrp, own_watch):
    outcome = sqrp("score", own_watch, "--allow-missing")
    assert (outcome.code, outcome.out) == (2, "")
    assert "--baseline" in outcome.err


@pytest.fixture
def ctrl_c_at(monkeypatch):
    """Ctrl-C comes when a candidate of this name is computed."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    assess = Assignment.assess

    def at(name: str) -> None:
        def interrupted(assignment, candidate):
            if candidate.name == name:
                signal.raise_signal(signal.SIGINT)
            return assess(assignment, candidate)

        monkeypatch.setattr(Assignment, "assess", interrupted)

    yield at
    signal.signal(signal.SIGINT, before)


def test_an_interrupted_run_says_how_much_was_finished(sqrp, cells, ctrl_c_at):
    edit(cells / "low", "task: watch behind", "task: watch far")
    ctrl_c_at("far")
    outcome = sqrp("score", cells, "--jobs", 1)
    assert outcome.code == 130
    assert outcome.out.endswith("Interrupted: 2 of 3 tasks were finished, 1 passed, 1 could not be scored.\n")
    assert "2 of 3 candidates were computed, then interrupted" in outcome.err
    document = sqrp("score", cells, "--jobs", 1, "--json").document
    assert (document["interrupted"], document["unfinished"], document["passed"]) == (True, 1, False)
    ctrl_c_at("seen")
    assert sqrp("score", cells / "good", "--jobs", 1).out == "Interrupted: 0 of 1 task was finished, 0 passed.\n"


def test_an_interrupted_comparison_does_not_say_that_all_is_well(sqrp, watch, own_watch, tmp_path, ctrl_c_at):
    edit(own_watch, "cameras:", "cameras:  # other bytes")
    ctrl_c_at("seen")
    outcome = sqrp("diff", watch, own_watch, "--jobs", 1)
    assert (outcome.code, outcome.out) == (130, "Interrupted before the two versions could be compared.\n")
    arguments = ("--vary", "cameras.eye.near=0.5:0.6:2", "--patch", tmp_path / "best.patch", "--jobs", 1)
    outcome = sqrp("score", own_watch, *arguments)
    assert (outcome.code, outcome.out) == (130, "")
    assert outcome.err.startswith("interrupted before all 3 variants were scored")
    assert not (tmp_path / "best.patch").exists()


@pytest.mark.usefixtures("ctrl_c_at")
@pytest.mark.parametrize(
    "where",
    ["score.comparison.compare_with", "score.ci_files.write_junit", "show.pages.candidate_page.write_scores"],
)
def test_ctrl_c_after_scoring_loses_no_score(sqrp, own_watch, tmp_path, monkeypatch, where):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0

    monkeypatch.setattr(f"sqrp_cli.{where}", press_ctrl_c)
    outputs = ("--junit", tmp_path / "junit.xml", "--report", tmp_path / "page.html")
    outcome = sqrp("score", own_watch, "--baseline", baseline, *outputs)
    assert outcome.code == 130
    assert "interrupted before" in outcome.err
    assert "Interrupted: 1 of 1 task was finished, 1 passed." in outcome.out


def test_a_file_that_is_no_baseline_is_refused(sqrp, own_watch, tmp_path):
    for content in ("", "{}", '{"format": "sqrp baseline 1", "workspaces": 3}'):
        (tmp_path / "baseline.json").write_text(content, encoding="utf-8")
        outcome = sqrp("score", own_watch, "--baseline", tmp_path / "baseline.json")
        assert outcome.code == 2
        assert "no baseline" in outcome.err


def test_nothing_is_computed_twice(sqrp, own_watch, tmp_path):
    out = tmp_path / "results"
    first = sqrp("score", own_watch, "--out", out, "--json")
    assert computed(first) == 2
    files = {path: path.read_bytes() for path in out.rglob("*.json")}
    # Neither comments nor thresholds matter for what is computed, nor where the workspace is.
    edit(own_watch, "tasks:", "# what is expected\ntasks:")
    edit(own_watch, "min_q_avg: 60 %", "min_q_avg: 50 %")
    moved = Path(shutil.copytree(own_watch, tmp_path / "elsewhere" / "watch"))
    second = sqrp("score", moved, "--out", out, "--resume", "--json")
    assert computed(second) == 0
    assert second.out == first.out
    assert {path: path.read_bytes() for path in out.rglob("*.json")} == files
    edit(own_watch, "watch green", "watch cube")
    assert computed(sqrp("score", own_watch, "--out", out)) == 11  # of 13, two of which are the green ones
    edit(own_watch, "far: 4 m", "far: 3.9 m")
    assert computed(sqrp("score", own_watch, "--out", out)) == 13


def test_a_result_that_is_not_as_it_was_written_is_computed_again(sqrp, own_watch, tmp_path):
    out = tmp_path / "results"
    first = sqrp("score", own_watch, "--out", out, "--json")
    kept = next(out.rglob("*.json"))
    content = kept.read_bytes()
    result = json.loads(content)
    lacking = [{name: value for name, value in result.items() if name != field} for field in result]
    wrong = [{**result, "outside": None}, {**result, "checksum": "x"}, {**result, "value": {}}]
    edited = content.replace(b'"time": 4.0', b'"time": 4.5', 1)
    assert edited != content
    damaged = [b"", b"\xff\xfe", content[:30], edited, *(json.dumps(other).encode() for other in (*lacking, *wrong))]
    for other in damaged:
        kept.write_bytes(other)
        second = sqrp("score", own_watch, "--out", out, "--json", "--jobs", 1)
        assert (computed(second), second.out) == (1, first.out)
        assert kept.read_bytes() == content


def test_results_are_the_same_with_any_number_of_processes(sqrp, own_watch):
    edit(own_watch, "watch green", "watch cube")
    assert sqrp("score", own_watch, "--json", "--jobs", 1).out == sqrp("score", own_watch, "--json", "--jobs", 3).out


def test_a_run_that_is_killed_goes_on_where_it_was(sqrp, quick_cell, tmp_path):
    undisturbed, out = tmp_path / "undisturbed", tmp_path / "results"
    cell = quick_cell.folder
    whole = sqrp("score", cell, "--out", undisturbed, "--json")
    arguments = [sys.executable, "-m", "sqrp_cli", "score", str(cell), "--out", str(out), "--jobs", "2"]
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None and not list(out.rglob("*.json")):
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    finished = len(list(out.rglob("*.json")))
    again = sqrp("score", cell, "--out", out, "--resume", "--json")
    assert again.out == whole.out
    assert computed(again) == computed(whole) - finished
    assert {p.name: p.read_bytes() for p in out.rglob("*.json")} == {
        p.name: p.read_bytes() for p in undisturbed.rglob("*.json")
    }


def test_a_folder_that_cannot_be_written_is_refused(sqrp, own_watch, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for name, said in (("file", "expected the name of a folder"), ("file/below", "this folder cannot be made")):
        outcome = sqrp("score", own_watch, "--out", tmp_path / name)
        assert (outcome.code, outcome.out) == (2, "")
        assert said in outcome.err


def test_a_full_disk_ends_with_a_message(sqrp, own_watch, tmp_path, monkeypatch):
    def full(_descriptor: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(files_os, "fsync", full)
    outcome = sqrp("score", own_watch, "--out", tmp_path / "results")
    assert (outcome.code, outcome.out) == (2, "")
    assert "No space left on device" in outcome.err
    assert "goes on from what is finished" in outcome.err
    assert not list((tmp_path / "results").rglob("*.json"))


def test_two_runs_do_not_share_a_folder(own_watch, sqrp, tmp_path):
    program = (
        "import sys; from pathlib import Path; from sqrp_cli.score.kept import Results\n"
        "results = Results(Path(sys.argv[1])); print('ready', flush=True); sys.stdin.read()"
    )
    arguments = [sys.executable, "-c", program, str(tmp_path / "results")]
    holder = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout.readline()
    outcome = sqrp("score", own_watch, "--out", tmp_path / "results")
    holder.communicate()
    assert outcome.code == 2
    assert "another `sqrp score`, `sqrp advise` or `sqrp place`" in outcome.err
    assert sqrp("score", own_watch, "--out", tmp_path / "results").code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], ["no such file or folder"]),
        (["nothing/*"], ["no workspace fits"]),
        (["--resume"], ["--out"]),
        (["--cluster", "tcp://127.0.0.1:1"], ["no Dask scheduler", "tcp://127.0.0.1:1"]),
        (["--cluster", "nope"], ["no Dask scheduler", "`nope`", "missing port"]),
        (["--cluster", "foo://host:1"], ["no Dask scheduler", "`foo://host:1`"]),
        (["--junit", "nowhere/junit.xml"], ["no folder"]),
    ],
)
def test_what_cannot_be_used_is_refused(sqrp, own_watch, arguments, words, monkeypatch):
    from sqrp_cli.score import cluster

    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.2)
    outcome = sqrp("score", *([own_watch] if arguments[0].startswith("--") else []), *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("error:") == 1
    assert "Exception ignored" not in outcome.err
    for word in words:
        assert word in outcome.err


def test_a_baseline_that_is_compared_with_is_not_overwritten(sqrp, own_watch, tmp_path):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    before = baseline.read_bytes()
    for option in ("--save-baseline", "--junit"):
        outcome = sqrp("score", own_watch, "--baseline", baseline, option, baseline)
        assert (outcome.code, outcome.out) == (2, "")
        assert "so it is not overwritten" in outcome.err
    assert baseline.read_bytes() == before


@pytest.mark.parametrize("option", ["--save-baseline", "--junit", "--summary", "--report"])
@pytest.mark.parametrize("name", ["workspace.yaml", "watch/skill.yaml"])
def test_a_file_that_is_read_is_not_overwritten(sqrp, own_watch, option, name):
    before = (own_watch / name).read_bytes()
    outcome = sqrp("score", own_watch, option, own_watch / name)
    assert (outcome.code, outcome.out) == (2, "")
    assert "so it is not overwritten" in outcome.err
    assert (own_watch / name).read_bytes() == before


@pytest.mark.parametrize("mine", ["", "notes", "--- workspace.yaml\n+++ workspace.yaml\n"])
@pytest.mark.parametrize("option", [True, False])
def test_a_file_that_is_no_patch_of_a_sweep_is_not_overwritten(sqrp, own_watch, tmp_path, monkeypatch, option, mine):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "watch-best.patch"
    file.write_text(mine, encoding="utf-8")
    outcome = sqrp("score", own_watch, "--vary", "cameras.eye.near=1:2:2", *(["--patch", file] if option else []))
    assert (outcome.code, outcome.out) == (2, "")
    assert "watch-best.patch: this file is there already and is no patch that --vary wrote" in outcome.err
    assert file.read_text(encoding="utf-8") == mine


@pytest.mark.parametrize("place", ["", "nowhere/best.patch"])
def test_a_patch_that_cannot_be_written_is_refused_before_anything_is_scored(sqrp, own_watch, tmp_path, place):
    arguments = ("--vary", "cameras.eye.near=0.5:0.6:2", "--patch", tmp_path / place)  # none is better
    outcome = sqrp("score", own_watch, *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith(f"error: {tmp_path / place}: ")


def test_a_baseline_of_another_sampling_is_refused_in_words(sqrp, own_watch, tmp_path):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0
    outcome = sqrp("score", own_watch, "--baseline", baseline, "--samples", "5")
    assert outcome.code == 2
    assert "made with --tolerance 0.1 (the default), but this run samples with --samples 5" in outcome.err


def test_diff_says_what_differs_and_what_that_does(sqrp, watch, own_watch):
    edit(own_watch, "position: [0, 0, 1], look_at: [1, 0, 1]", "position: [0, 1.3, 1], look_at: [1, 1.3, 1]")
    skill = own_watch / "watch" / "skill.yaml"
    skill.write_text(skill.read_text(encoding="utf-8").replace("wait: 2 s", "wait: 2.5 s"), encoding="utf-8")
    outcome = sqrp("diff", watch, own_watch)
    assert outcome.code == 1
    for line in (
        "cameras.eye.pose.position.1: 0 -> 1.3",
        "skills.watch.yaml primitives.2.wait: 2 s -> 2.5 s",
        "worse   watch green for turned: ",
        "eye no longer sees",
    ):
        assert line in re.sub(r"\n {10}", " ", outcome.out)
    document = sqrp("diff", watch, own_watch, "--json").document
    assert [change["field"] for change in document["changes"]["watch"]][:1] == ["cameras.eye.pose.position.1"]
    assert sqrp("diff", watch, watch).code == 0


def test_versions_with_the_same_bytes_are_compared_without_computing(sqrp, watch, own_watch, monkeypatch) -> None:
    monkeypatch.setattr("sqrp_cli.score.compute.open_computer", None)
    outcome = sqrp("diff", watch, own_watch)
    assert outcome.code == 0
    assert outcome.out == "Nothing that matters differs in the workspace.\n\nNo task gets better or worse.\n"


def test_folded_lines_of_a_difference_are_indented(sqrp, watch, own_watch):
    edit(own_watch, "position: [0, 0, 1], look_at: [1, 0, 1]", "position: [0, 1.3, 1], look_at: [1, 1.3, 1]")
    outcome = sqrp("diff", watch, own_watch, columns=80)
    _, differs, effects = re.split(r"What differs in the workspace:\n|\nWhat that does:\n", outcome.out)
    assert all(line.startswith(("  cameras.", " " * 4)) for line in differs.splitlines() if line)
    effects, compared, _ = effects.partition("Compared are the best ways of both versions;")
    assert compared
    lines = [line for line in effects.splitlines() if line]
    folded = [line for line in lines if not line.startswith(("  worse   ", "  better  ", "  mixed   "))]
    assert folded
    assert all(line.startswith(" " * 10) and line[10] != " " for line in folded)
    assert all(len(line) <= 80 for line in lines)


def test_a_task_that_is_gone_is_named_and_is_no_regression(sqrp, watch, own_watch):
    edit(own_watch, "task: watch green", "task: watch seen")
    outcome = sqrp("diff", watch, own_watch)
    assert outcome.code == 0
    assert "  new     watch seen\n" in outcome.out
    assert "  gone    watch green\n" in outcome.out
    document = sqrp("diff", watch, own_watch, "--json").document
    assert document["vanished"] == [{"workspace": "watch", "task": "watch green"}]
    edit(own_watch, "tasks:\n  - {task: watch seen, min_q_avg: 60 %}\n", "")
    outcome = sqrp("diff", watch, own_watch)
    assert outcome.code == 0
    assert "  gone    watch green\n" in outcome.out


def test_tasks_of_the_same_name_in_workspaces_of_the_same_name_are_told_apart(sqrp, own_watch, tmp_path):
    for place in ("left", "right"):
        shutil.copytree(own_watch, tmp_path / place / "watch")
    document = sqrp("score", tmp_path / "left", tmp_path / "right", "--json").document
    assert [result["workspace"] for result in document["results"]] == ["left/watch", "right/watch"]


def test_a_pattern_finds_the_workspaces_that_it_names(sqrp, cells):
    outcome = sqrp("score", f"{cells}/[gl]*", "--json")
    assert [result["workspace"] for result in outcome.document["results"]] == ["good", "low"]


def test_a_sweep_names_the_best_variant_and_writes_it_as_a_patch(sqrp, own_watch, tmp_path):
    # `seen` is 2.022 m away from x = 0 and 1.921 m from x = 0.1, where it is near enough; x = 0.3 is as good.
    edit(own_watch, "body: {kind: color, distance: [1 m, 3 m]", "body: {kind: color, distance: [1 m, 2 m]")
    edit(own_watch, "task: watch green", "task: watch seen")
    patch = tmp_path / "best.patch"
    arguments = ("score", own_watch, "--vary", "cameras.eye.pose.position[0]=-0.1:0.3:3", "--patch", patch)
    outcome = sqrp(*arguments, "--json")
    assert outcome.code == 0
    variants = outcome.document["variants"]
    assert [variant["values"].get("cameras.eye.pose.position.0") for variant in variants] == [
        "0.1",
        "0.3",
        None,
        "-0.1",
    ]
    assert [variant["q_avg"] for variant in variants] == pytest.approx([1.0, 1.0, 0.0, 0.0])
    assert outcome.document["best"] == {"cameras.eye.pose.position.0": "0.1"}
    lines = [line for line in patch.read_text(encoding="utf-8").splitlines() if line[0] in "+-" and line[1] == " "]
    assert lines == [
        "-    pose: {position: [0, 0, 1], look_at: [1, 0, 1]}",
        "+    pose: {position: [0.1, 0, 1], look_at: [1, 0, 1]}",
    ]
    shown = sqrp(*arguments).out
    assert "Best is cameras.eye.pose.position.0 = 0.1." in shown
    if shutil.which("patch") is None:
        pytest.skip("there is no `patch` here")
    (command,) = (line.strip() for line in shown.splitlines() if line.startswith("  patch "))
    subprocess.run(["/bin/sh", "-c", command], check=True, capture_output=True)
    assert "None is better than the workspace as it is." in sqrp(*arguments).out


def test_the_patch_of_a_sweep_has_a_name_of_its_own_and_is_brought_up_to_date(sqrp, own_watch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    edit(own_watch, "body: {kind: color, distance: [1 m, 3 m]", "body: {kind: color, distance: [1 m, 2 m]")
    edit(own_watch, "task: watch green", "task: watch seen")
    for best in ("0.1", "0.12"):
        outcome = sqrp("score", own_watch, "--vary", f"cameras.eye.pose.position[0]=-0.1:{best}:2")
        assert outcome.code == 0
        assert outcome.out.endswith("  patch watch/workspace.yaml < watch-best.patch\n")
        assert f"position: [{best}, 0, 1]" in (tmp_path / "watch-best.patch").read_text(encoding="utf-8")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["watch", "watch-best.patch"]


def test_of_variants_that_see_as_much_the_one_that_sees_sooner_is_best(sqrp, own_watch, tmp_path):
    arguments = ("--vary", "cameras.eye.latency=60 ms:10 ms:3", "--patch", tmp_path / "best.patch")
    document = sqrp("score", own_watch, *arguments, "--json").document
    assert document["best"] == {"cameras.eye.latency": "10 ms"}
    # One frame period, 0.1 s, and the latency.
    assert [variant["delay"] for variant in document["variants"]] == pytest.approx([0.11, 0.135, 0.15, 0.16])


def near_enough_from_a_step_aside(workspace: Path) -> None:
    """Let `seen` be near enough from x = 0.0226 m on, 2 m from it, and not from where the camera is."""
    edit(workspace, "body: {kind: color, distance: [1 m, 3 m]", "body: {kind: color, distance: [1 m, 2 m]")
    edit(workspace, "task: watch green", "task: watch seen")


def test_of_equal_variants_the_one_in_the_middle_of_the_longest_run_is_best(sqrp, own_watch, tmp_path):
    near_enough_from_a_step_aside(own_watch)
    arguments = ("--vary", "cameras.eye.pose.position[0]=-0.3:0.7:11", "--patch", tmp_path / "best.patch")
    document = sqrp("score", own_watch, *arguments, "--json").document
    assert document["best"] == {"cameras.eye.pose.position.0": "0.4"}
    assert document["equals"] == 7
    values = [next(iter(variant["values"].values()), None) for variant in document["variants"]]
    assert values == ["0.4", "0.1", "0.2", "0.3", "0.5", "0.6", "0.7", None, "-0.3", "-0.2", "-0.1", "0"]
    shown = " ".join(sqrp("score", own_watch, *arguments).out.split())
    assert "position.0 = 0.4. Of 7 that are as good it has the most room around it. To have it:" in shown


def test_of_equal_draws_the_one_farthest_from_those_that_are_worse_is_best(sqrp, own_watch, tmp_path):
    near_enough_from_a_step_aside(own_watch)
    arguments = ("--vary", "cameras.eye.pose.position[0]=-0.3:0.7", "--draws", 12, "--patch", tmp_path / "best.patch")
    document = sqrp("score", own_watch, *arguments, "--json").document
    drawn = [float(value) for variant in document["variants"] for value in variant["values"].values()]
    assert sum(value > 0.0226 for value in drawn) == document["equals"] > 1
    assert float(document["best"]["cameras.eye.pose.position.0"]) == max(drawn)  # worse ones are all below


def test_figures_of_a_sweep_are_about_what_can_be_done(sqrp, own_watch, tmp_path):
    edit(own_watch, "in_place(turned), ", "")  # so that `turned` cannot be watched, and `seen` can
    arguments = ("--vary", "cameras.eye.latency=60 ms:50 ms:2", "--patch", tmp_path / "best.patch")
    variants = sqrp("score", own_watch, *arguments, "--json").document["variants"]
    assert [(variant["q_eoi"], variant["q_avg"]) for variant in variants] == [(1.0, 1.0)] * 3
    assert [(variant["feasible"], variant["choices"]) for variant in variants] == [(1, 2)] * 3
    shown = sqrp("score", own_watch, *arguments).out
    assert "1 of 2" in shown
    assert " ".join(shown.split()).count("100.0 100.0") == 3


@pytest.mark.parametrize(
    ("paths", "titles"),
    [
        (["cameras.cam1.pose.position.0"], ["cam1\nposition.0"]),
        (["cameras.cam1.pose.position.0", "cameras.cam2.pose.position.0"], ["cam1\nposition.0", "cam2\nposition.0"]),
        (["robot.base.position.2", "padding", "cameras.a.far"], ["robot\nposition.2", "padding", "a\nfar"]),
        (["cameras.a.far", "objects.a.far"], ["cameras.a.far", "objects.a.far"]),
    ],
)
def test_columns_of_a_sweep_say_whose_values_they_are(paths, titles):
    assert column_titles(paths) == titles


def test_a_sweep_warns_as_a_ranking_does_and_once_for_all_variants(sqrp, own_watch, tmp_path):
    skill = own_watch / "watch" / "skill.yaml"
    skill.write_text(skill.read_text(encoding="utf-8").replace("[w1.start, w1.end]", "[100, 200]"), encoding="utf-8")
    arguments = ("--vary", "cameras.eye.near=0.5:0.6:2", "--patch", tmp_path / "best.patch")
    outcome = sqrp("score", own_watch, *arguments)
    assert outcome.code == 0
    assert outcome.err == sqrp("rank", own_watch, "watch green").err
    assert outcome.err.count("nothing of the interval [100, 200]") == 1


def test_a_variant_that_cannot_be_is_an_error_and_the_others_are_scored(sqrp, own_watch, tmp_path):
    arguments = ("--vary", "cameras.eye.near=0.5 m:5 m:2", "--patch", tmp_path / "best.patch")
    shown = " ".join(sqrp("score", own_watch, *arguments).out.split())
    assert "#3: " in shown
    assert "near" in shown.partition("#3: ")[2].partition(" Figures")[0]
    outcome = sqrp("score", own_watch, *arguments, "--json")
    assert outcome.code == 0
    last = outcome.document["variants"][-1]
    assert last["values"] == {"cameras.eye.near": "5 m"}
    assert last["results"][0]["status"] == "error"


def test_a_sweep_of_what_is_not_there_is_refused(sqrp, own_watch):
    outcome = sqrp("score", own_watch, "--vary", "cameras.eve.near=1:2:2")
    assert (outcome.code, outcome.out) == (2, "")
    assert "did you mean `cameras.eye.near`?" in outcome.err


@pytest.mark.parametrize("arguments", [[], ["--json"], ["--vary", "cameras.eye.near=0.5:0.6:2"]], ids=" ".join)
def test_where_nothing_can_be_scored_stdout_is_empty_and_each_reason_is_told_once(
    sqrp, own_watch, tmp_path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    edit(own_watch, "task: watch green", "task: watch nobody")
    outcome = sqrp("score", own_watch, *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("nobody") == 1
    assert not list(tmp_path.glob("*.patch"))


@pytest.mark.parametrize("as_json", [[], ["--json"]], ids=["table", "document"])
def test_what_could_be_scored_is_printed_and_what_could_not_is_in_it_as_an_error(sqrp, cells, as_json):
    outcome = sqrp("score", cells, *as_json)
    assert outcome.code == 2
    words = ("good", "passed", "low", "failed", "broken", "error", "50 kg")
    assert [word for word in words if word not in outcome.out] == []
    assert "error:" not in outcome.err  # said once, where the results are
    shutil.rmtree(cells / "good")
    shutil.rmtree(cells / "low")
    alone = sqrp("score", cells, *as_json)
    assert (alone.code, alone.out) == (2, "")
    assert "50 kg" in alone.err


def test_where_nothing_can_be_scored_the_files_for_ci_are_written_nevertheless(sqrp, cells, tmp_path):
    junit, summary = tmp_path / "junit.xml", tmp_path / "summary.md"
    outcome = sqrp("score", cells / "broken", "--junit", junit, "--summary", summary)
    assert (outcome.code, outcome.out) == (2, "")
    assert ElementTree.parse(junit).getroot().get("errors") == "1"  # noqa: S314 - our own file
    assert "50 kg" in summary.read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["score", "diff"])
def test_where_no_candidate_can_be_computed_nothing_is_printed(sqrp, watch, own_watch, monkeypatch, command):
    monkeypatch.setattr("sqrp_cli.study.assessment.MAX_SAMPLES", 1)
    edit(own_watch, "far: 4 m", "far: 3.9 m")
    outcome = sqrp(command, watch, own_watch, "--samples", 10)
    assert (outcome.code, outcome.out) == (2, "")
    assert "the limit is 1" in outcome.err
