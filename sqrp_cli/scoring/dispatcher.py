"""Keeping workers busy with jobs until all are done, whatever happens to the workers."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.scoring.job import Job
from sqrp_cli.scoring.workers import Workers


@dataclass(frozen=True, eq=False)
class Done:
    """A job with the outcome of each of its candidates, or with why there is none."""

    job: Job
    outcomes: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()


class Dispatcher:
    """Hands jobs to workers, and every job to `keep` as it is done, in whatever order that is.

    The jobs of one workspace go to one worker, which loads it once. A worker that has none left takes over the later
    half of what another one still has to begin, so that all of them work to the end. When a worker dies, what it was
    doing is done again after all the rest, one job at a time; a job whose worker dies again is given up.
    """

    def __init__(self, workers: Workers, keep: Callable[[Done], None]) -> None:
        self._workers = workers
        self._keep = keep
        self._unclaimed: deque[deque[Job]] = deque()  # by workspace
        self._claimed: list[deque[Job]] = [deque() for _ in range(workers.count)]  # by worker
        self._running: dict[Future[tuple[str, ...]], tuple[Job, int]] = {}  # with the worker
        self._lost: deque[Job] = deque()

    def add(self, jobs: Sequence[Job]) -> None:
        """Take on the jobs of a workspace; workers that are other processes begin with them at once."""
        if jobs:
            self._unclaimed.append(deque(jobs))
        if self._workers.aside:
            self._hand_out()
            self._collect(wait_for_one=False)

    def finish(self) -> None:
        """Return when every job is done."""
        while True:
            self._hand_out()
            if not self._running:
                break
            self._collect()
        while self._lost:
            self._again(self._lost.popleft())

    def give_up(self) -> None:
        """Begin nothing more, and keep what is under way as soon as it is done."""
        self._unclaimed.clear()
        for claimed in self._claimed:
            claimed.clear()
        for future in self._running:
            future.cancel()
        wait(self._running)
        for future, (job, _) in self._running.items():
            done = _result(future, job)
            if done is not None and done.outcomes:
                self._keep(done)
        self._running.clear()

    def _hand_out(self) -> None:
        """Give every worker something to do, and then something to go on with."""
        under_way = Counter(worker for _, worker in self._running.values())
        for ahead in range(self._workers.ahead):
            for worker in range(self._workers.count):
                if under_way[worker] == ahead and (job := self._next_for(worker)) is not None:
                    self._running[self._submit(job, worker)] = (job, worker)
                    under_way[worker] += 1

    def _next_for(self, worker: int) -> Job | None:
        """What a worker should do next: more of what it has loaded, a workspace of its own, or half of another one."""
        claimed = self._claimed[worker]
        if not claimed and self._unclaimed:
            claimed.extend(self._unclaimed.popleft())
        if not claimed:
            longest = max(self._claimed, key=len)
            taken = [longest.pop() for _ in range((len(longest) + 1) // 2)]
            claimed.extend(reversed(taken))
        return claimed.popleft() if claimed else None

    def _submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        try:
            return self._workers.submit(job, worker)
        except BrokenExecutor:
            if self._is_busy(worker):
                while self._is_busy(worker):
                    self._collect()  # finds what it was doing lost, and replaces it
            else:
                self._workers.restart(worker)
            return self._workers.submit(job, worker)

    def _is_busy(self, worker: int) -> bool:
        return any(other == worker for _, other in self._running.values())

    def _collect(self, *, wait_for_one: bool = True) -> None:
        """Keep what is done, and replace workers that died."""
        wait(self._running, timeout=None if wait_for_one else 0, return_when=FIRST_COMPLETED)
        lost: dict[int, list[Job]] = {}
        for future in [future for future in self._running if future.done()]:
            job, worker = self._running.pop(future)
            done = _result(future, job)
            if done is None:
                lost.setdefault(worker, []).append(job)
            else:
                self._keep(done)
        for worker, (first, *others) in lost.items():
            self._workers.restart(worker)
            self._lost.append(first)  # the one that it was doing; it had not begun with the others
            self._claimed[worker].extendleft(reversed(others))

    def _again(self, job: Job) -> None:
        """Do a job whose worker died with nothing else under way, in case there was too little memory for both."""
        future = self._submit(job, 0)
        self._running[future] = (job, 0)
        wait([future])
        done = _result(future, job)
        if done is None:
            self._workers.restart(0)
            done = Done(job, problems=(_died(job),))
        del self._running[future]
        self._keep(done)


def _result(future: Future[tuple[str, ...]], job: Job) -> Done | None:
    """What a job came to; None where its worker died."""
    try:
        return Done(job, outcomes=future.result())
    except InputError as error:
        return Done(job, problems=error.problems)
    except (BrokenExecutor, CancelledError):
        return None
    except Exception as error:
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return Done(job, problems=(Problem("internal-error", message),))


def _died(job: Job) -> Problem:
    names = ", ".join(candidate.name for candidate in job.candidates)
    message = f"the process that computed {names} died twice; is there enough memory?"
    return Problem("worker-died", message)
