"""That something cannot be done, as a result."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Infeasible:
    """Why something cannot be done: sentences with figures, the most useful first."""

    reasons: tuple[str, ...]
