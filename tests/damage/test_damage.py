"""A sample of the damages of `make damage`: a clear refusal or a result, never a traceback, never a hang."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.damage.cell import KINDS, whole_cell
from tests.damage.trial import passed, report, try_damages

SAMPLE = range(0, 2000, 13)


def test_damaged_files_are_refused_with_file_and_key_or_still_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = whole_cell(tmp_path / "cell")
    trials = list(try_damages(cell, SAMPLE))
    with capsys.disabled():
        summary = report(trials, worst=0 if passed(trials) else 20)
        print("\n" + "\n".join(summary.splitlines()[:3]))
    assert {trial.file for trial in trials} == set(KINDS)
    assert passed(trials), summary
