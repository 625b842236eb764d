"""Pauses of this process, such as of a busy computer: they keep messages from coming, which then are not missing."""

from __future__ import annotations

from collections import deque

LONGEST_LOOK = 0.03
"""Of the time between two looks for messages so much counts [s]; the rest is a pause."""


class Pauses:
    """How long one has really waited for something, on any clock [s].

    Whoever pauses again and again still notices what stays out, only later: each look counts for something.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._pauses: deque[tuple[float, float]] = deque(maxlen=100)

    def look(self, t: float) -> None:
        """It is looked for messages at time t [s]."""
        if t > self._now + LONGEST_LOOK:
            self._pauses.append((self._now + LONGEST_LOOK, t))
        self._now = t

    def waited(self, since: float) -> float:
        """The time from then to the last look, without pauses [s]; negative for times that are to come."""
        paused = (max(0.0, end - max(begin, since)) for begin, end in self._pauses)
        return self._now - since - sum(paused)
