"""Commands in processes of their own, forked from this one, which has imported what they need."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import resource
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import FrameType, ModuleType
from typing import NoReturn

from sqrp_cli.platform.simulator import check_simulator

LONGEST, MOST = 10.0, 1000.0
"""Processor time [s] and memory [MB] that a command may take."""
_WAIT, _MEMORY = 120, 3 << 30
"""When a command is killed [s], and its address space [bytes]: more than it may take, less than there is."""

_SOURCES = (
    "sqrp_cli", "cv2", "distributed", "mujoco", "coal", "pinocchio", "ompl", "eaik", "embreex", "PIL", "ruamel",
    "fast_simplification", "rich", "yaml", "pydantic", "numpy", "ruckig", "rosbags", "apsw", "backports", "pyarrow",
)  # fmt: skip

_modules: list[str] = []


@dataclass(frozen=True)
class Done:
    """What became of a command.

    code: negative for the signal that ended it. said: all of stderr. seconds: of processor time [s]. memory: at most
    [MB], with all that the parent has imported.
    """

    code: int
    out: str
    said: str
    seconds: float
    memory: float


def call(command: Sequence[str]) -> Done:
    """Run a command of `sqrp` in a process of its own, with limits of time and memory."""
    _import_more()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, tempfile.TemporaryFile() as modules:
        sys.stdout.flush()
        sys.stderr.flush()
        child = os.fork()
        if child == 0:
            _be(command, out.fileno(), err.fileno(), modules.fileno())
        with _killing(child):
            _, status, usage = os.wait4(child, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what it started and left behind
        modules.seek(0)
        _modules.extend(modules.read().decode().split())
        said, printed = _text_of(err.fileno()), _text_of(out.fileno())
    seconds = usage.ru_utime + usage.ru_stime
    return Done(os.waitstatus_to_exitcode(status), printed, said, seconds, usage.ru_maxrss / 1e3)


def _import_more() -> None:
    """Import what commands so far had to: those to come find it imported, as it is in memory anyway."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    check_simulator()  # it says which OpenGL MuJoCo draws with, which is read when that is imported
    for name in (name for name in _modules if name not in sys.modules):
        with contextlib.suppress(Exception), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            importlib.import_module(name)
    if _modules:
        gc.collect()
        gc.freeze()
    _modules.clear()


def _text_of(descriptor: int) -> str:
    size = min(os.fstat(descriptor).st_size, 2_000_000)
    return os.pread(descriptor, size, 0).decode(errors="replace")


@contextlib.contextmanager
def _killing(child: int) -> Iterator[None]:
    """Kill a process, and those that it started, if it is still there after `_WAIT` seconds."""

    def kill(_signal: int, _frame: FrameType | None) -> None:
        os.killpg(child, signal.SIGKILL)

    previous = signal.signal(signal.SIGALRM, kill)
    signal.alarm(_WAIT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def _be(command: Sequence[str], out: int, err: int, modules: int) -> NoReturn:
    """Be the command, from here to the end of this process."""
    code = 70
    try:
        os.setsid()
        signal.alarm(0)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (int(4 * LONGEST), int(4 * LONGEST)))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for target, source in ((0, os.open(os.devnull, os.O_RDONLY)), (1, out), (2, err)):
            os.dup2(source, target)
        streams = ((0, "r"), (1, "w"), (2, "w"))
        sys.stdin, sys.stdout, sys.stderr = (os.fdopen(number, mode, closefd=False) for number, mode in streams)
        os.environ |= {"COLUMNS": "80", "NO_COLOR": "1"}
        sys.modules["__main__"] = ModuleType("__main__")  # so that processes which the command starts import no test
        warnings.resetwarnings()
        warnings.simplefilter("always")
        before = set(sys.modules)
        from sqrp_cli.cli.main import run

        code = run(list(command))
        sys.stdout.flush()
        sys.stderr.flush()
        found = [name for name in sys.modules if name not in before and name.split(".")[0] in _SOURCES]
        os.write(modules, "\n".join(found).encode())
    finally:
        os._exit(code)
