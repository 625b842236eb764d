"""The compiled kernel: found, or built once into a cache of the user."""

from __future__ import annotations

import ctypes
import os
import subprocess
from functools import cache
from hashlib import blake2b
from pathlib import Path

FLAGS = ("-x", "c++", "-O3", "-std=c++17", "-fno-exceptions", "-fno-rtti", "-shared", "-fPIC")


@cache
def load() -> ctypes.CDLL:
    """The kernel of this checkout."""
    here = Path(__file__).parent
    text = b"".join(path.read_bytes() for path in sorted([*here.glob("*.hpp"), *here.glob("*.cpp")]))
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    found = cache_home / "sqrp" / f"sight-{blake2b(text, digest_size=12).hexdigest()}.so"
    if not found.exists():
        found.parent.mkdir(parents=True, exist_ok=True)
        made = found.with_suffix(f".{os.getpid()}")
        compiler = os.environ.get("CXX", "g++").split()
        subprocess.run([*compiler, *FLAGS, "-o", str(made), str(here / "sight.cpp")], check=True)  # noqa: S603
        made.replace(found)
    return ctypes.CDLL(str(found))
