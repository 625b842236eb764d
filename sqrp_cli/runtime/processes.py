"""Starting processes that leave Ctrl-C to the one that started them."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker
from multiprocessing.context import ForkServerContext, SpawnContext

_NEEDED = ("__main__", "cv2", "sqrp_cli.runtime.perception.image_detector", "sqrp_cli.runtime.cell.render_pool")
"""What the processes import. MuJoCo is not among it: what it opens to draw must not be shared."""


def process_context() -> ForkServerContext | SpawnContext:
    """How processes are started that share no memory with this one.

    Where that is possible they come from one that has imported what they need, so that this is not done for each.
    """
    try:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(list(_NEEDED))
        with without_interrupts():
            forkserver.ensure_running()
    except (ValueError, OSError):  # not on this system, or its folder for temporary files has too long a name for it
        return multiprocessing.get_context("spawn")
    return context


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Let processes that are started meanwhile inherit that Ctrl-C is blocked; here it only waits until afterwards."""
    resource_tracker.ensure_running()  # which would else be started with the first process, and unblock Ctrl-C again
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
