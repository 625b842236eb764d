"""Exit codes, and what stands on stdout and stderr when something is wrong."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from sqrp_cli.study import pipeline
from tests.cli.conftest import press_ctrl_c


@pytest.mark.usefixtures("heeded_ctrl_c")
def test_ctrl_c_exits_130_and_keeps_what_is_finished(sqrp, watch, monkeypatch):
    finished = pipeline.RankJob.assess

    def interrupted_at_the_third(job, candidate):
        if candidate.name == "near":
            signal.raise_signal(signal.SIGINT)
        return finished(job, candidate)

    monkeypatch.setattr(pipeline.RankJob, "assess", interrupted_at_the_third)
    outcome = sqrp("rank", watch, "watch cube", "--jobs", 1, "--json")
    assert outcome.code == 130
    assert [c["parameters"]["object"] for c in outcome.document["candidates"]] == ["seen", "turned"]
    assert "Traceback" not in outcome.err
    plain = sqrp("rank", watch, "watch cube", "--jobs", 1)
    assert plain.code == 130
    assert "turned" in plain.out
    assert plain.out.endswith("Interrupted at 2 of 13 candidates: another one may be better.\n")


CTRL_C_AT_THE_END = """
import atexit, signal, sys
from sqrp_cli.cli import main

signal.signal(signal.SIGINT, signal.default_int_handler)
press = lambda *_: signal.raise_signal(signal.SIGINT)
main.collect_no_more = press
atexit.register(press)
write = sys.stderr.write
sys.stderr.write = lambda text: (press(), write(text))
"""
"""Ctrl-C while something is written to stderr, when a command has ended, and while Python ends."""


def test_ctrl_c_several_times_exits_130(sqrp_process, watch):
    outcome = sqrp_process("rank", watch, "watch seen", prelude=f"{CTRL_C_AT_THE_END}\nmain.heed_signals = press")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")


def test_ctrl_c_at_the_end_of_a_command_that_is_done_changes_nothing(sqrp_process):
    outcome = sqrp_process("--version", prelude=CTRL_C_AT_THE_END)
    assert outcome.code == 0
    assert outcome.out.startswith("sqrp ")


@pytest.mark.usefixtures("heeded_ctrl_c")
def test_ctrl_c_while_the_page_is_written_keeps_the_ranking_and_the_program(sqrp, watch, tmp_path, monkeypatch):
    monkeypatch.setattr("sqrp_cli.show.pages.candidate_page.write_ranking", press_ctrl_c)
    page, program = tmp_path / "page.html", tmp_path / "program.yaml"
    outcome = sqrp("rank", watch, "watch seen", "--report", page, "--program", program)
    assert outcome.code == 130
    assert outcome.out == sqrp("rank", watch, "watch seen").out
    assert outcome.err.startswith(f"interrupted before {page} was written\n")
    assert not page.exists()
    assert sqrp("program", program).code == 0


@pytest.mark.usefixtures("heeded_ctrl_c")
@pytest.mark.parametrize("command", ["check", "rank", "explain", "show", "score", "diff"])
def test_ctrl_c_while_files_are_read_is_told_in_one_line(sqrp, watch, monkeypatch, command):
    monkeypatch.setattr("sqrp_cli.cell.workspace_file.read_yaml", press_ctrl_c)
    more = {"rank": ["watch seen"], "explain": ["watch seen"], "diff": [watch]}.get(command, [])
    outcome = sqrp(command, watch, *more)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")


def test_ctrl_c_while_the_program_is_loaded_is_told_in_one_line(sqrp_process):
    prelude = (
        "import signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class Interrupted:\n    def find_spec(self, name, *_):\n"
        "        if name == 'typer':\n            signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupted())"
    )
    outcome = sqrp_process("--version", prelude=prelude)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")


def test_ctrl_c_ends_a_process_with_130_and_no_traceback(watch):
    # Every candidate waits, so that the signal certainly comes in between.
    program = (
        "import signal, time\nfrom sqrp_cli.study import pipeline\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def slow(*_):\n    print('ready', flush=True)\n    time.sleep(60)\n"
        "pipeline.RankJob.assess = slow\nfrom sqrp_cli.cli.main import main\nmain()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program, "rank", str(watch), "watch cube"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err == "interrupted when 0 of 13 candidates were finished\n"


def test_an_internal_error_is_one_line_and_exit_70(sqrp, watch, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("the moon\nis in the way")

    monkeypatch.setattr("sqrp_cli.cli.commands.tasks.open_to_write", broken)
    outcome = sqrp("rank", watch, "watch seen", "--json")
    assert (outcome.code, outcome.out) == (70, "")
    assert len(outcome.err.splitlines()) == 1
    assert "the moon is in the way" in outcome.err
    assert "--debug" in outcome.err
    with pytest.raises(RuntimeError, match="moon"):
        sqrp("--debug", "rank", watch, "watch seen")


def test_a_new_cell_whose_first_run_is_interrupted_stays_and_is_told(sqrp, monkeypatch, tmp_path):
    def interrupted(*_arguments, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("sqrp_cli.ask.api.new_cell.first_run", interrupted)
    outcome = sqrp("init", tmp_path / "cell")
    told = f"{tmp_path / 'cell'} is made, but its task was not run: sqrp check {tmp_path / 'cell'}\ninterrupted\n"
    assert (outcome.code, outcome.out) == (130, "")
    assert outcome.err.endswith(told)
    assert sqrp("check", tmp_path / "cell").code == 0
