"""What the terminal shows: complete at any width, without colour, and the same whether or not it is a terminal."""

from __future__ import annotations

import functools
import io
import os
import re
import shlex
import sys
import time
import unicodedata
from pathlib import Path

import pexpect
import pytest
from rich.console import Console

from sqrp_cli.errors import Problem
from sqrp_cli.run.record.events import event
from sqrp_cli.show.terminal import console, progress_lines
from sqrp_cli.show.terminal.run_view import live_view
from sqrp_cli.study import pipeline
from tests.cells import command_lines


def width(line: str) -> int:
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in line)


def figures(text: str) -> set[str]:
    """The numbers with decimals in a text."""
    return set(re.findall(r"\d+\.\d+", text))


@pytest.fixture(params=command_lines("widths"), ids=lambda words: " ".join(Path(w).name for w in words))
def arguments(request):
    return request.param


@pytest.fixture(scope="module")
def printed(sqrp, asked, tmp_path_factory):
    """What a command prints at a width: the table of its result, which is computed once."""
    folder = tmp_path_factory.mktemp("printed")

    @functools.cache
    def run(columns: int, *arguments: str):
        if arguments[0] == "show":
            return sqrp(*arguments, columns=columns)
        file = folder / f"{hash(arguments)}.json"
        file.write_text(asked(*arguments, "--json").out, encoding="utf-8")
        return sqrp("show", file, columns=columns)

    return run


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("columns", [80, 60, 40])
def test_no_line_is_longer_than_the_terminal_and_none_is_cut_off_or_ends_in_blanks(printed, arguments, columns):
    outcome = printed(columns, *arguments)
    assert (outcome.code, outcome.err) == (0, "")
    for line in outcome.out.splitlines():
        assert width(line) <= columns or line.startswith("sqrp ")  # a command is never folded, so that it can be copied
        assert line == line.rstrip()
    assert "…" not in outcome.out
    assert "\x1b" not in outcome.out


def test_a_narrow_terminal_loses_nothing(printed, arguments):
    wide, narrow = (printed(columns, *arguments).out for columns in (200, 60))
    assert figures(wide) <= figures(narrow)
    # A chart has fewer signs (n, f, o, a, s, h) in a narrow terminal; everything else must be there.
    words = {word for word in re.findall(r"[A-Za-z_]{3,}", wide) if not set(word) <= set("nfoash")}
    assert words - set(re.findall(r"[A-Za-z_]{3,}", narrow)) == set()


MAIN = "from sqrp_cli.cli.main import main\nmain()"


def in_a_terminal(arguments: list[str], columns: int, program: str = MAIN, **variables: str) -> str:
    """What a command prints to a terminal of its own, without colour unless variables say otherwise."""
    environment = {**os.environ, "COLUMNS": str(columns), "NO_COLOR": "1", "TERM": "xterm", **variables}
    words = ["-c", f"{shlex.join([sys.executable, '-c', program, *arguments])} 2> /dev/null"]
    shown = pexpect.spawn("/bin/sh", words, env=environment, encoding="utf-8", timeout=60)
    text = shown.read()
    shown.close()
    assert shown.exitstatus == 0
    return text.replace("\r\n", "\n")


def test_a_terminal_shows_the_same_text_as_a_file_and_no_colour_where_none_is_wanted(sqrp, watch):
    arguments = ["rank", str(watch), "watch cube"]
    shown = in_a_terminal(arguments, 80)
    assert not re.search(r"\x1b\[3[0-7]m", shown)
    assert re.sub(r"\x1b\[[0-9;]*m", "", shown) == sqrp(*arguments).out


def test_no_line_ends_in_blanks_where_there_is_colour(watch):
    shown = in_a_terminal(["check", str(watch), "watch cube"], 80, NO_COLOR="", TERM="xterm-256color")
    assert "\x1b[1mcandidate" in shown
    text = re.sub(r"\x1b\[[0-9;]*m", "", shown)
    assert [line for line in text.splitlines() if line != line.rstrip()] == []


@pytest.fixture
def diagnostics(monkeypatch):
    """What is told on stderr where that is no terminal."""
    out = io.StringIO()
    monkeypatch.setattr(console, "diagnostics", lambda: Console(file=out))
    return out


def test_only_a_step_that_takes_long_has_a_line_now_and_then_where_stderr_is_no_terminal(monkeypatch, diagnostics):
    with console.progress("Assessing pickup green", None):
        time.sleep(0.01)
    assert diagnostics.getvalue() == ""
    monkeypatch.setattr(progress_lines, "PERIOD", 0.05)
    with console.progress("Assessing pickup green", 40) as advance:
        advance(12)
        time.sleep(0.5)
    lines = diagnostics.getvalue().splitlines()
    assert 2 <= len(lines) <= 10
    told = [re.fullmatch(r"Assessing pickup green: 12 of 40 after [01] s, about (\d) s left", line) for line in lines]
    assert all(found is not None and int(found[1]) <= 3 for found in told), lines


def test_a_run_says_how_far_it_is_where_stderr_is_no_terminal(monkeypatch, diagnostics):
    monkeypatch.setattr(progress_lines, "PERIOD", 0.05)
    with live_view(["cam1"], planned=13.87) as view:
        for t in (0.4, 1.2, 2.9, 5.1):
            view(event("stopping", t))
        time.sleep(0.2)
    assert diagnostics.getvalue().splitlines()[0].startswith("Running, seconds of the motion: 5 of 14 after 0 s")


def test_where_the_last_parts_take_long_no_time_left_is_told(monkeypatch):
    monkeypatch.setattr(progress_lines, "PERIOD", 0.05)
    lines: list[str] = []
    with progress_lines.progress_lines("Surveying", 852, lines.append) as advance:
        advance(848)
        time.sleep(0.3)
    assert lines
    assert not [line for line in lines if "left" in line], lines


def test_beside_a_document_no_progress_is_told(sqrp, watch, monkeypatch):
    monkeypatch.setattr(progress_lines, "PERIOD", 1e-3)
    assess = pipeline.RankJob.assess
    monkeypatch.setattr(pipeline.RankJob, "assess", lambda *given: (time.sleep(0.1), assess(*given))[1])
    assert sqrp("rank", watch, "watch seen", "--json").err == ""
    assert "Assessing watch seen: 0 of 1 after 0 s" in sqrp("rank", watch, "watch seen").err


def test_progress_shows_how_much_is_done_and_time_left_however_long_the_task(monkeypatch):
    shown = io.StringIO()
    terminal = Console(file=shown, force_terminal=True, width=80, color_system=None)
    monkeypatch.setattr(console, "diagnostics", lambda: terminal)
    with console.progress(f"Assessing pickup {'approach_yaw=0,45deg,90deg ' * 5}", 1600) as advance:
        advance(1599)
    text = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", shown.getvalue())
    lines = [line.rstrip() for line in re.split(r"[\r\n]+", text) if line.strip()]
    assert re.fullmatch(r"Assessing pickup approach_yaw=.*… \S+ 1599/1600 [-\d:]+", lines[-1])
    assert all(len(line) <= 80 for line in lines)


@pytest.fixture(scope="module")
def narrow(watch):
    """What a terminal shows by its columns, all in one process, which takes long to start."""
    widths = ("0", "1", "2", "19", "20")
    program = (
        "import os, sys\nfrom sqrp_cli.cli.main import run\n"
        f"for columns in {widths}:\n"
        "    os.environ['COLUMNS'] = columns\n    assert run(sys.argv[1:]) == 0\n    print('\\f', end='', flush=True)"
    )
    *shown, rest = in_a_terminal(["check", str(watch)], 0, program).split("\f")
    assert rest == ""
    return dict(zip(widths, shown, strict=True))


@pytest.mark.parametrize("columns", ["0", "1", "2", "19"])
def test_a_terminal_too_narrow_for_words_gets_lines_of_twenty(narrow, columns):
    assert narrow["20"]
    assert narrow[columns] == narrow["20"]


@pytest.mark.parametrize("width", range(20, 34))
def test_a_number_is_not_parted_from_its_unit(monkeypatch, width):
    out = io.StringIO()
    monkeypatch.setattr(console, "output", lambda: Console(file=out, width=width, color_system=None))
    console.say("then delay is 0.74 s, not 0.5 s (cam1 is 30 deg too oblique, 20 percent)")
    lines = out.getvalue().splitlines()
    assert not [line for line in lines if re.match(r"(s|deg)\b", line)]
    assert " ".join(lines) == "then delay is 0.74 s, not 0.5 s (cam1 is 30 deg too oblique, 20 percent)"


MEND = "  to mend it: sqrp rules unknown-key"


@pytest.mark.parametrize(("terminal", "lines"), [
        (True, ["error: `cameras.cam1.fps` is no", "    known key; did you mean `rate`?", MEND]),
        (False, ["error: `cameras.cam1.fps` is no known key; did you mean `rate`?", MEND]),
])  # fmt: skip
def test_errors_are_folded_in_a_terminal_but_for_commands(monkeypatch, terminal, lines):
    shown = io.StringIO()
    written = Console(file=shown, force_terminal=terminal, width=37, color_system=None)
    monkeypatch.setattr(console, "diagnostics", lambda: written)
    message = "`cameras.cam1.fps` is no known key; did you mean `rate`?"
    console.print_problems([Problem("unknown-key", message, mend="sqrp rules unknown-key")])
    assert shown.getvalue().splitlines() == lines
