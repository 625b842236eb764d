"""A few of the random cells of `python -m tests.advice`."""

from __future__ import annotations

import pytest

from tests.advice.__main__ import mended
from tests.advice.broken import broken_cell

CELLS = (0, 7, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (9, 10)))
"""A camera moved, the part moved; as trials a camera turned and a lens narrowed."""


@pytest.mark.parametrize("seed", CELLS)
def test_a_broken_cell_is_mended_by_no_more_than_what_broke_it(tmp_path, seed):
    broken = broken_cell(tmp_path / "cell", seed)
    assert broken is not None
    result = mended(broken)
    assert result.least is not None
    assert result.least <= broken.size
    assert result.passed
