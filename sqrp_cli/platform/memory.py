"""Settings of memory and garbage collection for speed."""

from __future__ import annotations

import contextlib
import gc
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # numbers of mallopt(3)

_NEW_OBJECTS, _FIRST_OBJECTS = 20_000, 200_000
"""Number of new lists, dicts and records that triggers a garbage collection; the second while a command starts."""

_LARGEST_KEPT, _KEPT = 32 * 1024 * 1024, 256 * 1024 * 1024
"""Arrays up to this size (the largest that mallopt takes) use the heap, which keeps as much free memory [bytes]."""


def keep_freed_memory() -> None:
    """Keep the freed memory of arrays in this process, for the next arrays.

    By default the C library returns the memory of large arrays at once, and every new one costs a system call and a
    page fault per page: a tenth of the time of a candidate, and twice that in workers of Dask (MALLOC_TRIM_THRESHOLD_).
    Without effect if the C library has no such setting.
    """
    import ctypes

    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)


def give_back_memory() -> None:
    """Collect garbage, and return freed memory to the system: for a process that is at rest."""
    import ctypes

    gc.collect()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def collect_later() -> None:
    """Run no garbage collection while modules are imported and files are read, until `keep_all_so_far`.

    Scanning what stays again and again takes a third of the time of a short command.
    """
    gc.set_threshold(_FIRST_OBJECTS)


def keep_all_so_far() -> None:
    """Exclude all present objects from garbage collection, the first time in a process, and collect new ones seldom."""
    if gc.get_freeze_count() == 0:  # later, what is no longer used would be kept, too
        gc.freeze()
    collect_seldom()


def collect_seldom() -> None:
    """Run Python's garbage collection less often."""
    gc.set_threshold(_NEW_OBJECTS)


def collect_no_more() -> None:
    """Exclude all objects from the garbage collection at exit, which would take a tenth of a second.

    Not where OMPL was loaded: it lists on stderr whatever of it is left at exit.
    """
    if "ompl" not in sys.modules:
        gc.freeze()
