"""The kernel's library: loaded, and first built wherever no library of exactly its present sources is at hand.

A wheel carries the library of its platform in this folder, an editable install builds it here, and a plain checkout in
a folder of the user's cache: the name has a digest of the sources, so that an edit, or another checkout, has its own.
`setup.py` runs this file while nothing is installed, so it imports the standard library only.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from ctypes import CDLL
from functools import cache
from importlib.util import find_spec
from pathlib import Path

SOURCES = Path(__file__).parent  # The folder with the sources, of which `sight.cpp` includes all others

# Products are not fused with sums, so that verdicts are the same on every processor.
FLAGS = (
    *("-std=c++17", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-exceptions", "-fno-rtti"),
    *("-fno-threadsafe-statics", "-fvisibility=hidden", "-fPIC", "-shared"),
)

MOST_KEPT = 20  # Libraries kept in the user's cache, such as those of several checkouts


@cache
def load() -> CDLL:
    """The kernel. Raises InputError where it has to be built and cannot be."""
    name = library_name(sys.platform, os.uname().machine)
    try:
        library = SOURCES / name
        if not library.exists():
            library = _cache() / name
        if not library.exists():
            build(library)
            for old in sorted(library.parent.glob("kernel-*.so"), key=lambda old: old.stat().st_mtime)[:-MOST_KEPT]:
                old.unlink(missing_ok=True)
        return CDLL(str(library))
    except (OSError, RuntimeError) as error:
        from sqrp_cli.errors import bad_input

        mend = f"{sys.executable} -m pip install ziglang (a compiler), or set CXX to a C++ compiler"
        raise bad_input("no-kernel", f"the compiled kernel cannot be made: {error}", mend=mend) from error


def library_name(system: str, machine: str) -> str:
    """The file name of the library of the present sources; system: as `sys.platform`; machine: as `uname -m`."""
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    for source in sorted([*SOURCES.glob("*.hpp"), *SOURCES.glob("*.cpp")]):
        digest.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
    return f"kernel-{digest.hexdigest()[:16]}-{system}-{machine}.so"


def build(library: Path, target: str | None = None) -> None:
    """Compile the kernel into a file, all or nothing.

    The compiler is `$CXX`; otherwise that of the package `ziglang`, if installed; otherwise a `c++` of this machine.
    target: the platform, in Zig's words, if it is not this one; only `ziglang` knows others. Raises RuntimeError with
    the compiler's first error, or OSError.
    """
    chosen, cross = os.environ.get("CXX"), [] if target is None else ["-target", target]
    if chosen and target is None:
        compiler = shlex.split(chosen)
    elif find_spec("ziglang"):
        # For any processor, as in wheels: it would otherwise be for this one, and a home may serve several machines.
        compiler = [sys.executable, "-m", "ziglang", "c++", "-mcpu=baseline", "-nostdlib++", "-s", *cross]
    elif target is None and (found := shutil.which("c++")):
        compiler = [found]
    else:
        raise RuntimeError("no C++ compiler was found")
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=".build-") as folder:
        built = Path(folder, "kernel.so")
        command = [*compiler, *FLAGS, "-o", str(built), str(SOURCES / "sight.cpp")]
        caches = {"ZIG_LOCAL_CACHE_DIR": folder, "ZIG_GLOBAL_CACHE_DIR": str(_cache() / "zig")}
        done = subprocess.run(command, env=os.environ | caches, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode or not built.exists():
            said = (
                [line for line in done.stderr.splitlines() if "error" in line]
                or done.stderr.splitlines()
                or ["it failed"]
            )
            raise RuntimeError(f"`{shlex.join(compiler)}`: {said[0]}")
        built.replace(library)


def _cache() -> Path:
    """A folder that this user alone can write to. Raises OSError where there is none."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - `~` stays without a home
    for folder in (Path(home, "sqrp"), Path(tempfile.gettempdir(), f"sqrp-{os.getuid()}")):
        with suppress(OSError):
            if folder.is_absolute():
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                if folder.stat().st_uid == os.getuid() and os.access(folder, os.W_OK | os.X_OK):
                    return folder
    raise OSError("no folder can be written to; set XDG_CACHE_HOME to one")
