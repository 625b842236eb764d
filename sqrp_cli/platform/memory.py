"""What this process does with memory that is no longer needed."""

from __future__ import annotations

import contextlib
import gc

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Numbers of mallopt(3)."""

_NEW_OBJECTS = 20_000
"""So many lists, dicts and records are made before those among them that only refer to each other are looked for."""

_LARGEST_KEPT, _KEPT = 32 * 1024 * 1024, 256 * 1024 * 1024
"""Arrays up to this size (the largest that mallopt takes) come from memory of which so much is kept [bytes]."""


def keep_freed_memory() -> None:
    """Let this process keep the memory that arrays use for the next ones.

    The C library would return the memory of large arrays at once, and every new one would then cost a system call and a
    page fault for each of its pages: a tenth of the time of a candidate. Dask tells its workers to return all memory
    (MALLOC_TRIM_THRESHOLD_), which even doubles it. Where the C library has no such setting, nothing is done.
    """
    import ctypes

    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)


def collect_seldom() -> None:
    """Let Python look less often for objects that only refer to each other.

    What is read and imported stays, and going through all of it again and again takes a tenth of that time.
    """
    gc.set_threshold(_NEW_OBJECTS)


def keep_all_so_far() -> None:
    """Never look through what there is now again, not even at the end.

    For what was read, and stays: that look takes a tenth of the time of a short command.
    """
    gc.freeze()
