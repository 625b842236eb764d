"""The worst change comes first, as it is what a CI server shows."""

from __future__ import annotations

import pytest

from sqrp_cli.score.result import Shift, WayChange


def test_the_severity_of_a_change_is_its_largest_worsening():
    fell = Shift("q_eoi", 0.62, 0.0, worse=True)
    slower = Shift("time", 10.0, 11.0, worse=True)
    better = Shift("q_avg", 0.1, 0.9, worse=False)
    assert WayChange("g4", "g4", "g4", (slower, fell, better)).severity == pytest.approx(0.62)
    assert WayChange("g5", "g5", "g5", (slower, better)).severity == pytest.approx(0.1)
    assert WayChange("g6", "g6", "g6", (Shift("feasible", 1.0, 0.0, worse=True),)).severity == 1.0
    assert WayChange("g7", "g7", "g7", (better,)).severity == 0.0
