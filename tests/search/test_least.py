"""The least vector that does, against a look at every point of a grid."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from sqrp_cli.search.least import LeastSearch, shells

STEP = 0.01


def search(does, dimension: int, reach: float = 0.5) -> LeastSearch:
    return LeastSearch(does, lambda vector: bool(does(vector[None])[0]), dimension, STEP, reach, seed=0)


def least(does, dimension: int, reach: float = 0.5):
    one = search(does, dimension, reach)
    found = one.anywhere()
    if found is None:
        return None
    nearer = one.within(0.95 * float(np.linalg.norm(found)))
    return found if nearer is None else nearer


def grid(dimension: int, length: float) -> np.ndarray:
    most = int(length / STEP)
    points = STEP * np.array(list(product(range(-most, most + 1), repeat=dimension)), dtype=float)
    lengths = np.linalg.norm(points, axis=1)
    return points[(lengths > 0) & (lengths <= length)]


def beyond_a_plane(vectors):
    return vectors @ np.array([0.6, 0.0, 0.8]) > 0.107


def in_a_ball(vectors):
    """A pocket 2 cm wide."""
    return np.linalg.norm(vectors - np.array([0.05, -0.08, 0.03]), axis=1) < 0.02


def behind_a_gap(vectors):
    """Far places all around, and a near pocket which a descent from them does not reach."""
    near = np.linalg.norm(vectors - np.array([0.0, 0.0, -0.07]), axis=1) < 0.012
    return near | (vectors[:, 0] > 0.13)


@pytest.mark.parametrize(
    ("does", "exact"),
    [(beyond_a_plane, 0.107), (in_a_ball, np.linalg.norm([0.05, -0.08, 0.03]) - 0.02), (behind_a_gap, 0.058)],
)
def test_no_point_of_the_grid_within_95_percent_does(does, exact):
    found = least(does, 3)
    length = float(np.linalg.norm(found))
    assert does(found[None])[0]
    assert exact - 1e-9 <= length <= 1.05 * exact
    assert not does(grid(3, 0.95 * length)).any()


def test_directions_in_a_plane_are_searched_as_well():
    found = least(lambda vectors: vectors[:, 1] < -0.061, 2)
    assert 0.061 <= np.linalg.norm(found) < 0.062


def test_nothing_is_found_where_nothing_does():
    assert least(lambda vectors: np.zeros(len(vectors), dtype=bool), 3) is None
    assert least(lambda vectors: np.linalg.norm(vectors, axis=1) > 0.3, 3, reach=0.25) is None


def test_what_a_quick_test_lets_pass_is_decided():
    def decided(vector):
        return bool(vector[2] > 0.04)

    one = LeastSearch(lambda vectors: np.ones(len(vectors), dtype=bool), decided, 3, STEP, 0.5, seed=0)
    found = one.anywhere()
    assert found is not None
    assert decided(found)


@pytest.mark.parametrize("dimension", [2, 3])
def test_shells_go_outward_and_have_every_vector_once(dimension):
    batches = list(shells(dimension, STEP, 0.5))
    lengths = [np.linalg.norm(batch, axis=1) for batch in batches]
    for inner, outer in pairwise(lengths):
        assert inner.max() < outer.min()
    together = np.concatenate(batches)
    assert len(np.unique(together.round(9), axis=0)) == len(together)
    assert np.concatenate(lengths).max() <= 0.5 * (1 + 1e-9)
