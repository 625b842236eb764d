"""The entry point, which imports next to nothing before it heeds Ctrl-C."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path

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
    # A stream that was closed, as by `>&-`, is None here; nobody wants what goes there.
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - until the end
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # whatever a terminal or pipe does not know becomes `?`
