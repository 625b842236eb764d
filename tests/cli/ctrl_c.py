"""Ctrl-C in the middle of a command."""

from __future__ import annotations

import signal


def press_ctrl_c(*_: object, **__: object) -> None:
    """In place of a step of a command; for tests with `heeded_ctrl_c`."""
    signal.raise_signal(signal.SIGINT)
