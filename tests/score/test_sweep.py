"""Which variants a sweep has; of those that are equally good the one with most margin is taken."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sqrp_cli.errors import InputError
from sqrp_cli.score.sweep import middle_of_draws, middle_of_grid, read_variation, variants
from tests.cells import read_cases

CASES = read_cases("scores.yaml")


def grid(*texts: str, draws: int | None = None, seed: int = 0):
    return variants([read_variation(text) for text in texts], draws, seed)


def test_a_grid_has_every_combination_with_both_ends() -> None:
    found = grid("cameras.a.pose.position[0]=0.8:1.2:3", "cameras.a.far=1 m:2 m:2")
    assert len(found) == 6
    assert found[0] == (("cameras.a.pose.position.0", "0.8"), ("cameras.a.far", "1 m"))
    assert found[-1] == (("cameras.a.pose.position.0", "1.2"), ("cameras.a.far", "2 m"))
    assert len(set(found)) == 6
    assert [values[0][1] for values in grid("a.b=-90 deg:-45 deg:3")] == ["-90 deg", "-67.5 deg", "-45 deg"]


def test_draws_lie_between_the_ends_and_are_the_same_for_a_seed() -> None:
    found = grid("a=-1:1", "b=2:3", draws=50, seed=4)
    assert found == grid("a=-1:1", "b=2:3", draws=50, seed=4) != grid("a=-1:1", "b=2:3", draws=50, seed=5)
    assert all(-1 <= float(a[1]) <= 1 and 2 <= float(b[1]) <= 3 for a, b in found)
    assert len(set(found)) == 50


@pytest.mark.parametrize("texts", CASES["refused"])
def test_what_is_no_variation_is_refused(texts: list[str]) -> None:
    with pytest.raises(InputError):
        grid(*texts)


@pytest.mark.parametrize(("equal", "middle"), CASES["rows"])
def test_in_a_row_it_is_the_middle_of_the_longest_run(equal: str, middle: int) -> None:
    assert middle_of_grid(np.array([sign == "1" for sign in equal])) == middle


@pytest.mark.parametrize(("rows", "middle"), CASES["grids"])
def test_on_a_grid_it_is_the_middle_of_the_largest_block(rows: list[str], middle: list[int]) -> None:
    equal = np.array([[sign == "1" for sign in row] for row in rows])
    assert np.unravel_index(middle_of_grid(equal), equal.shape) == tuple(middle)
    assert middle_of_grid(np.ones((1, 5, 1), dtype=bool)) == 2  # a value that is not varied has no border


@given(arrays(bool, array_shapes(min_dims=1, max_dims=3, max_side=5)))
def test_no_point_of_its_block_has_more_margin(equal: np.ndarray) -> None:
    if not equal.any():
        return
    chosen = np.unravel_index(middle_of_grid(equal), equal.shape)
    assert equal[chosen]
    blocks = blocks_of(equal)
    own = next(block for block in blocks if chosen in block)
    assert len(own) == max(map(len, blocks))
    assert margin(chosen, own, equal.shape) == max(margin(point, own, equal.shape) for point in own)


def blocks_of(equal: np.ndarray) -> list[set[tuple[int, ...]]]:
    """Connected points, by joining neighbours until nothing changes."""
    blocks = [{point} for point in map(tuple, np.argwhere(equal).tolist())]
    for one, other in product(np.argwhere(equal).tolist(), repeat=2):
        if sum(abs(a - b) for a, b in zip(one, other, strict=True)) == 1:
            first, second = (next(block for block in blocks if tuple(end) in block) for end in (one, other))
            if first is not second:
                first |= second
                blocks = [block for block in blocks if block is not second]
    return blocks


def margin(point: tuple[int, ...], block: set[tuple[int, ...]], shape: tuple[int, ...]) -> int:
    """By how many steps every varied value may be off at once."""
    steps = 0
    while all(
        tuple(a + b for a, b in zip(point, offset, strict=True)) in block
        for offset in product(*(range(-steps, steps + 1) if count > 1 else (0,) for count in shape))
    ):
        if all(count == 1 for count in shape):
            return 0
        steps += 1
    return steps


@given(st.integers(2, 12), st.integers(1, 3), st.integers(0, 999))
def test_of_draws_it_is_the_one_whose_nearest_unequal_is_farthest(count: int, paths: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.random((count, paths))
    equal = rng.random(count) < 0.5
    equal[rng.integers(count)] = True
    chosen = middle_of_draws(equal, points)
    assert equal[chosen]
    if equal.all():
        centre = np.linalg.norm(points - 0.5, axis=1)
        assert centre[chosen] == centre.min()
        return
    nearest = [min(np.linalg.norm(points[i] - points[j]) for j in np.flatnonzero(~equal)) for i in range(count)]
    assert nearest[chosen] == pytest.approx(max(nearest[i] for i in np.flatnonzero(equal)))
