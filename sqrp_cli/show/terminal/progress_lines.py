"""Progress where no bar can be shown, as in the log of a CI server: a line now and then about a step that is long."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import IntEnum
from math import ceil

Advance = Callable[..., None]  # Called when parts of the work are done, with how many, or with nothing for one
PERIOD = 10.0  # least time before the first line and between two [s]
SLOWER = 0.2  # least time between two lines, as a share of what has passed: a step of hours has tens of lines
lines_wanted: ContextVar[bool] = ContextVar("lines_wanted", default=True)  # not beside a document


class Verbosity(IntEnum):
    """What is said on stderr besides errors."""

    QUIET = 0  # nothing: no warnings, notes or progress
    NORMAL = 1  # warnings, notes, and progress that vanishes
    VERBOSE = 2  # how long each step took, too


verbosity: ContextVar[Verbosity] = ContextVar("verbosity", default=Verbosity.NORMAL)  # as asked by `-q` and `-v`


@contextmanager
def progress_lines(title: str, total: int | None, write: Callable[[str], None]) -> Iterator[Advance]:
    """Write a line about a long step now and then; yields what counts parts that are done. total: None if unknown."""
    done, ended = 0, threading.Event()
    began = latest = time.monotonic()

    def advance(count: int = 1) -> None:
        nonlocal done, latest
        done, latest = done + count, time.monotonic()

    def tell() -> None:
        pause = PERIOD
        while not ended.wait(min(pause, threading.TIMEOUT_MAX)):
            now = time.monotonic()
            passed = now - began
            parts = f" {done} of {total}" if total else ""
            left = passed * (total - done) / done if total and 0 < done < total else 0.0
            # Parts that take longer than all before them tell nothing of the time that is left.
            said = f", about {ceil(left)} s left" if left > now - latest else ""
            try:
                write(f"{title}:{parts} after {passed:.0f} s{said}")
            except (OSError, ValueError):  # nobody reads any more
                return
            pause = max(PERIOD, SLOWER * passed)

    if not lines_wanted.get():
        yield advance
        return
    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    try:
        yield advance
    finally:
        ended.set()
        thread.join()
