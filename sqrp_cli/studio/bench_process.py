"""The process that computes, seen from the one that asks: it imports nothing of what that takes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from sqrp_cli.platform.processes import Foreman, forked
from sqrp_cli.studio.questions import Question


class Bench:
    """The process that computes. It loads what that takes at once, while this one does other things."""

    def __init__(self, path: Path, seed: int, jobs: int) -> None:
        """path: of the workspace, as it was given."""
        self.pipe, theirs = multiprocessing.Pipe()
        """Answers are texts for browsers."""
        self._process: Foreman[None, None] = Foreman(forked(), _serve, theirs, self.pipe, path, seed, jobs)
        theirs.close()

    def ask(self, question: Question) -> None:
        """Ask; a later question may supersede an earlier one."""
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
