"""How a command is ended from outside: Ctrl-C, also where foreign code would swallow it, and SIGTERM."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

pressed: list[int] = []
"""Whether Ctrl-C was pressed: the signal, each time. An exception that follows may be what a library made of it."""


def heed_signals() -> None:
    """Let `pressed` know of every Ctrl-C from now on, and tidy up before SIGTERM ends this process.

    Ctrl-C still raises KeyboardInterrupt; SIGTERM raises SystemExit, so that files that are not finished are removed.
    """

    def interrupt(number: int, _: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    pressed.clear()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))


@contextmanager
def interrupts_later(*, second_raises: bool = False) -> Iterator[Callable[[], bool]]:
    """Delay a Ctrl-C until the end of the block; yields whether it came, so that work may be ended in order.

    For imports of libraries that catch every exception, KeyboardInterrupt too, as a missing module or raise another one
    instead: the program would ignore the Ctrl-C or report a wrong error. second_raises: a second one is not delayed.
    """
    before, came = signal.getsignal(signal.SIGINT), list[int]()
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def note(number: int, frame: FrameType | None) -> None:
        if came and second_raises:
            before(number, frame)
        came.append(number)

    signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(came)
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)
