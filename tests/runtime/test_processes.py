"""How the processes of a run are started."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

PROBE = """
from sqrp_cli.runtime.processes import process_context

if __name__ == "__main__":
    context = process_context()
    ours, theirs = context.Pipe()
    process = context.Process(target=theirs.send, args=("started",))
    process.start()
    print(context.get_start_method(), ours.recv())
    process.join()
"""


def started(folder: Path, temporary: Path) -> str:
    """How a process is started that has its temporary files in a folder, and what it sends."""
    (folder / "probe.py").write_text(PROBE, encoding="utf-8")
    command, environment = [sys.executable, str(folder / "probe.py")], {**os.environ, "TMPDIR": str(temporary)}
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


@pytest.mark.skipif("forkserver" not in multiprocessing.get_all_start_methods(), reason="not on this system")
def test_processes_come_from_one_that_has_imported_what_they_need(tmp_path: Path) -> None:
    assert started(tmp_path, Path(tempfile.gettempdir())) == "forkserver started\n"


def test_processes_are_started_where_the_name_of_the_temporary_folder_is_too_long_for_a_socket(tmp_path: Path) -> None:
    temporary = tmp_path / ("long" * 30)
    temporary.mkdir()
    assert started(tmp_path, temporary) == "spawn started\n"
