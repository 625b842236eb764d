"""`sqrp program new` at a pseudo terminal, with answers from a pipe, and interrupted."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import signal
import subprocess
import sys
import time

import pytest

from sqrp_cli.cli.commands import program_new
from sqrp_cli.program.file import load_program


@pytest.fixture
def answer(sqrp, laying, monkeypatch):
    """Runs the dialog with these answers, one line each, then the end of the input."""

    def run(*answers: str):
        monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in answers)))
        return sqrp("program", "new", laying)

    return run


@pytest.fixture
def file(laying):
    path = laying / "dialog.yaml"
    yield path
    path.unlink(missing_ok=True)


def test_a_program_of_two_steps_is_made_by_numbers(answer, file):
    outcome = answer("2", "1", str(file), "1", "2", "")
    assert outcome.code == 0
    assert [step.short_task for step in load_program(file).steps] == ["pickup g2", "lay g2"]
    assert load_program(file).steps[1].parameters["speed"] == 1.0, "the second in the ranking"
    assert "2 steps" in outcome.out
    assert all(len(line) <= 80 for line in outcome.out.splitlines() if str(file) not in line)


def test_what_can_be_done_is_listed_first_the_rest_with_its_reason_and_without_a_way_no_file_is_asked_for(answer, file):
    outcome = answer("pickup g2", "0", "")
    lines = outcome.out.splitlines()
    numbered = [line.split()[1:3] for line in lines if line.split()[:1] and line.split()[0].isdecimal()]
    assert ["pickup", "g2"] in numbered
    assert ["pickup", "g6"] not in numbered
    assert any(line.startswith("not pickup g6:") and "too far" in line for line in lines)
    assert "needs `hold(g1)`" in outcome.out
    assert "File for the program" not in outcome.out
    assert (outcome.code, file.exists(), "nothing was written" in outcome.err) == (0, False, True)


def test_a_task_that_needs_others_first_is_proposed_with_them(answer, file):
    outcome = answer("pickup g2", "1", str(file), "pickup g3", "yes")
    assert outcome.code == 0
    assert [step.short_task for step in load_program(file).steps] == ["pickup g2", "lay g2", "pickup g3"]


def test_wrong_answers_are_explained_and_asked_for_again(answer, file, laying):
    no_files = [str(laying / "none" / "x.yaml"), str(laying)]
    outcome = answer("99", "pickup gren", "pickup g2", "7", "x", "1", *no_files, str(file), "")
    assert outcome.code == 0
    assert "mkdir -p" in outcome.err
    assert "did you mean `green`?" in outcome.err
    assert "There is no number 99" in outcome.out
    assert "There is no number 7" in outcome.out
    assert [step.short_task for step in load_program(file).steps] == ["pickup g2"]


def test_a_file_that_is_there_already_is_never_overwritten(answer, laying, file):
    before = (laying / "workspace.yaml").read_bytes()
    outcome = answer("2", "1", str(laying / "workspace.yaml"), str(file))
    assert "there already" in outcome.err
    assert (laying / "workspace.yaml").read_bytes() == before
    assert len(load_program(file).steps) == 1


def test_what_was_chosen_is_saved_before_the_next_question(answer, file, monkeypatch):
    ask = program_new.ask

    def interrupted(question: str) -> str:
        if question.startswith("Step 2"):
            assert len(load_program(file).steps) == 1
            signal.raise_signal(signal.SIGINT)
        return ask(question)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(program_new, "ask", interrupted)
    outcome = answer("2", "1", str(file))
    signal.signal(signal.SIGINT, before)
    assert outcome.code == 130
    assert "1 step" in outcome.err
    assert "Traceback" not in outcome.err
    assert [step.short_task for step in load_program(file).steps] == ["pickup g2"]


@pytest.mark.parametrize("options", [[], ["--json"], ["--drop-last"]])
def test_a_new_program_takes_a_workspace_and_nothing_else(sqrp, laying, options):
    arguments = [laying, *options] if options else []
    outcome = sqrp("program", "new", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert "sqrp program new WORKSPACE" in outcome.err


class Terminal:
    """The dialog at a pseudo terminal."""

    def __init__(self, *arguments: object) -> None:
        self.shown = ""
        self.end, end = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sqrp_cli", *map(str, arguments)],
            stdin=end, stdout=end, stderr=end, start_new_session=True, close_fds=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            env={**os.environ, "COLUMNS": "80", "NO_COLOR": "1"},
        )  # fmt: skip
        os.close(end)

    def answer(self, question: str, text: str) -> None:
        """Wait for a question, then type."""
        start, limit = len(self.shown), time.monotonic() + 60
        while question not in self.shown[start:]:
            assert time.monotonic() < limit, self.shown
            self.shown += os.read(self.end, 4096).decode(errors="replace")
        os.write(self.end, text.encode())

    def interrupt(self) -> int:
        """Type Ctrl-C until the process has ended; one between the question and the wait for its answer is lost."""
        for _ in range(20):
            self.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                return self.process.wait(3)
        raise AssertionError(self.shown)


def test_at_a_terminal_a_step_is_chosen_and_ctrl_c_keeps_it(laying, file):
    terminal = Terminal("program", "new", laying)
    terminal.answer("Step 1:", "2\n")
    terminal.answer("Which one", "\n")
    terminal.answer("File for the program", f"{file}\n")
    terminal.answer("Step 2:", "")
    assert terminal.interrupt() == 130
    os.close(terminal.end)
    assert "Traceback" not in terminal.shown
    assert [step.short_task for step in load_program(file).steps] == ["pickup g2"]
