"""What happens to the memory of arrays that are freed."""

from __future__ import annotations

import numpy as np

_KEPT = 24 << 20
"""Bytes of an array up to which glibc then keeps its memory; it heeds up to 32 MiB."""


def keep_freed_memory() -> None:
    """Have the C library keep the memory of freed arrays for the next ones.

    Otherwise each array of more than a few pages is new memory, which the system clears page by page as it is used.
    glibc takes as large what is larger than the largest array freed so far; this one is never used, and costs nothing.
    Elsewhere this does nothing.
    """
    np.empty(_KEPT, dtype=np.uint8)
