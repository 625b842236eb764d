"""Runs shown again from logs that are written here, so that every figure is known."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml

from sqrp_cli.run.record.report import FaultRecord, RunReport, StepRecord


def log_of(path: Path) -> Path:
    """The log of a run in which a slip was seen as soon as predicted."""
    fault = FaultRecord("slip", 1.0, 1.0, 1.1, predicted_delay=0.15)
    step = StepRecord("pickup", {"object": "g"}, "pickup g", 0.0)
    header = {"t": 0.0, "event": "run", "sqrp_log": 1, "workspace": "cell", "digest": "d", "cameras": ["fast", "slow"]}
    # Images of the fast camera: what lies between them says nothing of the slow one.
    images = [{"t": t / 30, "event": "evidence", "exposed": t / 30, "literals": {}} for t in range(3)]
    report = {"t": 2.0, "event": "report", **asdict(RunReport("stopped", "it was seen", 2.0, [step], [fault]))}
    path.write_text("".join(json.dumps(line) + "\n" for line in [header, *images, report]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "kept", ["", '{"t": 2.0, "event": "re', '{"t": 3.0, "event": "state", "fingers": {"left": 0.0}']
)
def test_a_run_that_was_interrupted_is_shown_until_then(sqrp, tmp_path, kept):
    log = log_of(tmp_path / "log")
    *lines, _ = log.read_text(encoding="utf-8").splitlines(keepends=True)
    steps = [{"t": 1.0 + n, "event": "step", "number": 1 + n, "boxes": {}} for n in range(2)]
    slip = {"t": 2.5, "event": "happened", "fault": "slip"}
    header = json.loads(lines[0]) | {"steps": [{"skill": "pickup", "parameters": {}, "time": 1.0}] * 2}
    events = "".join(json.dumps(line) + "\n" for line in [header, *steps, slip])
    log.write_text(events + kept, encoding="utf-8")
    shown = sqrp("run", "--replay", log)
    assert (shown.code, shown.out) == (130, "1: pickup in cell: done, 2.00 s\n2.50 s: slip has happened\n")
    assert shown.err == "this log was interrupted at 2.50 s of the run, when 1 of 2 steps were finished\n"
    for more in (["--json"], ["--report", tmp_path / "page.html"]):
        refused = sqrp("run", "--replay", log, *more)
        assert (refused.code, refused.out) == (2, "")
        assert "this log ends without a report, as the run was interrupted; expected one of a run" in refused.err


@pytest.mark.parametrize(("time", "code"), [(None, 3), (9.5, 2)])
def test_a_log_of_another_program_is_refused(sqrp, tmp_path, holding, time, code):
    step = yaml.load(holding.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)["steps"][0]
    log = log_of(tmp_path / "log")
    header, *events = log.read_text(encoding="utf-8").splitlines(keepends=True)
    ran = {"skill": step["skill"], "parameters": step["parameters"], "time": time or step["time"]}
    log.write_text("".join([json.dumps({**json.loads(header), "steps": [ran]}) + "\n", *events]), encoding="utf-8")
    shown = sqrp("run", holding, "--replay", log)
    assert shown.code == code
    if time is not None:
        was, now = f"that was pickup of {time:.2f} s", f"now it is pickup of {step['time']:.2f} s"
        assert f"{log}:1: this log is not of a run of {holding} as it is now: {was}; {now}" in shown.err
        assert f"to mend it: sqrp run --replay {log}\n" in shown.err
