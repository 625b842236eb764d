"""Exit codes and messages, whatever stdin, stdout and stderr are connected to."""

from __future__ import annotations

import ast
import contextlib
import errno
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import pytest

import sqrp_cli
from sqrp_cli.cli.streams import _LOOK_ALIKES
from tests.cells import command_lines

PACKAGE = Path(sqrp_cli.__file__).parent

SQRP = [sys.executable, "-m", "sqrp_cli"]


def test_every_sign_of_the_terminal_has_a_look_alike():
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


def test_a_reader_that_is_slow_on_a_pipe_that_does_not_wait_gets_everything(watch):
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
def test_no_error_of_the_system_looks_like_an_answer_or_an_interruption(sqrp, watch, monkeypatch, error, code, words):
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr("sqrp_cli.cell.load.load_workspace", broken)
    outcome = sqrp("show", watch)
    assert (outcome.code, outcome.out) == (code, "")
    assert words in outcome.err
    assert outcome.err.count("\n") == 1
    assert "output" not in outcome.err


SHARED = "/dev/shm/"  # noqa: S108 - only looked at


def shared_by(group: int) -> set[str]:
    """The shared memory that a group has in use, as the system names it; what has no name any more is `(deleted)`."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if os.getpgid(int(folder.name)) == group:
                lines = (folder / "maps").read_text(encoding="utf-8").splitlines()
                found |= {line[line.index(SHARED) :] for line in lines if SHARED in line}
    return found


def begun(*words: object, **settings: bool) -> subprocess.Popen[bytes]:
    """A command whose output nobody reads."""
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([*SQRP, *map(str, words)], **silent, **settings)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="this system does not tell what memory is shared")
@pytest.mark.parametrize("command", ["run", "score"])
def test_no_shared_memory_is_left_of_a_group_that_is_killed(quick_cell, watch, tmp_path, command):
    out, log = tmp_path / "results", tmp_path / "log"
    arguments = {
        "run": ["run", quick_cell.program, "--sim", "--log", log],
        "score": ["score", quick_cell.folder, watch, "--jobs", "2", "--out", out],
    }[command]
    process = begun(*arguments, start_new_session=True)
    used: set[str] = set()
    deadline = time.monotonic() + 90
    while process.poll() is None and time.monotonic() < deadline:
        used |= shared_by(process.pid)
        if log.is_file() and log.stat().st_size > 5000 if command == "run" else any(out.rglob("*.json")):
            break
        time.sleep(0.01)
    assert process.poll() is None, "it ended before it could be killed"
    used |= shared_by(process.pid)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert used == set()  # images and candidates go through pipes
    shared = SharedMemory(create=True, size=1)
    try:
        assert [name for name in shared_by(os.getpgid(0)) if shared.name in name]  # what is shared is found
    finally:
        shared.close()
        shared.unlink()


def test_a_new_cell_that_is_ended_on_the_way_leaves_no_folder(tmp_path):
    process = begun("init", tmp_path / "cell")
    deadline = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert [path.name for path in tmp_path.iterdir()] == [f".cell.{process.pid}"]
    process.terminate()
    assert process.wait(timeout=60) == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def odd(watch, tmp_path_factory):
    """A copy of the cell in such a folder."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path_factory.mktemp("odd")) + b"/w\xff\xe9"))
    return Path(shutil.copytree(watch, folder))


@pytest.mark.parametrize("words", command_lines("odd"), ids=" ".join)
def test_no_command_takes_a_path_that_is_not_utf8_for_a_fault_of_its_own(sqrp, odd, words):
    outcome = sqrp(*(word.replace("ODD", str(odd)) for word in words))
    assert outcome.code in (0, 1, 2), outcome.err
    assert "internal error" not in outcome.err
    if "--json" in words:
        assert json.loads(outcome.out)["schema"] == 1


def test_json_spells_out_a_path_and_a_program_elsewhere_finds_it_again(sqrp, odd, tmp_path):
    document = sqrp("show", odd, "--json").document
    assert document["workspace"] == r"w\xff\xe9"
    assert os.fsencode(document["robot"]["urdf"]) == os.fsencode(odd / "arm.urdf")
    program = tmp_path / "program.yaml"
    assert sqrp("rank", odd, "watch turned", "--program", program).code == 0
    assert sqrp("program", program, "--json").document["stale"] is False
