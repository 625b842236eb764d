"""`run --robot` and `cell`: what is refused, and one run in a cell that another process serves."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from sqrp_cli.cli.commands.runs import check_cell
from sqrp_cli.errors import InputError
from sqrp_cli.run.cell.ros_checks import CellCheck

WITHIN = 240.0
"""What takes longer hangs [s]."""
TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"


def test_what_helps_against_lateness_is_said_once(tmp_path, monkeypatch):
    checks = [CellCheck(f"cam{k}", "age", "300 ms", "50 ms", f"`cam{k}` is late") for k in range(3)]
    checks.append(CellCheck("cam1", "pose", "12 mm", "0 mm", "TF has `cam1` elsewhere"))
    file = SimpleNamespace(mend_of_lateness="slower")
    cell: Any = SimpleNamespace(file=file)
    monkeypatch.setattr("sqrp_cli.run.cell.ros_checks.check_cell", lambda *_: checks)
    with pytest.raises(InputError) as caught:
        check_cell(cell, {}, tmp_path / "robot.yaml", as_json=True)
    assert [problem.mend for problem in caught.value.problems] == [None, None, "slower", None]


@pytest.mark.parametrize("more", [[], ["--program", "pick.yaml", "--fault", "nonsense"]])
def test_a_file_that_was_there_is_kept_and_refused(sqrp, tmp_path, more):
    real = tmp_path / "robot.yaml"
    real.write_text("of a real robot")
    found = sqrp("cell", TABLETOP, "--serve", "ros2", "--config", real, *more)
    assert (found.code, found.out, real.read_text()) == (2, "", "of a real robot")
    if not more:
        assert "this file is there" in found.err
        assert "choose another name" in found.err


def test_a_cell_that_cannot_be_served_leaves_no_file_and_takes_none(sqrp, tmp_path):
    config = tmp_path / "simulated.yaml"
    found = sqrp("cell", TABLETOP, "--serve", "ros2", "--config", config, "--network", "10.255.255.1")
    assert found.code == 2
    assert not config.exists()


@pytest.mark.slow
def test_a_program_runs_in_a_cell_of_another_process_and_is_recorded(quick_cell, tmp_path):
    program, config = quick_cell.program, tmp_path / "robot.yaml"
    sqrp, deadline = [sys.executable, "-m", "sqrp_cli"], time.monotonic() + WITHIN
    said = partial(subprocess.run, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=WITHIN)
    serve = [*sqrp, "cell", quick_cell.folder, "--serve", "ros2", "--config", config, "--program", program]
    served = subprocess.Popen([*serve, "--pace", "0.3", "--fault", "slip@a4+0.7"], stderr=subprocess.DEVNULL)
    try:
        while not config.exists():
            assert served.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)
        run = [*sqrp, "run", program, "--robot", config]
        asked = said(run)
        assert asked.returncode == 2
        assert "nobody agreed that the robot moves" in asked.stderr
        dry = said([*run, "--dry-run"])
        assert dry.returncode == 0
        assert "Nothing was commanded." in " ".join(dry.stdout.split())
        keep = ["--record", tmp_path / "run.mcap", "--log", tmp_path / "log.jsonl"]
        ran = said([*run, "--yes", "--json", *keep])
        assert ran.returncode == 0, ran.stderr
        document = json.loads(ran.stdout)
        assert document["steps"][0]["attempts"] == 2
        assert document["faults"][0]["name"] == "slip"
        assert (tmp_path / "run.mcap").stat().st_size > 1_000_000
        served.send_signal(signal.SIGTERM)
        assert served.wait(20) == 0
        assert not config.exists()
    finally:
        served.kill()
        served.wait()
