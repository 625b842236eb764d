"""The search for paths: its quick figures agree with the exact ones, and evolution finds the same minima each time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.find import WantedWay
from sqrp_cli.study.move_search import blind_times, evolution
from sqrp_cli.study.seen_ways import open_moves
from tests.study.compared import Compared

LOOKS = 400


@pytest.fixture(scope="module")
def compared(tabletop: Workspace) -> Compared:
    return Compared.of(tabletop, "pickup green", "g4", WantedWay(fastest=True))


def exact(found: Analysis, primitive: int) -> float:
    """How long a primitive is not covered, by the samples of the analysis [s]."""
    timeline = found.timeline
    within = np.array([piece.primitive == primitive for piece in found.planned.stage.pieces])[timeline.samples.piece]
    seen = timeline.covered[1:] & timeline.covered[:-1]
    return float(timeline.samples.gaps[within[:-1] & timeline.monitored[:-1] & ~seen].sum())


def test_blind_times_of_direct_moves_are_those_of_the_study(compared: Compared) -> None:
    found = []
    for index in (0, 4):
        trajectory = compared.seen.planned.motion.primitives[index].trajectory
        (time,) = blind_times(compared.seen.planned, index, compared.cell.observer, [trajectory], LOOKS).tolist()
        found.append(time)
        assert time == pytest.approx(exact(compared.seen, index), abs=3 * trajectory.duration / LOOKS)
    assert found[0] > 0.3


def test_paths_looked_at_together_have_the_figures_that_they_have_alone(compared: Compared) -> None:
    look = partial(blind_times, compared.seen.planned, 0, compared.cell.observer, samples=30)
    away, back = (compared.seen.planned.motion.primitives[index].trajectory for index in (0, 4))
    alone = [look([path])[0] for path in (away, back, away)]
    assert look([away, back, away]).tolist() == alone
    assert len(look([])) == 0


def test_a_move_that_no_formula_is_about_is_not_monitored(tabletop: Workspace) -> None:
    inspected = Compared.of(tabletop, "pickup green", "g2", WantedWay(fastest=True)).seen
    assert open_moves(inspected.planned, [one.name for one in inspected.planned.motion.primitives]) == [0, 1, 3, 4]


TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))[0]


def sphere(x: Array) -> Array:
    return ((x - 1.0) ** 2).sum(axis=1)


def ellipsoid(x: Array) -> Array:
    return ((x - 1.0) @ TURN) ** 2 @ np.logspace(0, 4, 6)


def banana(x: Array) -> Array:
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


def least(function: Callable[[Array], Array], generations: int, seed: int) -> float:
    search, best = evolution(np.zeros(6), np.full(6, 0.5), 12, seed), np.inf
    population = next(search)
    for _ in range(generations):
        values = function(population)
        best = min(best, float(values.min()))
        population = search.send((population, values))
    return best


@pytest.mark.parametrize(("function", "generations"), [(sphere, 120), (ellipsoid, 400), (banana, 900)])
def test_it_finds_the_minimum(function: Callable[[Array], Array], generations: int) -> None:
    assert max(least(function, generations, seed) for seed in range(3)) < 1e-8
    drawn = np.random.default_rng(0).normal(scale=0.5, size=(20 * 12, 6))
    assert least(sphere, 20, 0) < 0.1 * sphere(drawn).min()  # far better than drawing as many points


def test_the_seed_decides_all_numbers_and_the_first_population_has_the_given_mean_and_deviations() -> None:
    def populations(seed: int) -> Array:
        search = evolution(np.zeros(3), np.ones(3), 8, seed)
        found = [next(search)]
        for _ in range(4):
            found.append(search.send((found[-1], sphere(found[-1]))))
        return np.stack(found)

    np.testing.assert_array_equal(populations(1), populations(1))
    assert not np.array_equal(populations(1), populations(2))
    mean, deviation = np.array([1.0, -2.0, 0.5]), np.array([0.1, 1.0, 3.0])
    drawn = next(evolution(mean, deviation, 4000, 0))
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.1 * deviation.max())
    np.testing.assert_allclose(drawn.std(axis=0), deviation, rtol=0.05)
