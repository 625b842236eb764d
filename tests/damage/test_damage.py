"""A sample of the damages of `make damage`: a clear refusal or a result, never a traceback, never a hang."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.damage.cell import whole_cell
from tests.damage.kinds import KINDS
from tests.damage.trial import passed, report, try_damages

SAMPLE = range(0, 10_000, 67)
"""Every kind, as none of them takes its turn every 67 cases."""


def test_damaged_input_is_refused_with_file_and_place_or_still_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = whole_cell(tmp_path / "cell")
    trials = list(try_damages(cell, SAMPLE))
    with capsys.disabled():
        summary = report(trials, worst=0 if passed(trials) else 20)
        print("\n" + "\n".join(summary.splitlines()[:4]))
    assert {trial.kind for trial in trials} == {kind.name for kind in KINDS}
    assert passed(trials), summary
