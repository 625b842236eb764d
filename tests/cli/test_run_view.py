"""Runs as people read them in the terminal."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from sqrp_cli.run.record.log import read_log
from sqrp_cli.run.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.sentences import short_times
from sqrp_cli.show.terminal import console
from sqrp_cli.show.terminal.console import Column, print_table
from sqrp_cli.show.terminal.run_view import live_view, print_disagreements, print_prediction, print_run

FORMULA = (
    "eventually[3.0587515199468918, 4.9454181866135585] (not held(b1) and always[0, 2.5e-05] at(b2.123456, a4.98))"
)
UNSEEN = StepRecord("pickup", {}, "pickup g", 0.0, 9.0, unseen={"hold(g)": 8.1, "obj_on_table(g)": None})
PLACING = StepRecord("place", {}, "place g", 9.0)
WRONG = Disagreement(0, 14.25, "open", "cam4", predicted=True, seen="blind", true=True, share=1.0, because="colour")
UNPROMISED = replace(WRONG, predicted=False, seen="true", because="")


def report(outcome: str = "done", reason: str | None = None, *faults: FaultRecord, **more: Any) -> RunReport:
    return RunReport(outcome, reason, 9.6, faults=list(faults), workspace="cell", **more)


def stopped(delay: float) -> RunReport:
    """Because of a slip, which was predicted to be seen within 0.15 s."""
    fault = FaultRecord("slip", 6.41, 6.42, 6.42 + delay, 7.0, 9.0, predicted_delay=0.15)
    return report("stopped", f"the fault `slip` was seen: {FORMULA}", fault)


def test_times_of_formulas_have_two_decimals_and_all_else_is_as_it_was():
    shown = "eventually[3.06, 4.95] (not held(b1) and always[0.00, 0.00] at(b2.123456, a4.98))"
    assert short_times(f"seen 1.23456 s ago: {FORMULA}") == f"seen 1.23456 s ago: {shown}"
    assert short_times("always[a4.start + 0.123456, a4.end] held") == "always[a4.start + 0.12, a4.end] held"


LATE = "The images showed slip {} s later than predicted at worst."
SLIPPED = FaultRecord("slip", 6.0, 6.1, 6.2, 6.4, 13.25, 0.53, kind="slip")
AT_THE_END = "At the end of {} no image shows hold(g) (last at 8.10 s) and obj_on_table(g) (never before)"
MISSED = FaultRecord("slip", 5.0, 5.01)


@pytest.mark.parametrize(
    ("found", "told", "untold"),
    [
        (stopped(0.08), "was seen: eventually[3.06, 4.95] (not held(b1)", "later than predicted"),
        (stopped(0.152), "", "later than predicted"),
        (stopped(0.17), LATE.format("0.020"), FORMULA),
        (stopped(0.43), LATE.format("0.280"), FORMULA),
        (report("done", None, MISSED), "No image showed slip, which happened at 5.01 s.", "later than predicted"),
        (report("done", None, MISSED, steps=[UNSEEN]), f"{AT_THE_END.format('the motion')}.", "would not be noticed"),
        (
            report("stopped", "dropped", steps=[UNSEEN, PLACING]),
            f"{AT_THE_END.format('step 1')}: a fault after that would not be noticed by then.",
            "step 2 no image",
        ),
        (report(steps=[replace(PLACING, end=9.6)]), "", "no image"),
        (report(prediction=[{}], usual=[{}], disagreements=[WRONG]), " open cam4 ", "1: open"),
    ],
)
def test_of_a_run_is_told_what_matters_with_short_times(capsys, found, told, untold):
    print_run(found)
    shown = " ".join(capsys.readouterr().out.split())
    assert told in shown
    assert untold not in shown


def test_a_dry_run_that_stops_says_what_it_was(capsys):
    print_run(RunReport("stopped", "wrong start: `at(b)` is false", 0.4, workspace="cell"))
    assert capsys.readouterr().out == (
        "a look at the start in cell: stopped at 0.40 s\n"
        "Nothing was commanded: the look stopped because wrong start: `at(b)` is false.\n"
    )


MISPICKED = replace(SLIPPED, injected=0.05, happened=4.63, detected=5.05, acted=5.45, kind="miss-pick")
DROPPED = FaultRecord("dropped", None, None, 9.4)
LOST = FaultRecord("camera-loss", 1.05, detected=1.17, acted=1.17, camera="cam2")


@pytest.mark.parametrize(
    ("found", "rows"),
    [
        (report("done", None, MISPICKED, SLIPPED), ["miss-pick (slip) 0.05", "slip 6.00"]),
        (
            report("stopped", "cam2 is lost", LOST, FaultRecord("camera-loss", 1.05, camera="cam3")),
            ["camera-loss cam2 1.05 - 1.17 - - 1.17 -", "camera-loss cam3 1.05 - - - - - -"],
        ),
        (report("stopped", "dropped", SLIPPED, DROPPED, steps=[UNSEEN, PLACING]), ["1: slip", "2: dropped"]),
    ],
    ids=["as it was injected and as the skill calls it", "camera", "the step in which it was first told"],
)
def test_a_fault_is_named_with_kind_camera_and_step(capsys, found, rows):
    print_run(found)
    shown = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    (first,) = [index for index, line in enumerate(shown) if line.startswith(rows[0])]
    for line, row in zip(shown[first:], rows, strict=False):
        assert line.startswith(row)


def test_wrong_predictions_of_several_steps_name_their_step_and_are_a_table_at_80_columns(capsys, monkeypatch):
    monkeypatch.setattr(console, "output", lambda: Console(width=80))
    found = [replace(one, step=step, atom="obj_on_table(red1)") for step in (0, 1) for one in (WRONG, UNPROMISED)]
    print_run(report(prediction=[{}, {}], usual=[{}, {}], disagreements=found))
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines)
    named = [line.split("  ")[0] for line in lines if "obj_on_table" in line]
    assert named == 2 * ["1: obj_on_table(red1)", "2: obj_on_table(red1)"]
    assert lines.index("Promised, but not seen:") < lines.index("Seen, though neither promised nor usual:")


def test_usual_images_that_did_not_show_it_have_a_row_and_the_others_are_no_surprise(capsys):
    print_prediction([{"open": {"cam1": Confusion(tn=9)}}], [{"open": {"cam1": Confusion(fp=9)}}])
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("open "))
    assert "0 of 9" in row
    print_disagreements([replace(UNPROMISED, usual=True)], 1)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("t", [0.45, 0.75, 1.85])
def test_an_image_has_the_same_time_where_the_start_of_its_step_is_known_to_microseconds_only(capsys, t):
    told = []
    for time in (t, t - 3e-6, t + 3e-6):
        print_disagreements([replace(WRONG, t=time)], 1)
        told.append(capsys.readouterr().out)
    assert told[0] == told[1] == told[2]
    assert f"{t:.1f} - {t:.1f}" in told[0]


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


@pytest.mark.parametrize("width", [80, 40])
def test_a_literal_is_named_once_in_a_table_and_in_every_paragraph(capsys, monkeypatch, width):
    monkeypatch.setattr(console, "output", lambda: Console(width=width))
    found = Confusion(tp=8, tn=2, fp=0, fn=0)
    prediction = [{"held(b1)": {"cam1": found, "cam2": found}, "at(b1)": {"cam1": found}}]
    print_prediction(prediction, prediction)
    shown = capsys.readouterr().out
    assert (shown.count("held(b1)"), shown.count("at(b1)")) == ((1, 1) if width == 80 else (2, 1))


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
