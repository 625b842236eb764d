"""Worker processes on this machine; results do not depend on their number.

Each worker has its own pipe to this process and shares no queue and no lock: if one is killed, the others go on, its
pipe closes at once, and nothing is left behind. Only this process handles Ctrl-C. All workers end with it, even if it
is killed.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkContext, ForkServerContext, SpawnContext
from types import ModuleType
from typing import Any, Generic, TypeAlias, TypeVar
from weakref import WeakSet

from sqrp_cli.errors import InputError, Problem, bad_input

Context: TypeAlias = ForkContext | ForkServerContext | SpawnContext
Message = TypeVar("Message")
Answer = TypeVar("Answer")
Item = TypeVar("Item")
Result = TypeVar("Result")

PATIENCE = 1.0
"""A process that takes longer than this to end [s] is killed."""

_CAN_FORK = "fork" in multiprocessing.get_all_start_methods()

_pipes: WeakSet[Connection] = WeakSet()
"""Our ends of the pipes to all workers."""


def in_processes(work: Callable[[Item], Result], items: Sequence[Item], processes: int) -> Iterator[Result]:
    """The result of `work` for each item, in order, each as soon as it and those before it are done.

    Processes are forked: they share loaded data, and only results travel. With fewer than two processes, or where the
    platform cannot fork, this process does all the work. Raises what `work` raises, and InputError as `Team.map`.
    """
    if processes < 2 or not _CAN_FORK:
        yield from map(work, items)
        return
    team: Team[int, Result] = Team(processes, forked(), lambda: lambda index: work(items[index]))
    try:
        yield from team.map(range(len(items)))
    finally:
        team.kill()  # nobody needs the results that they may still compute


def forked() -> Context:
    """The start method for processes that share loaded data, or load it again where that is not possible."""
    return multiprocessing.get_context("fork") if _CAN_FORK else multiprocessing.get_context("spawn")


def fresh(needed: Sequence[str]) -> Context:
    """The start method for processes that share no memory with this one.

    Where possible they are forked from a server that has already imported the `needed` modules. The first call in a
    process decides which.
    """
    resource_tracker.ensure_running()  # else it starts with the first process and unblocks Ctrl-C
    try:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([*needed])
        with _without_interrupts():
            forkserver.ensure_running()
    except (ValueError, OSError):  # not on this system, or the path of its temporary folder is too long
        return multiprocessing.get_context("spawn")
    return context


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes started inside the block; in this process it only waits until the end."""
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)


@contextmanager
def _without_main() -> Iterator[None]:
    """Start processes that do not run the caller's script again: they need nothing of it, and it may have no guard."""
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class WorkerDied(BrokenExecutor):
    """A process ended before it answered: it was killed, or crashed."""


@dataclass(frozen=True)
class _Raised:
    """The answer of a process that failed."""

    error: Exception


class Worker(Generic[Message, Answer]):
    """A process that answers messages one after the other."""

    _starts_others = False
    """Whether it may start processes itself."""

    def __init__(
        self, context: Context, prepare: Callable[..., Callable[[Message], Answer]], *arguments: object
    ) -> None:
        """Start it and return at once; the process calls `prepare` with the arguments to get its answer function.

        Raises InputError if the server that forks it has been killed.
        """
        self._pipe, theirs = context.Pipe()
        _pipes.add(self._pipe)
        self._process = context.Process(
            target=_serve, args=(theirs, prepare, arguments), daemon=not self._starts_others
        )
        with _without_interrupts(), _without_main():
            try:
                self._process.start()
            except (EOFError, ConnectionError) as error:
                message = "the process that starts the others was killed; is there enough memory?"
                raise bad_input("worker-died", message) from error
        theirs.close()

    @property
    def pipe(self) -> Connection:
        """Ready to read when it has answered; to wait for it among other things."""
        return self._pipe

    def send(self, message: Message) -> None:
        """Send a message to answer; if the process has died, `receive` raises it.

        Blocks while the process is busy if messages are larger than the pipe's buffer.
        """
        with suppress(OSError):
            self._pipe.send(message)

    def answered(self, within: float = 0.0) -> bool:
        """Whether there is something to receive within a time [s]."""
        return self._pipe.poll(within)

    def receive(self) -> Answer:
        """The answer to the oldest unanswered message; waits for it.

        Raises the process's exception, and WorkerDied if the process has ended.
        """
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise WorkerDied("a process was killed, or crashed") from error
        if isinstance(answer, _Raised):
            raise answer.error
        received: Answer = answer
        return received

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.join()

    def release(self) -> None:
        """Let it end as soon as it is idle."""
        self._pipe.close()

    def close(self) -> None:
        """End it, and wait for the end."""
        self.release()
        self._process.join(PATIENCE)
        if self._process.exitcode is None:
            self.kill()

    @staticmethod
    def first_of(workers: Collection[Worker[Message, Answer]]) -> list[Worker[Message, Answer]]:
        """The workers with an answer to receive; waits until there is one."""
        ready = wait([worker._pipe for worker in workers])
        return [worker for worker in workers if worker._pipe in ready]


class Foreman(Worker[Message, Answer]):
    """A worker with workers of its own, which end with it."""

    _starts_others = True


def _serve(pipe: Connection, prepare: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]) -> None:
    """The main function of a worker: prepare, then answer until the other end of the pipe is closed."""
    for inherited in list(_pipes):  # a reader sees the end of a pipe only when nobody has it open
        inherited.close()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer = _tried(prepare, *arguments)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(answer if isinstance(answer, _Raised) else _tried(answer, pipe.recv()))


def _tried(work: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 # the result or the exception
    try:
        return work(*arguments)
    except Exception as error:
        error.add_note(traceback.format_exc())
        return _Raised(error)


def _end_with_parent() -> None:
    """End this process with its parent; otherwise it would run or wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with suppress(ChildProcessError):
            parent.join()
        os._exit(1)


class Team(Generic[Message, Answer]):
    """Identical workers that share the messages; an answer does not depend on earlier messages."""

    def __init__(
        self, count: int, context: Context, prepare: Callable[..., Callable[[Message], Answer]], *arguments: object
    ) -> None:
        """Start the workers; see `Worker`."""
        self._new: Callable[[], Worker[Message, Answer]] = lambda: Worker(context, prepare, *arguments)
        self._workers = [self._new() for _ in range(count)]

    def map(self, messages: Sequence[Message]) -> Iterator[Answer]:
        """The answer to each message, in order, each as soon as it and those before it are there.

        If a worker dies, its message goes to a new one. Raises a worker's exception, and InputError if two workers die
        of the same message.
        """
        left, answers, lost = deque(range(len(messages))), dict[int, Answer](), set[int]()
        begun = {worker: deque[int]() for worker in self._workers}
        for wanted in range(len(messages)):
            while wanted not in answers:
                self._hand_out(messages, left, begun)
                for worker in Worker.first_of([worker for worker, own in begun.items() if own]):
                    index = begun[worker].popleft()
                    try:
                        answers[index] = worker.receive()
                    except WorkerDied as error:
                        if index in lost:
                            raise InputError(died("what was asked for")) from error
                        lost.add(index)
                        left.extendleft((*reversed(begun.pop(worker)), index))
                        begun[self._replaced(worker)] = deque()
            yield answers.pop(wanted)

    def _hand_out(
        self, messages: Sequence[Message], left: deque[int], begun: dict[Worker[Message, Answer], deque[int]]
    ) -> None:
        """Give every worker a message, and a second one in advance while enough are left."""
        while left:
            worker = min(begun, key=lambda worker: len(begun[worker]))
            if len(begun[worker]) > (len(left) > len(begun)):
                return
            begun[worker].append(left.popleft())
            worker.send(messages[begun[worker][-1]])

    def _replaced(self, worker: Worker[Message, Answer]) -> Worker[Message, Answer]:
        worker.close()
        new = self._workers[self._workers.index(worker)] = self._new()
        return new

    def kill(self) -> None:
        """End them at once."""
        for worker in self._workers:
            worker.kill()

    def close(self) -> None:
        """End them, and wait for the end."""
        for worker in self._workers:
            worker.release()
        for worker in self._workers:
            worker.close()


def died(computed: str) -> Problem:
    """The problem that two processes died computing the same item."""
    return Problem("worker-died", f"the process that computed {computed} died twice; is there enough memory?")


class ProcessExecutor(Generic[Item, Result]):
    """One process that does `work` with each item it is sent, in order; only results travel back.

    If it dies, this item and all later ones fail with WorkerDied.
    """

    def __init__(self, work: Callable[[Item], Result]) -> None:
        self._worker: Worker[Item, Result] = Worker(forked(), _same, work)
        self._thread = ThreadPoolExecutor(1)  # waits for the process

    def submit(self, item: Item) -> Future[Result]:
        """Do the work for an item; its exception becomes the future's."""
        return self._thread.submit(self._ask, item)

    def _ask(self, item: Item) -> Result:
        self._worker.send(item)
        return self._worker.receive()

    def close(self) -> None:
        """End the process at once, whatever it is doing."""
        self._worker.kill()
        self._thread.shutdown(cancel_futures=True)


def _same(work: Callable[[Item], Result]) -> Callable[[Item], Result]:
    return work
