"""The entry point; it imports next to nothing before it handles Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

from sqrp_cli.cli.streams import ResultsLost, prepare_streams
from sqrp_cli.platform.interrupts import heed_signals
from sqrp_cli.platform.memory import collect_no_more, collect_seldom

BAD_INPUT = 2
INTERRUPTED = 130  # as in `ExitCode`, which would take an import


def main() -> None:
    """Run a command and leave with its exit code."""
    code = run(sys.argv[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # one Ctrl-C more would kill it, with another exit code
    collect_no_more()
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Run a command; returns its exit code once all its output is written."""
    try:
        # Where byte code may not be written beside the sources and is not there, each command would compile them again.
        cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - `~` stays without a home
        missing = sys.dont_write_bytecode and sys.pycache_prefix is None and not os.path.exists(__spec__.cached or "")  # noqa: PTH110
        if missing and os.path.isabs(cache):  # noqa: PTH117 - `pathlib` would take a while
            sys.pycache_prefix, sys.dont_write_bytecode = os.path.join(cache, "sqrp", "bytecode"), False  # noqa: PTH118
        # Processes share the cores already; threads of linear algebra would get in each other's way.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # What other packages plug into it has no say here, and a look for them takes a while.
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        heed_signals()
        collect_seldom()
        prepare_streams()
        from sqrp_cli.cli.app import execute

        code = execute(arguments)
        sys.stdout.flush()
        return code
    except ResultsLost as lost:
        sys.stderr.write(f"error: the output cannot be written: {lost}\n")
        return BAD_INPUT
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # one more is no news
        # A terminal shows `^C` on a line that is not ended yet.
        sys.stderr.write("\ninterrupted\n" if sys.stderr.isatty() else "interrupted\n")
        with suppress(ResultsLost):
            sys.stdout.flush()
        return INTERRUPTED
