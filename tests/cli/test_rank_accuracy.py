"""What `sqrp rank` says of how finely a motion was sampled is true of the samples that it took."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Outcome


@pytest.mark.parametrize("step", ["1e9", "1", "0.3"])
def test_the_bound_holds_where_coverage_changes_at_most_once_between_samples(
    sqrp: Callable[..., Outcome], watch: Path, step: str
) -> None:
    exact = sqrp("rank", watch, "watch turned", "--json").document["candidates"][0]
    coarse = sqrp("rank", watch, "watch turned", "--dt", step, "--json").document
    error = coarse["sampling"]["error"]
    assert abs(coarse["candidates"][0]["q_avg"] - exact["q_avg"]) <= error + 1.1e-3
