"""The search for the fastest sequence, against trying all of them."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.motion.joint_moves import fastest_sequence


@given(st.integers(0, 100_000), st.lists(st.integers(1, 4), min_size=1, max_size=4), st.booleans())
def test_the_sequence_is_the_fastest_that_works_with_ties_by_joint_values(seed, sizes, ties):
    rng = np.random.default_rng(seed)

    def times(*shape: int) -> np.ndarray:
        return rng.integers(1, 3, shape).astype(float) if ties else rng.uniform(0, 1, shape)

    starts, durations = [rng.normal(size=(k, 2)) for k in sizes], [times(k) for k in sizes]
    moves = [times(a, b) for a, b in pairwise(sizes)]
    blocked = {
        (i, previous, chosen)
        for i, size in enumerate(sizes)
        for previous in (range(sizes[i - 1]) if i else (-1,))
        for chosen in range(size)
        if rng.random() < 0.4
    }
    asked: list[tuple[int, ...]] = []

    def works(*question: int) -> bool:
        asked.append(question)
        return question[:3] not in blocked

    def total(chosen: tuple[int, ...]) -> float:
        own = sum(float(duration[k]) for duration, k in zip(durations, chosen, strict=True))
        return own + sum(float(moves[i][chosen[i], chosen[i + 1]]) for i in range(len(moves)))

    def possible(chosen: tuple[int, ...]) -> bool:
        return not any((i, chosen[i - 1] if i else -1, k) in blocked for i, k in enumerate(chosen))

    def order(chosen: tuple[int, ...]) -> tuple[float, list[float]]:
        joints = [np.round(start[k], 6) for start, k in zip(starts, chosen, strict=True)]
        return round(total(chosen), 6), np.concatenate(joints).tolist()

    best = min(filter(possible, product(*map(range, sizes))), key=order, default=None)
    assert fastest_sequence(starts, durations, moves, works) == best
    assert len(asked) == len(set(asked))
