"""`sqrp program new` at a pseudo terminal, and interrupted; golden/dialog.txt has its questions and answers."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import time

import pytest

from sqrp_cli.program.file import load_program


@pytest.fixture
def file(laying):
    path = laying / "dialog.yaml"
    yield path
    path.unlink(missing_ok=True)


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
