"""A few slips in a cell made by seed, seen by images within the predicted delay."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.slips.__main__ import ROUNDED, compared, slips


@pytest.mark.slow
def test_slips_are_seen_by_images_within_the_longest_predicted_delay(tmp_path: Path) -> None:
    ways, done = slips(tmp_path / "cell", seed=8, count=3)
    found = list(compared(ways, done))
    assert found
    assert all(one.measured <= one.worst + ROUNDED for one in found)
