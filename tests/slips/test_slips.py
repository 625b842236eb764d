"""A few slips in a cell made by seed, seen by images within the predicted delay."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.slips.__main__ import compared, slips


@pytest.mark.slow
def test_slips_are_seen_by_images_within_the_longest_predicted_delay(tmp_path: Path) -> None:
    ways, done = slips(tmp_path / "cell", seed=8, count=2)
    found = compared(ways, done)
    assert found.slips
    assert found.within == len(found.slips)
