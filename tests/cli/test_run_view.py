"""Runs as people read them in the terminal, live and again from logs, beyond golden/runs.txt."""

from __future__ import annotations

import io
import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from rich.console import Console

from sqrp_cli.run.record.log import read_log
from sqrp_cli.run.record.report import Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.terminal import console
from sqrp_cli.show.terminal.console import Column, print_table
from sqrp_cli.show.terminal.run_view import live_view, print_disagreements

WRONG = Disagreement(0, 14.25, "open", "cam4", predicted=True, seen="blind", true=True, share=1.0, because="colour")


@pytest.mark.parametrize("t", [0.45, 0.75, 1.85])
def test_an_image_has_the_same_time_where_the_start_of_its_step_is_known_to_microseconds_only(capsys, t):
    told = []
    for time in (t, t - 3e-6, t + 3e-6):
        print_disagreements([replace(WRONG, t=time)], [{}])
        told.append(capsys.readouterr().out)
    assert told[0] == told[1] == told[2]
    assert f"  {t:.1f}  " in told[0]


def test_a_log_that_does_not_tell_what_was_predicted_is_shown_live(tmp_path, monkeypatch):
    """The fields that `run --replay` asks for, and no others."""
    out, log = io.StringIO(), tmp_path / "log"
    monkeypatch.setattr(console, "diagnostics", lambda: Console(file=out, force_terminal=True, width=80))
    literals = {"held": {"value": "blind", "asked": True, "cameras": {"cam1": "false"}}}
    lines = [
        {"t": 0.0, "event": "run", "sqrp_log": 1, "workspace": "cell", "digest": "d", "cameras": ["cam1"]},
        {"t": 0.0, "event": "primitive", "name": "a1"},
        {"t": 0.1, "event": "evidence", "exposed": 0.0, "literals": literals},
        {"t": 0.2, "event": "retry", "attempt": 1, "of": 2},
    ]
    log.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    with live_view(["cam1"]) as view:
        for event in read_log(log):
            view(event)
    shown = out.getvalue()
    assert all(words in shown for words in ("a1", "held", "blind", "cam1", "0.20 s: tries again (1 of 2)"))


@pytest.mark.parametrize(
    ("width", "columns", "rows", "begins"),
    [
        (
            80,
            [Column("a literal"), Column("from - to [s]", right=True), Column("predicted", right=True)],
            [["x" * 56, "0.1 - 0.2", "1"]],
            f"{'':58}from - to\na literal{'':55}[s]  predicted\n",
        ),
        (
            22,
            [Column("#"), Column("step"), Column("time [s]")],
            [["1", "a much longer one", "1.0"], ["", "in all", "1.0"]],
            "# 1: step a much\n  longer one,\n  time [s] 1.0\nstep in all,\n  time [s] 1.0\n",
        ),
    ],
    ids=["titles break where their columns are wide enough anyway", "a row without a first value"],
)
def test_tables_fit_their_terminal(capsys, monkeypatch, width, columns, rows, begins):
    monkeypatch.setattr(console, "output", lambda: Console(width=width))
    print_table(columns, rows)
    assert capsys.readouterr().out.startswith(begins)


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
