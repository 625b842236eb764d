"""Other processes of this machine that work for this one, and with the same results however many they are.

Each has a pipe of its own to this process, and shares no queue and no lock with others: one that is killed takes
nothing from them, shows at once as the end of its pipe, and leaves nothing behind. Ctrl-C is for this process alone.
All of them end with it, even where it is killed.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
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
from typing import Any, Generic, TypeAlias, TypeVar
from weakref import WeakSet

from sqrp_cli.errors import InputError, Problem

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
    """What `work` makes of each item, in order, each as soon as it and those before it are done.

    Processes are forked, so that they share what is loaded, and only results travel; with less than two processes, or
    where the platform cannot fork, this one does all. Raises what `work` raises, and InputError as `Team.map`.
    """
    if processes < 2 or not _CAN_FORK:
        yield from map(work, items)
        return
    team: Team[int, Result] = Team(processes, forked(), lambda: lambda index: work(items[index]))
    try:
        yield from team.map(range(len(items)))
    finally:
        team.kill()  # nobody asks any more for what they may still be doing


def forked() -> Context:
    """How processes are started that share what is loaded; where that is not possible, they load it again."""
    return multiprocessing.get_context("fork") if _CAN_FORK else multiprocessing.get_context("spawn")


def fresh(needed: Sequence[str]) -> Context:
    """How processes are started that share no memory with this one.

    Where that is possible they come from one that has imported the modules that they need, so that this is not done for
    each. The first call in a process decides which these are.
    """
    resource_tracker.ensure_running()  # which would else be started with the first process, and unblock Ctrl-C again
    try:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["__main__", *needed])
        with _without_interrupts():
            forkserver.ensure_running()
    except (ValueError, OSError):  # not on this system, or its folder for temporary files has too long a name for it
        return multiprocessing.get_context("spawn")
    return context


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let processes that are started meanwhile inherit that Ctrl-C is blocked; here it only waits until afterwards."""
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)


class WorkerDied(BrokenExecutor):
    """A process ended before it answered: it was killed, or crashed."""


@dataclass(frozen=True)
class _Raised:
    """The answer of a process that failed."""

    error: Exception


class Worker(Generic[Message, Answer]):
    """A process that answers messages one after the other."""

    def __init__(
        self, context: Context, prepare: Callable[..., Callable[[Message], Answer]], *arguments: object
    ) -> None:
        """Start it, and go on while it gets ready: it calls `prepare` with the arguments for what is to answer."""
        self._pipe, theirs = context.Pipe()
        _pipes.add(self._pipe)
        self._process = context.Process(target=_serve, args=(theirs, prepare, arguments), daemon=True)
        with _without_interrupts():
            self._process.start()
        theirs.close()

    def send(self, message: Message) -> None:
        """Let it answer a message; that it died shows when the answer is received.

        Waits while the process is busy, where messages are larger than what a pipe holds.
        """
        with suppress(OSError):
            self._pipe.send(message)

    def answered(self, within: float = 0.0) -> bool:
        """Whether there is something to receive within a time [s]."""
        return self._pipe.poll(within)

    def receive(self) -> Answer:
        """The answer to the oldest message that has none yet; waits for it.

        Raises what went wrong in the process, and WorkerDied where it will not answer any more.
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
        """Let it end as soon as it has nothing to do."""
        self._pipe.close()

    def close(self) -> None:
        """End it, and wait until it has."""
        self.release()
        self._process.join(PATIENCE)
        if self._process.exitcode is None:
            self.kill()

    @staticmethod
    def first_of(workers: Collection[Worker[Message, Answer]]) -> list[Worker[Message, Answer]]:
        """Those that have something to receive; waits until there is one."""
        ready = wait([worker._pipe for worker in workers])
        return [worker for worker in workers if worker._pipe in ready]


def _serve(pipe: Connection, prepare: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]) -> None:
    """What a process does: get ready, and answer until the other end of its pipe is closed."""
    for inherited in list(_pipes):  # as long as somebody has one open, its reader does not see the end of it
        inherited.close()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer = _tried(prepare, *arguments)
    with suppress(EOFError, ConnectionError):
        while True:
            message = pipe.recv()
            pipe.send(answer if isinstance(answer, _Raised) else _tried(answer, message))


def _tried(work: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 # what it results in, or what it raised
    try:
        return work(*arguments)
    except Exception as error:
        error.add_note(traceback.format_exc())
        return _Raised(error)


def _end_with_parent() -> None:
    """Whoever works for a process that was killed would otherwise go on, or wait for work, for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with suppress(ChildProcessError):
            parent.join()
        os._exit(1)


class Team(Generic[Message, Answer]):
    """Workers that all answer alike, whatever they were sent before, and share the messages."""

    def __init__(
        self, count: int, context: Context, prepare: Callable[..., Callable[[Message], Answer]], *arguments: object
    ) -> None:
        """Start so many; see `Worker`."""
        self._new: Callable[[], Worker[Message, Answer]] = lambda: Worker(context, prepare, *arguments)
        self._workers = [self._new() for _ in range(count)]

    def map(self, messages: Sequence[Message]) -> Iterator[Answer]:
        """The answer to each message, in order, each as soon as it and those before it are there.

        A message whose worker died is sent to a new one. Raises what went wrong in a worker, and InputError where two
        died of the same message.
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
        """Give every worker something to do, and while there is enough left something to go on with."""
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
        """End them, and wait until they have."""
        for worker in self._workers:
            worker.release()
        for worker in self._workers:
            worker.close()


def died(computed: str) -> Problem:
    """The problem of processes that died as often as something was computed."""
    message = f"the process that computed {computed} died twice; is there enough memory?"
    return Problem("worker-died", message)


class ProcessExecutor(Generic[Item, Result]):
    """One process that does the same with whatever it is sent, in order; only results travel back.

    Where it died, this and all that it still had to do fails with WorkerDied.
    """

    def __init__(self, work: Callable[[Item], Result]) -> None:
        self._worker: Worker[Item, Result] = Worker(forked(), _same, work)
        self._thread = ThreadPoolExecutor(1)  # which waits for it

    def submit(self, item: Item) -> Future[Result]:
        """Have something done; an exception of the work is that of the future."""
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
