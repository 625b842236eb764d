"""A sample of the damages of `make damage`: a clear refusal or a result, never a traceback, never a hang."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.damage.kinds import KINDS, TURNS
from tests.damage.trial import passed, report, try_damages

ROOT = Path(__file__).parents[2]

SAMPLE = sorted(TURNS.index(kind) for kind in KINDS)
"""One of every kind."""


def test_damaged_input_is_refused_with_file_and_place_or_still_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell"
    # In a process of its own: commands are forked from it, within a limit of memory that earlier tests use up here.
    made = f"from pathlib import Path; from tests.damage.cell import whole_cell; whole_cell(Path({str(cell)!r}))"
    subprocess.run([sys.executable, "-c", made], cwd=ROOT, check=True)
    trials = list(try_damages(cell, SAMPLE))
    with capsys.disabled():
        summary = report(trials, worst=0 if passed(trials) else 20)
        print("\n" + "\n".join(summary.splitlines()[:4]))
    assert {trial.kind for trial in trials} == {kind.name for kind in KINDS}
    assert passed(trials), summary
