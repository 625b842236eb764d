"""Which variants a sweep has."""

from __future__ import annotations

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.score.sweep import read_variation, variants


def grid(*texts: str, draws: int | None = None, seed: int = 0):
    return variants([read_variation(text) for text in texts], draws, seed)


def test_a_grid_has_every_combination_with_both_ends() -> None:
    found = grid("cameras.a.pose.position[0]=0.8:1.2:3", "cameras.a.far=1 m:2 m:2")
    assert len(found) == 6
    assert found[0] == (("cameras.a.pose.position.0", "0.8"), ("cameras.a.far", "1 m"))
    assert found[-1] == (("cameras.a.pose.position.0", "1.2"), ("cameras.a.far", "2 m"))
    assert len(set(found)) == 6


def test_a_unit_stays_the_unit_of_the_value() -> None:
    assert [values[0][1] for values in grid("a.b=-90 deg:-45 deg:3")] == ["-90 deg", "-67.5 deg", "-45 deg"]


def test_draws_lie_between_the_ends_and_are_the_same_for_a_seed() -> None:
    found = grid("a=-1:1", "b=2:3", draws=50, seed=4)
    assert found == grid("a=-1:1", "b=2:3", draws=50, seed=4) != grid("a=-1:1", "b=2:3", draws=50, seed=5)
    assert all(-1 <= float(a[1]) <= 1 and 2 <= float(b[1]) <= 3 for a, b in found)
    assert len(set(found)) == 50


@pytest.mark.parametrize(
    "texts",
    [["a"], ["a=1"], ["a=1:2:3:4"], ["a=1:x:3"], ["a=1 m:2 cm:3"], ["=1:2:3"], ["a=1:2:0"], ["a=1:2"],
     ["a=1:2:3", "a=1:2:3"], ["a=1:2:101", "b=1:2:100"]],
)  # fmt: skip
def test_what_is_no_variation_is_refused(texts: list[str]) -> None:
    with pytest.raises(InputError):
        grid(*texts)
