"""Exit codes and messages, whatever stdin, stdout and stderr are connected to."""

from __future__ import annotations

import ast
import errno
import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import sqrp_cli
from sqrp_cli.cli.streams import _LOOK_ALIKES
from sqrp_cli.shown import shown_name

PACKAGE = Path(sqrp_cli.__file__).parent

SQRP = [sys.executable, "-m", "sqrp_cli"]
REASONS = {">&-": "Bad file descriptor", ">/dev/full": "No space left on device"}
"""Why results are lost, by where they go."""

needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")


def redirected(arguments: list[str], redirections: str, **variables: str) -> subprocess.CompletedProcess[bytes]:
    """A command run by a shell with redirections."""
    script = f'exec "$@" {redirections}'
    environment = {**os.environ, **variables}
    return subprocess.run(
        ["/bin/sh", "-c", script, "sh", *SQRP, *arguments],
        capture_output=True,
        env=environment,
        check=False,
        timeout=60,
    )


QUICK = [
    (["--version"], 0, True, "", ""),
    (["rnak"], 2, False, "<&-", "1"),
]
"""Words, exit code, whether there are results, and what stdin and PYTHONUNBUFFERED are."""

WITH_LIBRARIES = [
    (["show", "{watch}", "--json"], 0, True, "<&-", "1"),
    (["rank", "{watch}", "watch stray"], 1, True, "", ""),
    (["show", "nowhere"], 2, False, "", ""),
]
"""The same of commands that take half a second to start."""

OUT, ERR = ("", ">&-", ">/dev/full"), ("", "2>&-", "2>/dev/full")


@needs_full
@pytest.mark.parametrize(
    ("arguments", "code", "has_results", "stdin", "unbuffered", "out", "err"),
    [
        *((*command, out, err) for command in QUICK for out, err in zip(OUT, ERR, strict=True)),
        *((*command, out, err) for command in WITH_LIBRARIES for out, err in [(OUT[0], ERR[1]), (OUT[2], ERR[0])]),
    ],
    ids=lambda value: " ".join(value)[:30] if isinstance(value, list) else None,
)
def test_the_exit_code_is_that_of_the_command_or_of_lost_results(
    watch: Path, arguments: list[str], code: int, has_results: bool, stdin: str, unbuffered: str, out: str, err: str
) -> None:
    filled = [argument.format(watch=watch) for argument in arguments]
    found = redirected(filled, f"{out} {err} {stdin}", PYTHONUNBUFFERED=unbuffered)
    lost = has_results and out in REASONS
    assert found.returncode == (2 if lost else code)
    assert bool(found.stdout) is (has_results and not out)
    if err or (has_results and not lost):
        assert found.stderr == b""
    elif lost:
        assert found.stderr.decode() == f"error: the output cannot be written: {REASONS[out]}\n"
    else:
        assert found.stderr


@pytest.mark.parametrize(
    "variables", [{"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1:strict"}, {"LC_ALL": "C"}]
)
def test_names_of_any_bytes_are_shown_by_any_encoding(watch: Path, tmp_path: Path, variables: dict[str, str]) -> None:
    folder = b"caf\xe9 " + "日本".encode()
    cell = os.path.join(os.fsencode(tmp_path), folder)  # noqa: PTH118 - bytes
    shutil.copytree(os.fsencode(watch), cell)
    for arguments in (["rank", "watch seen"], ["show", "--json"]):
        command, *rest = arguments
        found = redirected([command, os.fsdecode(cell), *rest], "", **variables)
        assert (found.returncode, found.stderr) == (0, b"")
        if "--json" in arguments:
            assert json.loads(found.stdout)["workspace"] == shown_name(os.fsdecode(folder))
    missing = redirected(["show", os.fsdecode(os.path.join(cell, b"\xe9"))], "", **variables)  # noqa: PTH118
    assert missing.returncode == 2
    assert b"no such file or folder" in missing.stderr
    assert missing.stderr.count(b"\n") == 1


def test_signs_of_charts_and_tables_have_look_alikes_in_ascii(watch: Path) -> None:
    command = ["explain", str(watch), "watch seen"]
    usual, plain = redirected(command, ""), redirected(command, "", PYTHONIOENCODING="ascii")
    chart, signs = plain.stdout.decode("ascii"), usual.stdout.decode()
    assert "?" not in chart
    assert [len(line) for line in chart.splitlines()] == [len(line) for line in signs.splitlines()]
    assert ("█" in signs, "#" in chart) == (True, True)


def test_every_sign_of_the_terminal_has_a_look_alike() -> None:
    files = [*(PACKAGE / "show" / "terminal").glob("*.py"), *(PACKAGE / "cli").rglob("*.py")]
    texts = [
        node.value
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    signs = {sign for text in texts for sign in text if sign.isprintable() and not sign.isascii()}
    assert "█" in signs
    assert signs <= set(_LOOK_ALIKES)


def test_a_run_in_a_folder_of_any_name_keeps_its_log(sqrp: Callable[..., Any], watch: Path, tmp_path: Path) -> None:
    cell = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    shutil.copytree(watch, cell)
    program, log = cell / "program.yaml", cell / "run.jsonl"
    assert sqrp("rank", cell, "watch seen", "--program", program).code == 0
    ran = sqrp("run", program, "--sim", "--log", log, "--report", cell / "page.html")
    assert ran.code == 3, ran.err
    again = sqrp("run", program, "--replay", log)
    assert (again.code, again.out) == (3, ran.out)


def test_a_reader_that_is_slow_on_a_pipe_that_does_not_wait_gets_everything(watch: Path) -> None:
    command = [*SQRP, "explain", str(watch), "watch cube", "--all", "--json"]
    expected = subprocess.run(command, capture_output=True, check=True).stdout
    assert len(expected) > 2**17, "more than the pipe holds"
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETFL, os.O_NONBLOCK)
    with subprocess.Popen(command, stdout=writing, stderr=subprocess.PIPE) as process:
        os.close(writing)
        time.sleep(2.0)
        with open(reading, "rb") as pipe:  # noqa: PTH123 - a descriptor
            assert pipe.read() == expected
        assert process.stderr is not None
        assert process.stderr.read() == b""
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 2, "Cannot allocate memory"),
        (OSError(errno.ENOENT, "No such file or directory", "arm.stl"), 2, "error: arm.stl: No such file"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 2, "Broken pipe"),  # to a process of its own that has died
        (MemoryError(), 2, "error: there is not enough memory"),
        (EOFError(), 70, "internal error: EOFError"),
        (RuntimeError("\x1b[31m\n::error::x"), 70, "internal error: RuntimeError: ?[31m ::error::x; run"),
    ],
    ids=repr,
)
def test_no_error_of_the_system_looks_like_an_answer_or_an_interruption(
    sqrp: Callable[..., Any], watch: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, code: int, words: str
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr("sqrp_cli.cell.load.load_workspace", broken)
    outcome = sqrp("show", watch)
    assert (outcome.code, outcome.out) == (code, "")
    assert words in outcome.err
    assert outcome.err.count("\n") == 1
    assert "output" not in outcome.err


def test_without_any_input_a_dialog_ends(watch: Path) -> None:
    found = redirected(["program", "new", str(watch)], "<&-")
    assert found.returncode == 0
    assert found.stderr.decode() == "no step was chosen, so nothing was written\n"
