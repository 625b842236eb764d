"""Workers, and a dispatcher that keeps them busy until all jobs are done, even if workers die."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass
from itertools import islice
from math import ceil
from typing import NamedTuple, Protocol

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.platform.processes import ProcessExecutor, died
from sqrp_cli.scoring.work.job import Job, joined, run_job

SHARES = 2
"""A worker gets at most 1/SHARES of its share of the remaining jobs at once, so that all end together."""

Outcomes = tuple[str, ...]
"""The result of `run_job`."""


class Workers(Protocol):
    """Where jobs are done: this process, processes of this machine, or a cluster."""

    count: int
    """Of workers, each of which does one job at a time."""
    ahead: int
    """Length of a worker's queue, so that it never waits for us."""
    portion: int
    """Most jobs done as one; few enough that little is lost with a worker."""
    aside: bool
    """Whether they work while this process does something else."""

    def submit(self, job: Job, worker: int) -> Future[Outcomes]:
        """Let a worker do a job; the result is that of `run_job`.

        If the worker dies, the result raises `BrokenExecutor`. Raises InputError if no worker is left.
        """

    def restart(self, worker: int) -> None:
        """Replace a worker, which may have died; all its jobs are cancelled."""

    def close(self) -> None:
        """Stop the workers."""


class LocalWorkers:
    """Processes of this machine; with one job at a time, this process itself.

    Each process is its own executor, so that the dispatcher decides which process loads which workspace.
    """

    def __init__(self, jobs: int) -> None:
        self.count, self.aside, self.portion = jobs, jobs > 1, 1
        self.ahead = 2 if self.aside else 1
        self._processes: dict[int, ProcessExecutor[Job, Outcomes]] = {}

    def submit(self, job: Job, worker: int) -> Future[Outcomes]:
        """See `Workers`."""
        if not self.aside:
            return _done_here(job)
        if worker not in self._processes:
            self._processes[worker] = ProcessExecutor(run_job)
        return self._processes[worker].submit(job)

    def restart(self, worker: int) -> None:
        """See `Workers`."""
        if worker in self._processes:
            self._processes.pop(worker).close()

    def close(self) -> None:
        """See `Workers`."""
        for worker in list(self._processes):
            self.restart(worker)


def _done_here(job: Job) -> Future[Outcomes]:
    future: Future[Outcomes] = Future()
    try:
        future.set_result(run_job(job))
    except Exception as error:
        future.set_exception(error)
    return future


@dataclass(frozen=True, eq=False)
class Done:
    """A finished job."""

    job: Job
    outcomes: Outcomes = ()
    """Of each of its candidates; none where there are problems."""
    problems: tuple[Problem, ...] = ()
    """Why there are no outcomes."""


class _Running(NamedTuple):
    jobs: tuple[Job, ...]
    """Done as one."""
    worker: int


class Dispatcher:
    """Gives jobs to workers, and every finished job to `keep`, in any order.

    The jobs of one workspace go to one worker, which loads it once. An idle worker takes over the later half of
    another one's queue, so that all of them work to the end. If sending a job is expensive, a worker gets several at
    once, fewer near the end; if they fail, each is repeated alone, since one of them may be the cause. When a worker
    dies, its current jobs are repeated after all the rest, one at a time; if a worker dies of a job again, the job is
    given up.
    """

    def __init__(self, workers: Workers, keep: Callable[[Done], None]) -> None:
        self._workers = workers
        self._keep = keep
        self._unclaimed: deque[deque[Job]] = deque()  # by workspace
        self._claimed: list[deque[Job]] = [deque() for _ in range(workers.count)]  # by worker
        self._running: dict[Future[Outcomes], _Running] = {}
        self._apart: deque[Job] = deque()  # failed together with others
        self._lost: deque[Job] = deque()  # with their worker

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
        """Begin nothing more; finish and keep what is under way."""
        self._unclaimed.clear()
        for waiting in (self._apart, *self._claimed):
            waiting.clear()
        for future in self._running:
            future.cancel()
        wait(self._running)
        for future, running in self._running.items():
            for done in _results(future, running.jobs) or ():
                if done.outcomes:
                    self._keep(done)
        self._running.clear()

    def _hand_out(self) -> None:
        """Give every worker a job, then fill the queues."""
        under_way = Counter(running.worker for running in self._running.values())
        for ahead in range(self._workers.ahead):
            for worker in range(self._workers.count):
                if under_way[worker] == ahead and (jobs := self._next_for(worker)):
                    self._begin(jobs, worker)
                    under_way[worker] += 1

    def _begin(self, jobs: tuple[Job, ...], worker: int) -> Future[Outcomes]:
        future = self._workers.submit(joined(jobs), worker)
        self._running[future] = _Running(jobs, worker)
        return future

    def _next_for(self, worker: int) -> tuple[Job, ...]:
        """A worker's next workspace: the one that it has loaded, a new one, or half of another worker's."""
        if self._apart:
            return (self._apart.popleft(),)
        left = sum(map(len, (*self._unclaimed, *self._claimed)))
        most = min(self._workers.portion, ceil(left / (SHARES * self._workers.count)))
        claimed = self._claimed[worker]
        if not claimed and self._unclaimed:
            claimed.extend(self._unclaimed.popleft())
        if not claimed:
            longest = max(self._claimed, key=len)
            taken = [longest.pop() for _ in range((len(longest) + 1) // 2)]
            claimed.extend(reversed(taken))
        jobs: list[Job] = []
        while claimed and len(jobs) < most and (not jobs or claimed[0].goes_with(jobs[0])):
            jobs.append(claimed.popleft())
        return tuple(jobs)

    def _collect(self, *, wait_for_one: bool = True) -> None:
        """Keep finished jobs, and replace dead workers."""
        wait(self._running, timeout=None if wait_for_one else 0, return_when=FIRST_COMPLETED)
        lost: dict[int, list[tuple[Job, ...]]] = {}
        for future in [future for future in self._running if future.done()]:
            jobs, worker = self._running.pop(future)
            results = _results(future, jobs)
            if results is None:
                lost.setdefault(worker, []).append(jobs)
            elif len(jobs) > 1 and results[0].problems:
                self._apart.extend(jobs)
            else:
                for done in results:
                    self._keep(done)
        for worker, (first, *others) in lost.items():
            self._workers.restart(worker)  # what it still had to do is lost then, too
            behind = [future for future, running in self._running.items() if running.worker == worker and future.done()]
            others += [self._running.pop(future).jobs for future in behind]
            self._lost.extend(first)  # what it was doing; it had not begun with the others
            self._claimed[worker].extendleft(job for jobs in reversed(others) for job in reversed(jobs))

    def _again(self, job: Job) -> None:
        """Repeat a job whose worker died, alone, in case two jobs took too much memory."""
        self._workers.restart(0)
        future = self._begin((job,), 0)
        wait([future])
        results = _results(future, (job,))
        if results is None:
            results = [Done(job, problems=(died(", ".join(candidate.name for candidate in job.candidates)),))]
        del self._running[future]
        for done in results:
            self._keep(done)


def _results(future: Future[Outcomes], jobs: Sequence[Job]) -> list[Done] | None:
    """The result of jobs done as one; None if their worker died."""
    try:
        outcomes = iter(future.result())
        return [Done(job, outcomes=tuple(islice(outcomes, len(job.candidates)))) for job in jobs]
    except InputError as error:
        problems = error.problems
    except (BrokenExecutor, CancelledError):
        return None
    except Exception as error:
        problems = (Problem("internal-error", " ".join(f"{type(error).__name__}: {error}".split())),)
    return [Done(job, problems=problems) for job in jobs]
