"""A fault that no image shows is never noticed: no figure, no threshold, no wish and no run says otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cells import shipped_cell, write_cell
from tests.conftest import Once


@pytest.fixture(scope="module")
def under_the_table(once: Once) -> Path:
    """The cell `tabletop` with two cameras that look at the table from below."""

    def write(folder: Path) -> Path:
        cell = shipped_cell("tabletop")
        camera = {"image": {"width": 320, "height": 240, "horizontal_fov": "60 deg"}, "near": 0.2, "far": 4.0}
        camera |= {"rate": 10, "latency": 0.05}
        poses = ({"position": [0.4, y, -0.5], "look_at": [0.4, 0.1, 0.0]} for y in (-0.2, 0.3))
        cell["cameras"] = {f"below{i}": camera | {"pose": pose} for i, pose in enumerate(poses)}
        cell["tasks"] = [{"task": "pickup g2", "max_delay": 5.0}]
        return write_cell(cell, folder).parent

    folder: Path = once("under-the-table", write)
    return folder


def test_no_delay_is_ranked(sqrp, under_the_table, tmp_path):
    found = sqrp("rank", under_the_table, "pickup g2", "--json").document["candidates"][0]
    slip = found["faults"]["slip"]
    assert slip.pop("blind_longest") == pytest.approx(found["t_eoi"])
    assert slip == {"delay_mean": None, "delay_worst": None, "unseen": 1.0, "expected_time": None}
    page = tmp_path / "page.html"
    shown = sqrp("rank", under_the_table, "pickup g2", "--report", page, "--program", tmp_path / "p.yaml")
    assert "never" in shown.out
    assert "Never noticed, as no image is sure to show it: slip in 100 % of cases." in shown.out
    assert "never in 100 % of cases" in sqrp("explain", under_the_table, "pickup g2", columns=200).out
    assert "never" in sqrp("program", tmp_path / "p.yaml").out


def test_no_threshold_and_no_wish_is_met(sqrp, under_the_table):
    scored = sqrp("score", under_the_table, columns=200)
    assert scored.code == 1
    assert "slip of g2 may never be noticed, expected at most 5 s" in scored.out
    advised = sqrp("advise", under_the_table, "pickup g2", "--want", "delay 5 s", "--kinds", "way", "--json")
    assert advised.code == 1
    assert advised.document["before"]["delay_worst"] is None
    assert advised.document["before"]["unseen"] == 1.0


def test_a_run_that_misses_a_fault_says_so(sqrp, under_the_table, tmp_path):
    program, log, page = tmp_path / "p.yaml", tmp_path / "run.jsonl", tmp_path / "run.html"
    assert sqrp("rank", under_the_table, "pickup g2", "--ways", "fastest", "--program", program).code == 0
    run = sqrp("run", program, "--sim", "--fault", "slip@a4+0.5", "--log", log, "--report", page, "--json")
    assert run.code == 3
    assert run.document["outcome"] == "missed"
    assert run.document["reason"].startswith("no image showed slip, which happened at ")
    assert '"missed"' in log.read_text().splitlines()[-1]
    replayed = sqrp("run", program, "--replay", log)
    assert replayed.code == 3
    assert "missed a fault" in replayed.out
    assert "missed" in page.read_text()
