"""That the memory of freed arrays is kept, counted by the pages that the system had to provide."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

ARRAYS, PAGES = 20, 512
"""Arrays that are made and freed one after the other, and pages of each."""

PROBE = """
import resource, sys
import numpy as np
from sqrp_cli.platform.memory import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(int(sys.argv[2])):
    # Two at once: the C library by itself keeps one.
    [np.ones(int(sys.argv[3]) * resource.getpagesize() // 8) for _ in range(2)]
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def pages_provided(how: str) -> int:
    command = [sys.executable, "-c", PROBE, how, str(ARRAYS), str(PAGES)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have their own ways")
def test_the_memory_of_freed_arrays_is_used_again():
    assert pages_provided("kept") < 3 * PAGES
    assert pages_provided("as it is") > ARRAYS * PAGES
