"""Processes that jobs are sent to."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import BrokenExecutor, Executor

from sqrp_cli.scoring.work.workers import _new_process

PATIENCE = 60.0
"""How long anything may take before it counts as hanging [s]."""


def test_sending_much_to_a_process_that_was_killed_does_not_wait_for_ever() -> None:
    executors: list[Executor] = []
    for _ in range(2):  # the second one inherits what is open when it begins
        executors.append(_new_process(executors))
        process = executors[-1].submit(os.getpid).result(PATIENCE)
    first = executors[0].submit(os.getpid).result(PATIENCE)
    assert first != process

    sent = [executors[0].submit(time.sleep, 2 * PATIENCE)]
    sent += [executors[0].submit(len, bytes(1_000_000)) for _ in range(3)]  # more than a pipe holds
    os.kill(first, signal.SIGKILL)

    assert all(isinstance(future.exception(PATIENCE), BrokenExecutor) for future in sent)
    assert executors[1].submit(len, b"more").result(PATIENCE) == 4
    for executor in executors:
        executor.shutdown()
