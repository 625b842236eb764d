"""Runs as people read them in the terminal."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import pytest
from rich.console import Console

from sqrp_cli.run.record.log import read_log
from sqrp_cli.run.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.sentences import short_times
from sqrp_cli.show.terminal import console
from sqrp_cli.show.terminal.console import Column, print_table
from sqrp_cli.show.terminal.run_view import LiveView, print_disagreements, print_prediction, print_run

FORMULA = (
    "eventually[3.0587515199468918, 4.9454181866135585] (not held(b1) and always[0, 2.5e-05] at(b2.123456, a4.98))"
)


def report(delay: float, predicted: float) -> RunReport:
    fault = FaultRecord("slip", 6.41, 6.42, 6.42 + delay, 7.0, 9.0, predicted_delay=predicted)
    return RunReport("stopped", f"the fault `slip` was seen: {FORMULA}", 9.0, faults=[fault])


def test_times_of_formulas_have_two_decimals_and_all_else_is_as_it_was():
    shown = "eventually[3.06, 4.95] (not held(b1) and always[0.00, 0.00] at(b2.123456, a4.98))"
    assert short_times(f"seen 1.23456 s ago: {FORMULA}") == f"seen 1.23456 s ago: {shown}"
    assert short_times("always[a4.start + 0.123456, a4.end] held") == "always[a4.start + 0.12, a4.end] held"


def test_why_a_run_stopped_is_said_with_short_times(capsys):
    found = report(0.1, 0.15)
    print_run(found)
    shown = " ".join(capsys.readouterr().out.split())
    assert "was seen: eventually[3.06, 4.95] (not held(b1)" in shown
    assert FORMULA in str(found.reason)


@pytest.mark.parametrize(("delay", "late"), [(0.08, None), (0.152, None), (0.17, "0.020"), (0.43, "0.280")])
def test_a_fault_that_is_seen_later_than_predicted_at_worst_is_said_to_be(capsys, delay, late):
    print_run(report(delay, 0.15))
    shown = " ".join(capsys.readouterr().out.split())
    assert ("later than predicted" in shown) == (late is not None)
    assert late is None or f"The images showed slip {late} s later than predicted at worst." in shown


def test_a_fault_that_no_image_shows_is_not_left_untold_where_the_run_is_done(capsys):
    step = StepRecord("pickup", {}, "pickup g", 0.0, 9.0, unseen={"hold(g)": 4.1})
    print_run(RunReport("done", None, 9.6, [step], [FaultRecord("slip", 5.0, 5.01)], workspace="cell"))
    shown = " ".join(capsys.readouterr().out.split())
    assert "No image showed slip, which happened at 5.01 s." in shown
    assert "At the end of the motion no image shows hold(g) (last at 4.10 s)." in shown
    assert "would not be noticed" not in shown


def test_a_dry_run_that_stops_says_what_it_was(capsys):
    print_run(RunReport("stopped", "wrong start: `at(b)` is false", 0.4, workspace="cell"))
    assert capsys.readouterr().out == (
        "a look at the start in cell: stopped at 0.40 s\n"
        "Nothing was commanded: the look stopped because wrong start: `at(b)` is false.\n"
    )


def test_a_fault_is_called_as_it_was_injected_and_as_the_skill_calls_it(capsys):
    missed = FaultRecord("slip", 0.05, 4.63, 5.05, 5.45, 13.25, 0.53, kind="miss-pick")
    slipped = FaultRecord("slip", 6.0, 6.1, 6.2, 6.4, 13.25, 0.53, kind="slip")
    print_run(RunReport(faults=[missed, slipped], workspace="cell"))
    rows = [line.split("  ")[0] for line in capsys.readouterr().out.splitlines()[3:5]]
    assert rows == ["miss-pick (slip)", "slip"]


def test_faults_of_cameras_name_them(capsys):
    seen = FaultRecord("camera-loss", 1.05, detected=1.17, acted=1.17, camera="cam2")
    other = FaultRecord("camera-loss", 1.05, camera="cam3")
    print_run(RunReport("stopped", "cam2 is lost", 2.0, faults=[seen, other], workspace="cell"))
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("camera-loss")]
    assert rows == [
        ["camera-loss", "cam2", "1.05", "-", "1.17", "-", "-", "1.17", "-"],
        ["camera-loss", "cam3", "1.05", "-", "-", "-", "-", "-", "-"],
    ]


def test_faults_of_several_steps_name_the_step_in_which_they_were_first_told(capsys):
    steps = [StepRecord("pickup", {}, "pickup g", 0.0, 9.0), StepRecord("place", {}, "place g", 9.0)]
    slip, dropped = FaultRecord("slip", 6.0, 6.0, 6.2), FaultRecord("dropped", None, None, 9.4)
    print_run(RunReport("stopped", "dropped", 9.6, steps, [slip, dropped], workspace="cell"))
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines() if line[:2] in ("1:", "2:")]
    assert rows == [["1:", "slip"], ["2:", "dropped"]]


def disagreement(step: int, atom: str, *, predicted: bool) -> Disagreement:
    return Disagreement(
        step=step,
        t=14.25,
        atom=atom,
        camera="cam4",
        predicted=predicted,
        seen="blind" if predicted else "true",
        true=True,
        share=1.0,
        because="same colour behind" if predicted else "",
    )


def test_wrong_predictions_of_several_steps_name_their_step_and_are_a_table_at_80_columns(capsys, monkeypatch):
    monkeypatch.setattr(console, "output", lambda: Console(width=80))
    found = [
        disagreement(step, "obj_on_table(red1)", predicted=predicted) for step in (0, 1) for predicted in (True, False)
    ]
    print_run(
        RunReport("done", None, 9.6, [], prediction=[{}, {}], usual=[{}, {}], disagreements=found, workspace="cell")
    )
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines)
    assert [line.split("  ")[0] for line in lines if "obj_on_table" in line] == 2 * [
        "1: obj_on_table(red1)",
        "2: obj_on_table(red1)",
    ]
    assert lines.index("Promised, but not seen:") < lines.index("Seen, though neither promised nor usual:")


def test_usual_images_that_did_not_show_it_have_a_row(capsys):
    print_prediction([{"open": {"cam1": Confusion(tn=9)}}], [{"open": {"cam1": Confusion(fp=9)}}])
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("open "))
    assert "0 of 9" in row


def test_what_images_usually_show_is_no_surprise(capsys):
    print_disagreements([replace(disagreement(0, "open", predicted=False), usual=True)], 1)
    assert capsys.readouterr().out == ""


def test_wrong_predictions_of_a_single_step_do_not_number_it(capsys):
    found = [disagreement(0, "open", predicted=True)]
    print_run(RunReport("done", None, 9.6, [], prediction=[{}], usual=[{}], disagreements=found, workspace="cell"))
    assert any(line.startswith("open  ") for line in capsys.readouterr().out.splitlines())


@pytest.mark.parametrize("t", [0.45, 0.75, 1.85])
def test_an_image_has_the_same_time_where_the_start_of_its_step_is_known_to_microseconds_only(capsys, t):
    told = []
    for time in (t, t - 3e-6, t + 3e-6):
        print_disagreements([replace(disagreement(0, "open", predicted=True), t=time)], 1)
        told.append(capsys.readouterr().out)
    assert told[0] == told[1] == told[2]
    assert f"{t:.1f} - {t:.1f}" in told[0]


def test_titles_break_where_their_columns_are_wide_enough_anyway(capsys):
    columns = [Column("a literal"), Column("from - to [s]", right=True), Column("predicted", right=True)]
    print_table(columns, [["x" * 56, "0.1 - 0.2", "1"]])
    assert capsys.readouterr().out.splitlines()[:2] == [
        " " * 58 + "from - to",
        "a literal" + " " * 55 + "[s]  predicted",
    ]


def test_what_no_image_shows_at_the_end_is_said_of_steps_that_are_done(capsys):
    steps = [
        StepRecord("pickup", {}, "pickup g", 0.0, 9.0, unseen={"hold(g)": 8.1, "obj_on_table(g)": None}),
        StepRecord("place", {}, "place g", 9.0),
    ]
    print_run(RunReport("stopped", "dropped", 9.6, steps, workspace="cell"))
    told = "At the end of step 1 no image shows hold(g) (last at 8.10 s) and obj_on_table(g) (never before)"
    assert f"{told}: a fault after that would not be noticed by then." in " ".join(capsys.readouterr().out.split())
    print_run(RunReport("done", None, 9.6, [StepRecord("place", {}, "place g", 0.0, 9.6)], workspace="cell"))
    assert "no image" not in capsys.readouterr().out


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
    with LiveView(["cam1"]) as view:
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


def test_a_row_without_a_first_value_begins_with_the_next_one(capsys, monkeypatch):
    monkeypatch.setattr(console, "output", lambda: Console(width=22))
    print_table(
        [Column("#"), Column("step"), Column("time [s]")], [["1", "a much longer one", "1.0"], ["", "in all", "1.0"]]
    )
    assert capsys.readouterr().out == "# 1: step a much\n  longer one,\n  time [s] 1.0\nstep in all,\n  time [s] 1.0\n"
