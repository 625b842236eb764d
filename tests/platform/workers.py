"""What workers do in tests: a module that they can import."""

from __future__ import annotations

from collections.abc import Callable


def doubling() -> Callable[[int], int]:
    return lambda number: 2 * number
