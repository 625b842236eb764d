"""A plugin of pytest: the kernel with sanitizers takes the place of the usual one; see `test_sanitizers.py`."""

import os
from ctypes import CDLL
from functools import cache

from sqrp_cli.kernel import library

library.load = cache(lambda: CDLL(os.environ["SANITIZED_KERNEL"]))
