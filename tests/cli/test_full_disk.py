"""A disk that is full: the message names the file that could not be written, whichever option asked for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ARM = Path(__file__).parents[2] / "workspaces" / "robots" / "six_axis_arm.urdf"
FULL = "No space left on device"
LIMIT = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))"
"""No file may have more bytes, which is as good as a full disk."""


def full(path: Path) -> Path:
    """A name for a device that is always full."""
    path.symlink_to("/dev/full")
    return path


@pytest.mark.parametrize("option", ["--junit", "--summary", "--report", "--save-baseline"])
def test_a_file_of_score_is_named_and_what_was_scored_is_printed(sqrp, watch, tmp_path, option):
    path = full(tmp_path / "out.html")
    outcome = sqrp("score", watch, option, path)
    assert outcome.code == 2
    assert f"error: {path}: this file cannot be written: {FULL}" in outcome.err
    assert "1 of 1 task passed." in outcome.out


@pytest.mark.parametrize(
    "arguments",
    [
        ["rank", "{watch}", "watch green", "--report", "{file}"],
        ["rank", "{watch}", "watch green", "--program", "{file}"],
    ],
    ids=" ".join,
)
def test_a_page_or_a_program_is_named(sqrp_process, watch, tmp_path, arguments):
    path = tmp_path / "out.html"
    outcome = sqrp_process(*(word.format(watch=watch, file=path) for word in arguments), prelude=LIMIT.format(100))
    assert outcome.code == 2
    assert f"error: {path}: this file cannot be written: File too large" in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_named(sqrp_process, watch, tmp_path):
    arguments = ("watch turned", "--images", tmp_path / "pictures")
    outcome = sqrp_process("explain", watch, *arguments, prelude=LIMIT.format(100))
    assert outcome.code == 2
    assert f"error: {tmp_path / 'pictures'}/" in outcome.err
    assert "this file cannot be written: File too large" in outcome.err


def test_a_folder_of_results_names_the_file_in_it(sqrp_process, watch, tmp_path):
    outcome = sqrp_process("score", watch, "--out", tmp_path / "results", prelude=LIMIT.format(100))
    assert (outcome.code, outcome.out) == (2, "")
    assert f"error: {tmp_path / 'results'}" in outcome.err
    assert "File too large" in outcome.err


def test_a_new_workspace_is_named_and_nothing_is_left_of_it(sqrp_process, tmp_path):
    for limit in (100, 2100):  # the skill does not fit, or the workspace file
        outcome = sqrp_process("init", tmp_path / "cell", "--urdf", ARM, prelude=LIMIT.format(limit))
        assert (outcome.code, outcome.out) == (2, "")
        assert f"error: {tmp_path / 'cell'}: this folder cannot be made: " in outcome.err
        assert "File too large" in outcome.err
        assert list(tmp_path.iterdir()) == []


def test_a_log_is_named(sqrp, quick_cell, tmp_path):
    path = full(tmp_path / "run.jsonl")
    outcome = sqrp("run", quick_cell.program, "--sim", "--log", path)
    assert (outcome.code, outcome.out) == (2, "")
    assert f"error: {path}: this file cannot be written: {FULL}" in outcome.err


def test_a_film_is_named(sqrp, quick_cell, tmp_path):
    path = full(tmp_path / "film.mp4")
    outcome = sqrp("run", quick_cell.program, "--sim", "--record", path)
    assert outcome.code == 2
    assert f"error: {path}: this film could not be written, or not as a whole; is the disk full?" in outcome.err


KEEP = """
import numpy as np
from pathlib import Path
from sqrp_cli.errors import InputError
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.record.images import FrameFolder
noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
try:
    folder = FrameFolder(Path({folder!r}))
    folder.add(CameraImage("cam1", 0.0, noise), 1, 0.0)
except InputError as error:
    print(error)
"""


def test_an_image_is_named(tmp_path):
    program = LIMIT.format(1000) + KEEP.format(folder=str(tmp_path / "frames"))
    said: Any = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert said.stdout == f"{tmp_path / 'frames' / 'cam1-000000.png'}: this file cannot be written: File too large\n"
