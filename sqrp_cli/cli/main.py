"""The entry point, which imports next to nothing before it heeds Ctrl-C."""

from __future__ import annotations

import io
import os
import stat
import sys
from pathlib import Path
from typing import Any, TextIO

from sqrp_cli.memory import collect_seldom, keep_freed_memory

INTERRUPTED = 130
"""As `ExitCode.INTERRUPTED`, which would take an import."""


def main() -> None:
    """Run a command and leave with its exit code."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command; returns its exit code."""
    try:
        _prepare()
        from sqrp_cli.cli.app import execute

        return execute(arguments)
    except KeyboardInterrupt:
        # A terminal shows `^C` on a line that nobody has ended.
        sys.stderr.write("\ninterrupted\n" if sys.stderr.isatty() else "interrupted\n")
        return INTERRUPTED


def _prepare() -> None:
    # Processes share the cores already; threads of linear algebra would get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    keep_freed_memory()
    collect_seldom()
    sys.stdout, sys.stderr = _writable(sys.stdout), _writable(sys.stderr)
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")


def _writable(stream: TextIO | None) -> TextIO:
    """A stream for output that takes whatever is written, even if it was closed or nobody reads it any more."""
    if stream is None:  # closed, as by `>&-`
        return Path(os.devnull).open("w", encoding="utf-8")
    if isinstance(stream, io.TextIOWrapper):
        if _is_pipe(stream):
            pipe = io.BufferedWriter(_Pipe(stream.fileno(), "w", closefd=False))
            stream = io.TextIOWrapper(pipe, stream.encoding, line_buffering=stream.line_buffering)
        stream.reconfigure(errors="replace")  # whatever a terminal or pipe does not know becomes `?`
    return stream


def _is_pipe(stream: io.TextIOWrapper) -> bool:
    try:
        return stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode)
    except OSError:  # kept in memory
        return False


class _Pipe(io.FileIO):
    """A pipe whose reader may leave early, as `head` does: what is still to be done is done, with its exit code."""

    def write(self, data: Any) -> int:  # noqa: ANN401 - any buffer
        try:
            return super().write(data)
        except BrokenPipeError:
            return memoryview(data).nbytes
