"""The process that computes, seen from the one that asks: it imports nothing of what that takes."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from sqrp_cli.platform.processes import Worker, forked
from sqrp_cli.studio.requests import Question


class Bench:
    """The process that computes. It loads what that takes at once, while this one does other things."""

    def __init__(self, path: Path, seed: int, jobs: int) -> None:
        """path: of the workspace, as it was given."""
        self.pipe, theirs = multiprocessing.Pipe()
        """Answers are texts for browsers."""
        arguments = (theirs, self.pipe, path, seed, jobs)
        self._process: Worker[None, None] = Worker(forked(), _serve, *arguments, starts_others=True)
        theirs.close()
        self._waiting: dict[object, Question] = {}
        self._some_wait = threading.Condition()
        threading.Thread(target=self._send, daemon=True).start()

    def ask(self, question: Question) -> None:
        """Ask without waiting; a later question of the same kind supersedes one that still waits."""
        kind = type(question), getattr(question, "of_saved", False)
        with self._some_wait:
            self._waiting.pop(kind, None)
            self._waiting[kind] = question
            self._some_wait.notify()

    def _send(self) -> None:
        """Send what waits, in a thread: a long text waits until the process reads, which may be answering itself."""
        with suppress(OSError, TypeError):  # closed, or the process was killed: who reads the answers notices
            while True:
                with self._some_wait:
                    self._some_wait.wait_for(lambda: self._waiting)
                    question = self._waiting.pop(next(iter(self._waiting)))
                self.pipe.send(question)

    def close(self) -> None:
        """End the process."""
        self.pipe.close()
        self._process.close()


def _serve(theirs: Connection, ours: Connection, path: Path, seed: int, jobs: int) -> Callable[[None], None]:
    """Compute until the other end of the pipe is closed."""
    ours.close()
    from sqrp_cli.studio.bench import serve

    serve(theirs, path, seed, jobs)
    return lambda _: None
