"""Starting processes that leave Ctrl-C to the one that started them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Let processes that are started meanwhile inherit that Ctrl-C is blocked; here it only waits until afterwards."""
    resource_tracker.ensure_running()  # which would else be started with the first process, and unblock Ctrl-C again
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
