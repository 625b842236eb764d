"""Tells whoever listens what happens in a run, and keeps account of where the wall time goes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from sqrp_cli.runtime.record.events import Event, Listener, PrimitiveBegan


class EventPublisher:
    """doing: what the robot does now, in a word. wall: seconds of wall time by what they were spent on."""

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self._listeners = tuple(listeners)
        self._began = time.perf_counter()
        self.doing = "looks"
        self.wall: dict[str, float] = {}

    def publish(self, event: Event) -> None:
        """Tell an event, at its time on the cell's clock to the microsecond."""
        event = event.model_copy(update={"t": round(event.t, 6)})
        for listener in self._listeners:
            listener(event)

    def begin(self, t: float, primitive: str) -> None:
        """Tell that a primitive action begins."""
        self.doing = primitive
        self.publish(PrimitiveBegan(t=t, name=primitive))

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Add the time that passes to what it is spent on."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.wall[what] = self.wall.get(what, 0.0) + time.perf_counter() - began

    def elapsed(self) -> float:
        """Wall time since the beginning [s]."""
        return time.perf_counter() - self._began


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
