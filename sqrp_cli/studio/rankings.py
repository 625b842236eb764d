"""What the process that computes is asked for a session, and which of its answers still count."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from sqrp_cli.errors import bad_input
from sqrp_cli.platform.memory import give_back_memory
from sqrp_cli.platform.processes import Worker, forked
from sqrp_cli.records import dataclass
from sqrp_cli.studio.messages import Asked, Question, kind_of
from sqrp_cli.studio.moves import Move
from sqrp_cli.studio.server import Connections


class WorkerProcess:
    """The process that computes. It loads what that takes at once, while this one does other things."""

    def __init__(self, path: Path, seed: int, jobs: int) -> None:
        """path: of the workspace, as it was given."""
        self.pipe, theirs = multiprocessing.Pipe()  # answers are texts for browsers
        arguments = (theirs, self.pipe, path, seed, jobs)
        self._process: Worker[None, None] = Worker(forked(), _serve, *arguments, starts_others=True)
        theirs.close()
        self._waiting: dict[object, Question] = {}
        self._some_wait = threading.Condition()
        threading.Thread(target=self._send, daemon=True).start()

    def ask(self, question: Question) -> None:
        """Ask without waiting; a later question of the same word supersedes one that still waits."""
        with self._some_wait:
            self._waiting.pop(question[0], None)
            self._waiting[question[0]] = question
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
    from sqrp_cli.studio.worker import serve

    serve(theirs, path, seed, jobs)
    return lambda _: None


@dataclass(eq=False)
class Rankings:
    """The ranking of the text, beside that of the saved file."""

    worker: WorkerProcess
    connections: Connections
    saved: Callable[[], Asked]  # what the saved file is ranked for
    named: Callable[[Sequence[str]], None]  # called with the names of the candidates of a new ranking
    number: int = 0  # of the last question
    held: bool = False
    """Whether a hand has moved something since the last ranking was asked for; that ranking is given up then."""
    _asked: Asked | None = None
    _ranked: Asked | None = None  # what the ranking that is shown is of; None while another one is under way
    _of_saved: Asked | None = None  # what the figures of the saved file are for
    _comparing: Asked | None = None  # what of the saved file is being ranked
    _over: asyncio.Future[None] | None = None  # done once the process was killed

    def listen(self) -> asyncio.Future[None]:
        """Hear answers from now on, in the loop that is running; the future fails once the process is killed."""
        loop = asyncio.get_running_loop()
        self._over = loop.create_future()
        loop.add_reader(self.worker.pipe.fileno(), self._answered)
        return self._over

    def rank(self, asked: Asked) -> None:
        """Rank a task in the cell of a text."""
        self.number += 1
        self.held, self._comparing = False, None
        self._asked, self._ranked = asked, None
        self.worker.ask(("rank", asked, self.number))

    def hold(self, move: Move, number: int) -> None:
        """Sketch what a hand moves; the sketch carries the number."""
        self.held, self._comparing = True, None
        self.worker.ask(("hold", move, number))

    def take_as_saved(self) -> None:
        """Take the ranking that is shown as that of the saved file too, if it is."""
        if self._ranked == self.saved():
            self._of_saved, self._comparing = self._ranked, None
            text = self.connections.kept["ranking"].replace('"ranking"', '"saved-ranking"', 1)
            self.connections.post("saved-ranking", text)

    def _answered(self) -> None:
        try:
            text = self.worker.pipe.recv()
        except (EOFError, OSError):
            asyncio.get_running_loop().remove_reader(self.worker.pipe.fileno())
            message = "the process that computes was killed; is there enough memory?"
            assert self._over is not None  # noqa: S101 - it listens
            self._over.set_exception(bad_input("worker-died", message))
            return
        do = kind_of(text)
        if do in ("sketch", "held", "progress"):
            self.connections.tell(text, passing=do == "progress")
            return
        answer = json.loads(text)
        if answer.get("number", self.number) not in (None, self.number):
            return  # of an earlier question
        if do == "saved-ranking" and self._comparing != self.saved():
            return  # of a file that was saved again meanwhile
        before = self.connections.kept.get("cell")
        self.connections.post(do, text)
        if do == "cell" and before is not None and answer["model"] is None:
            # A new browser is told the shapes too, which the others have already.
            self.connections.kept["cell"] = json.dumps({**answer, "model": json.loads(before)["model"]})
        if do == "ranking":
            self._ranked = self._asked
            self.connections.forget("problems")
            self.named([entry["name"] for entry in answer["entries"]])
            self.take_as_saved()
        elif do == "saved-ranking":
            self._of_saved = self._comparing
        elif do == "detail" and self._ranked is not None and not self.held:
            # There is nothing else to do: rank the saved file as well, if that is not known. Otherwise what is shown
            # over time is of before, and this would end what was asked for since.
            give_back_memory()
            saved = self.saved()
            if saved not in (self._asked, self._of_saved, self._comparing):
                self._comparing = saved
                self.worker.ask(("compare", saved, self.number))
