"""Pauses of this process, such as of a busy computer: they keep messages from coming, which then are not missing."""

from __future__ import annotations

LONGEST_LOOK = 0.03
"""Of the time between two looks for messages so much counts [s]; the rest is a pause."""


class Pauses:
    """How long one has really waited for something, on any clock [s].

    Only what was sent in the last pause may not have been received yet, so that who pauses again and again still
    notices what stays out.
    """

    def __init__(self) -> None:
        self._now = self._begin = self._end = 0.0

    def look(self, t: float) -> None:
        """It is looked for messages at time t [s]."""
        if t > self._now + LONGEST_LOOK:
            self._begin, self._end = self._now + LONGEST_LOOK, t
        self._now = t

    def waited(self, since: float) -> float:
        """The time from then to the last look, without the last pause [s]; negative for times that are to come."""
        return self._now - since - max(0.0, self._end - max(self._begin, since))
