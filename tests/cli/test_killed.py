"""A command whose whole process group is killed leaves no shared memory behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SHARED = "/dev/shm/"  # noqa: S108 - only looked at


def processes_of(group: int) -> Iterator[Path]:
    """The folders in /proc of the processes of a group."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if os.getpgid(int(folder.name)) == group:
                yield folder
        except ProcessLookupError:
            continue


def shared_by(group: int) -> set[str]:
    """The shared memory that a group has in use, as the system names it; what has no name any more is `(deleted)`."""
    found = set()
    for folder in processes_of(group):
        try:
            lines = (folder / "maps").read_text(encoding="utf-8").splitlines()
            found |= {line[line.index(SHARED) :] for line in lines if SHARED in line}
        except OSError:
            continue
    return found


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="this system does not tell what memory is shared")
@pytest.mark.parametrize("command", ["run", "score"])
def test_no_shared_memory_is_left_of_a_group_that_is_killed(quick_cell, watch, tmp_path, command):
    out, log = tmp_path / "results", tmp_path / "log"
    arguments = {
        "run": ["run", quick_cell.program, "--sim", "--log", log],
        "score": ["score", quick_cell.folder, watch, "--jobs", "2", "--out", out],
    }[command]
    process = subprocess.Popen(
        [sys.executable, "-m", "sqrp_cli", *map(str, arguments)],
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    used: set[str] = set()
    deadline = time.monotonic() + 90
    while process.poll() is None and time.monotonic() < deadline:
        used |= shared_by(process.pid)
        begun = log.is_file() and log.stat().st_size > 5000 if command == "run" else any(out.rglob("*.json"))
        if begun:
            break
        time.sleep(0.01)
    assert process.poll() is None, "it ended before it could be killed"
    used |= shared_by(process.pid)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert bool(used) == (command == "run")  # images go through shared memory, candidates through pipes
    assert [name for name in used if Path(name.removesuffix(" (deleted)")).exists()] == []


def test_a_new_cell_that_is_ended_on_the_way_leaves_no_folder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "sqrp_cli", "init", str(tmp_path / "cell")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert [path.name for path in tmp_path.iterdir()] == [f".cell.{process.pid}"]
    process.terminate()
    assert process.wait(timeout=60) == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
