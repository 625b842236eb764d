"""`sqrp score` and `sqrp diff`: what passes, what fails and why, and that nothing is computed twice or lost."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sqrp_cli.platform.files import os as files_os
from sqrp_cli.show.terminal.search_tables import column_titles
from sqrp_cli.study.pipeline import RankJob
from tests.cells import edit
from tests.cli.conftest import press_ctrl_c

ROOT = Path(__file__).parents[2]


def computed(outcome) -> int:
    """How many candidates a run says that it computed."""
    return int(outcome.err.split(" of ")[0].split()[-1])


@pytest.fixture
def cells(own_watch, tmp_path):
    """A folder with three workspaces: one that passes, one that fails, one that is broken."""
    folder = tmp_path / "cells"
    for name in ("good", "low", "broken"):
        shutil.copytree(own_watch, folder / name)
    # `behind` is never seen.
    edit(folder / "low", "task: watch green, min_q_avg: 60 %", "task: watch behind, min_q_avg: 60 %, max_time: 3 s")
    edit(folder / "broken", "near: 50 cm", "near: 50 kg")
    return folder


@pytest.fixture
def ctrl_c_at(monkeypatch):
    """Ctrl-C comes when a candidate of this name is computed."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    assess = RankJob.assess

    def at(name: str) -> None:
        def interrupted(job, candidate):
            if candidate.name == name:
                signal.raise_signal(signal.SIGINT)
            return assess(job, candidate)

        monkeypatch.setattr(RankJob, "assess", interrupted)

    yield at
    signal.signal(signal.SIGINT, before)


def test_an_interrupted_run_says_how_much_was_finished(sqrp, cells, ctrl_c_at):
    edit(cells / "low", "task: watch behind", "task: watch far")
    ctrl_c_at("far")
    outcome = sqrp("score", cells, "--jobs", 1)
    assert outcome.code == 130
    assert outcome.out.startswith("Interrupted: 2 of 3 tasks were finished, 1 could not be scored, 1 passed.\n")
    assert "2 of 3 candidates were computed, then interrupted" in outcome.err
    document = sqrp("score", cells, "--jobs", 1, "--json").document
    assert (document["interrupted"], document["unfinished"], document["passed"]) == (True, 1, False)
    ctrl_c_at("seen")
    assert sqrp("score", cells / "good", "--jobs", 1).out == "Interrupted: 0 of 1 task was finished.\n"


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
    "where", ["score.comparison.compare_with", "score.ci_files.write_junit", "show.pages.candidate_page.write_scores"]
)
def test_ctrl_c_after_scoring_loses_no_score(sqrp, own_watch, tmp_path, monkeypatch, where):
    baseline = tmp_path / "baseline.json"
    assert sqrp("score", own_watch, "--save-baseline", baseline).code == 0

    monkeypatch.setattr(f"sqrp_cli.{where}", press_ctrl_c)
    outputs = ("--junit", tmp_path / "junit.xml", "--report", tmp_path / "page.html")
    outcome = sqrp("score", own_watch, "--baseline", baseline, *outputs)
    assert outcome.code == 130
    assert "interrupted before" in outcome.err
    assert "The task passes." in outcome.out


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
    odd = [b"[" * 100_000, *(content.replace(b"{", b'{"x": %s,' % number, 1) for number in (b"9" * 400, b"1e999"))]
    damaged = [b"", b"\xff\xfe", content[:30], edited, *odd, *map(str.encode, map(json.dumps, (*lacking, *wrong)))]
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


def test_versions_with_the_same_bytes_are_compared_without_computing(sqrp, watch, own_watch, monkeypatch):
    monkeypatch.setattr("sqrp_cli.score.compute.open_computer", None)
    outcome = sqrp("diff", watch, own_watch)
    assert outcome.code == 0
    assert outcome.out == "No task gets better or worse.\n\nNothing that matters differs in the workspace.\n"


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


@pytest.mark.parametrize("command", ["score", "diff"])
def test_where_no_candidate_can_be_computed_nothing_is_printed(sqrp, watch, own_watch, monkeypatch, command):
    monkeypatch.setattr("sqrp_cli.study.timeline.MAX_SAMPLES", 1)
    edit(own_watch, "far: 4 m", "far: 3.9 m")
    outcome = sqrp(command, watch, own_watch, "--samples", 10)
    assert (outcome.code, outcome.out) == (2, "")
    assert "the limit is 1" in outcome.err


def test_what_a_sweep_says_is_in_its_document_and_its_command_applies_the_patch(sqrp, own_watch, tmp_path):
    # `seen` is near enough from x = 0.0226 m on, 2 m from it: the three that are not are all below.
    edit(own_watch, "body: {kind: color, distance: [1 m, 3 m]", "body: {kind: color, distance: [1 m, 2 m]")
    edit(own_watch, "task: watch green", "task: watch seen")
    path, patch = "cameras.eye.pose.position.0", tmp_path / "best.patch"
    arguments = ("score", own_watch, "--vary", f"{path}=-0.1:0.3:3", "--patch", patch)
    document = sqrp(*arguments, "--json").document
    assert [variant["values"].get(path) for variant in document["variants"]] == ["0.1", "0.3", None, "-0.1"]
    assert [variant["q_avg"] for variant in document["variants"]] == pytest.approx([1.0, 1.0, 0.0, 0.0])
    assert document["best"] == {path: "0.1"}
    if shutil.which("patch") is None:
        pytest.skip("there is no `patch` here")
    (command,) = (line.strip() for line in sqrp(*arguments).out.splitlines() if line.startswith("  patch "))
    subprocess.run(["/bin/sh", "-c", command], check=True, capture_output=True)
    assert "None is better than the workspace as it is." in sqrp(*arguments).out


@pytest.mark.parametrize(
    ("address", "words"),
    [("tcp://127.0.0.1:1", "`tcp://127.0.0.1:1`"), ("nope", "missing port"), ("foo://host:1", "`foo://host:1`")],
)
def test_a_scheduler_that_does_not_answer_is_named(sqrp, watch, address, words, monkeypatch):
    monkeypatch.setattr("sqrp_cli.score.cluster.CONNECT_TIMEOUT", 0.2)
    outcome = sqrp("score", watch, "--cluster", address)
    assert (outcome.code, outcome.out, outcome.err.count("error:")) == (2, "", 1)
    assert "Exception ignored" not in outcome.err
    assert "no Dask scheduler" in outcome.err
    assert words in outcome.err
