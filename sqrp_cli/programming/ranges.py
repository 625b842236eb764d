"""Many ranges of whole numbers as one array, and runs of equal ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def ranges(first: NDArray[Any], last: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The whole numbers of each range from `first`, included, to `last`, not included, with the range's index."""
    first = first.astype(np.int64)
    count = np.maximum(last.astype(np.int64) - first, 0)
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) + np.repeat(first - np.cumsum(count) + count, count)


def begins_run(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each value (n,) differs from the one before it; the first one does."""
    begins = np.ones(len(values), dtype=bool)
    np.not_equal(values[1:], values[:-1], out=begins[1:])
    return begins
