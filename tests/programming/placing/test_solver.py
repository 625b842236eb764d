"""Integer programs: compared with all combinations, and ended by Ctrl-C."""

from __future__ import annotations

import signal
from itertools import product

import numpy as np
import pytest

from sqrp_cli.programming.placing.solver import LinearProgram


def knapsack(count: int, seed: int = 0) -> tuple[LinearProgram, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    worth, weight = rng.integers(10, 60, count).astype(float), rng.integers(5, 50, (3, count)).astype(float)
    program = LinearProgram()
    for _ in range(count):
        program.variable(whole=True)
    for row in weight:
        program.row(dict(enumerate(row.tolist())), most=float(row.sum() // 3))
    return program, worth, weight


@pytest.mark.parametrize("seed", range(4))
def test_the_best_of_all_combinations_is_found_and_proven(seed: int) -> None:
    program, worth, weight = knapsack(9, seed)
    found = program.maximized(dict(enumerate(worth.tolist())))
    allowed = [x for x in product((0, 1), repeat=9) if (weight @ x <= weight.sum(axis=1) // 3).all()]
    best = max(float(worth @ x) for x in allowed)
    assert found.proven
    assert found.values is not None
    assert float(worth @ found.values) == best == pytest.approx(found.bound)


def test_what_is_impossible_is_proven_to_be() -> None:
    program = LinearProgram()
    x = program.variable(whole=True)
    program.row({x: 2.0}, least=1.0, most=1.0)
    found = program.maximized({x: 1.0})
    assert found.values is None
    assert found.proven


def test_ctrl_c_leaves_the_best_so_far_and_says_that_nothing_is_proven() -> None:
    program, worth, _ = knapsack(300)
    start = np.zeros(300)
    pressed: list[int] = []

    def press(_best: float | None, _bound: float) -> None:
        if not pressed:
            pressed.append(1)
            signal.raise_signal(signal.SIGINT)

    found = program.maximized(dict(enumerate(worth.tolist())), start, press)
    assert found.interrupted
    assert not found.proven
    assert found.values is not None
    assert float(worth @ found.values) <= found.bound
