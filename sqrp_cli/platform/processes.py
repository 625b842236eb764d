"""The one pool of worker processes on this machine; results do not depend on their number.

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
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from math import inf
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkContext, ForkServerContext, SpawnContext
from types import ModuleType
from typing import Any, Generic, TypeAlias, TypeVar
from weakref import WeakSet

from sqrp_cli.errors import InputError, Problem, SqrpError, bad_input

Context: TypeAlias = ForkContext | ForkServerContext | SpawnContext
Message = TypeVar("Message")
Answer = TypeVar("Answer")
Item = TypeVar("Item")
Result = TypeVar("Result")
Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Shows how far work is: takes a title and the number of parts; what it yields counts those that are done."""
PATIENCE = 1.0  # a process that takes longer than this to end [s] is killed
MOST_PER_CORE = 8  # more workers gain nothing, and a slip of the hand in `--jobs` would take all memory
_CAN_FORK = "fork" in multiprocessing.get_all_start_methods()
_pipes: WeakSet[Connection] = WeakSet()  # our ends of the pipes to all workers


def in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], processes: int, deadline: float = inf
) -> Iterator[Result]:
    """The result of `work` for each item, in order, each as soon as it and those before it are done.

    processes: so many at most, and no more than items. They are forked: they share loaded data, and only results
    travel. With fewer than two, or where the platform cannot fork, this process does all the work. Raises what `work`
    raises, and InputError as `Pool.map`.
    """
    processes = min(processes, len(items))
    if processes < 2 or not _CAN_FORK:
        yield from map(work, items)
        return
    pool: Pool[int, Result] = Pool(processes, forked(), lambda: lambda index: work(items[index]), deadline=deadline)
    try:
        yield from pool.map(range(len(items)))
    finally:
        pool.close(at_once=True)  # nobody needs the results that they may still compute


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


class WorkerDied(SqrpError):  # noqa: N818 - what happened, not what is wrong
    """A process ended before it answered, or took too long to answer."""


class Worker(Generic[Message, Answer]):
    """A process that answers messages one after the other."""

    def __init__(
        self,
        context: Context,
        prepare: Callable[..., Callable[[Message], Answer]],
        *arguments: object,
        starts_others: bool = False,
    ) -> None:
        """Start it and return at once; the process calls `prepare` with the arguments to get its answer function.

        starts_others: whether it may start processes itself, which end with it. Raises InputError if the server that
        forks it has been killed.
        """
        self.pipe, theirs = context.Pipe()
        """Ready to read when it has answered; to wait for it among other things."""
        # For a `Pool`: numbers of unanswered messages, when it began with the first [s], and the last one's kind.
        self.own, self.since = deque[int](), 0.0
        self.kind: object = None
        _pipes.add(self.pipe)
        self._process = context.Process(target=_serve, args=(theirs, prepare, arguments), daemon=not starts_others)
        # It does not run the caller's script again: it needs nothing of that, and the script may have no guard.
        main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        try:
            with _without_interrupts():
                self._process.start()
        except (EOFError, ConnectionError) as error:
            message = "the process that starts the others was killed; is there enough memory?"
            raise bad_input("worker-died", message) from error
        finally:
            sys.modules["__main__"] = main
        theirs.close()

    def send(self, message: Message) -> None:
        """Send a message to answer; blocks while the process is busy with others that fill the pipe's buffer."""
        with suppress(OSError):
            self.pipe.send(message)

    def receive(self, deadline: float = inf) -> Answer:
        """The answer to the oldest unanswered message; waits for it, at most for a time [s].

        Raises the process's exception, and WorkerDied if the process has ended; after the deadline it is killed.
        """
        if deadline < inf and not self.pipe.poll(deadline):
            self.kill()
            raise WorkerDied("does not answer")
        try:
            answer, raised = self.pipe.recv()
        except (EOFError, OSError) as error:
            raise WorkerDied("has ended") from error
        if raised is not None:
            raise raised
        received: Answer = answer
        return received

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Let it end as soon as it is idle, and wait a little for that."""
        self.pipe.close()
        self._process.join(PATIENCE)
        if self._process.exitcode is None:
            self.kill()


def _serve(pipe: Connection, prepare: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]) -> None:
    """The main function of a worker: prepare, then answer until the other end of the pipe is closed."""

    def end_with_parent() -> None:  # otherwise it would run or wait for work for ever
        parent = multiprocessing.parent_process()
        if parent is not None:
            with suppress(ChildProcessError):
                parent.join()
            os._exit(1)

    for inherited in list(_pipes):  # a reader sees the end of a pipe only when nobody has it open
        inherited.close()
    threading.Thread(target=end_with_parent, daemon=True).start()

    def tried(work: Callable[..., Any], *given: object) -> tuple[Any, Exception | None]:
        try:
            return work(*given), None
        except Exception as error:
            error.add_note(traceback.format_exc())
            return None, error

    answer, failed = tried(prepare, *arguments)
    with suppress(EOFError, OSError):
        while True:
            pipe.send((None, failed) if failed else tried(answer, pipe.recv()))


class Pool(Generic[Message, Answer]):
    """Identical workers that share the messages; an answer does not depend on earlier messages."""

    def __init__(
        self,
        count: int,
        context: Context,
        prepare: Callable[..., Callable[[Message], Answer]],
        *arguments: object,
        deadline: float = inf,
        ahead: int = 1,
    ) -> None:
        """Start the workers, at most `MOST_PER_CORE`; see `Worker`.

        deadline: of each message; who takes longer is killed [s].
        ahead: how many messages a worker gets in advance, while enough are left: none where they are large.
        """
        self._new: Callable[[], Worker[Message, Answer]] = lambda: Worker(context, prepare, *arguments)
        self._deadline, self._ahead = deadline, ahead
        self._workers = [self._new() for _ in range(min(count, MOST_PER_CORE * (os.cpu_count() or 1)))]

    def map(self, messages: Sequence[Message]) -> Iterator[Answer]:
        """The answer to each message, in order, each as soon as it and those before it are there.

        Raises a worker's exception, and InputError if two workers die of the same message, or take too long.
        """
        found: dict[int, Answer] = {}
        wanted = 0
        for index, answer in self.answers(messages):
            if isinstance(answer, WorkerDied):
                raise InputError(died("what was asked for"))
            if isinstance(answer, Exception):
                raise answer
            found[index] = answer
            while wanted in found:
                yield found.pop(wanted)
                wanted += 1

    def answers(
        self,
        messages: Sequence[Message],
        kind: Callable[[Message], object] = lambda _: None,
        enough: Callable[[], bool] = lambda: False,
    ) -> Iterator[tuple[int, Answer | Exception]]:
        """The number and the answer of each message, or its exception, as they come.

        If a worker dies, or takes too long, its message goes to another one, after all others; the second time,
        WorkerDied is the answer. kind: a worker gets messages of one kind, one after the other, as far as that delays
        none. enough: asked after each answer; once it is true, only what is begun is still answered.
        """
        left: dict[object, deque[int]] = {}
        for index, message in enumerate(messages):
            left.setdefault(kind(message), deque()).append(index)
        lost: set[int] = set()
        while True:
            if enough():
                left = {}
            self._hand_out(messages, left)
            busy = [worker for worker in self._workers if worker.own]
            if not busy:
                return
            end = min(worker.since for worker in busy) + self._deadline
            ready = wait([worker.pipe for worker in busy], None if end == inf else max(0.0, end - time.monotonic()))
            for worker in busy:
                late = time.monotonic() - worker.since > self._deadline
                if worker.pipe not in ready and not late:
                    continue
                index = worker.own.popleft()
                answer: Answer | Exception
                try:
                    answer = worker.receive(0.0 if late else inf)
                except Exception as error:
                    answer = error
                worker.since = time.monotonic()
                if isinstance(answer, WorkerDied):
                    for other in reversed(worker.own):  # it had not begun with these
                        left.setdefault(worker.kind, deque()).appendleft(other)
                    worker.close()
                    self._workers[self._workers.index(worker)] = self._new()
                    if index not in lost:
                        lost.add(index)
                        left.setdefault(worker.kind, deque()).append(index)
                        continue
                yield index, answer

    def _hand_out(self, messages: Sequence[Message], left: dict[object, deque[int]]) -> None:
        """Give every worker a message, and some in advance while enough are left."""
        while waiting := sum(map(len, left.values())):
            worker = min(self._workers, key=lambda worker: len(worker.own))
            if len(worker.own) > (self._ahead if waiting > len(self._workers) else 0):
                return
            kinds = [kind for kind, some in left.items() if some]
            taken = {other.kind for other in self._workers if other.own}
            free = next((kind for kind in kinds if kind not in taken), None)
            longest = max(kinds, key=lambda kind: len(left[kind])) if free is None else free
            worker.kind = worker.kind if left.get(worker.kind) else longest
            if not worker.own:
                worker.since = time.monotonic()
            worker.own.append(left[worker.kind].popleft())
            worker.send(messages[worker.own[-1]])

    def close(self, *, at_once: bool = False) -> None:
        """End them, as soon as they are idle or at once, and wait for the end."""
        for worker in self._workers:
            if at_once:
                worker.kill()
            worker.pipe.close()
        for worker in self._workers:
            worker.close()


def died(computed: str) -> Problem:
    """The problem that two processes died computing the same item, or took too long."""
    return Problem("worker-died", f"the process that computed {computed} died twice; is there enough memory?")
