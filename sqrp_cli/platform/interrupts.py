"""Ctrl-C where somebody else's code would lose it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Let a Ctrl-C that comes meanwhile wait until afterwards.

    For imports of libraries that take any exception for a missing module or make another one of it, KeyboardInterrupt
    too: the program would go on as if nothing had been asked of it, or report an error that there is not.
    """
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)
