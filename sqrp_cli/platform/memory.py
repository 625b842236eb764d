"""Settings of garbage collection for speed, and giving memory back."""

from __future__ import annotations

import gc
import sys
from contextlib import suppress

_NEW_OBJECTS = 200_000  # number of new lists, dicts and records that triggers a garbage collection


def give_back_memory() -> None:
    """Collect garbage, and return freed memory to the system: for a process that is at rest."""
    import ctypes

    gc.collect()
    with suppress(OSError, AttributeError):  # other C libraries have no such function
        ctypes.CDLL(None).malloc_trim(0)


def collect_seldom() -> None:
    """Collect garbage seldom: to scan what stays again and again takes a tenth of a short command's time."""
    gc.set_threshold(_NEW_OBJECTS)


def collect_no_more() -> None:
    """Leave out the garbage collection at exit, a tenth of a second; not with OMPL, which lists what is left then."""
    if "ompl" not in sys.modules:
        gc.freeze()
