"""Who does the jobs: this process, processes of this machine, or a cluster, behind one interface."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Protocol

from sqrp_cli.platform.processes import ProcessExecutor, ThisProcess
from sqrp_cli.scoring.work.dask_client import Cluster
from sqrp_cli.scoring.work.job import Job, run_job


class Workers(Protocol):
    """Where jobs are done.

    count: of workers, each of which does one job at a time. ahead: so many jobs a worker should have, so that it never
    waits for us. portion: so many jobs at most are done as one, few enough that little is lost with a worker.
    aside: whether they work while this process does something else.
    """

    count: int
    ahead: int
    portion: int
    aside: bool

    def submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        """Let a worker do a job; the result is that of `run_job`.

        A worker that died shows as `BrokenExecutor`, raised here or by the result. Raises InputError where there is no
        one left to do it.
        """

    def restart(self, worker: int) -> None:
        """Replace a worker that died."""

    def close(self) -> None:
        """Begin nothing more, and wait for what has begun."""


@contextmanager
def open_workers(jobs: int, cluster: Cluster | None) -> Iterator[Workers]:
    """So many processes of this machine, or the workers of a cluster."""
    if cluster is not None:
        from sqrp_cli.scoring.work.dask_cluster import DaskWorkers

        workers: Workers = DaskWorkers(cluster)
    else:
        workers = LocalWorkers(jobs)
    try:
        yield workers
    finally:
        workers.close()


class LocalWorkers:
    """Processes of this machine; with one job at a time this process does it.

    Each process is an executor of its own: who gets a job decides who has to load its workspace.
    """

    def __init__(self, jobs: int) -> None:
        self.count = jobs
        self.aside = jobs > 1
        self.ahead = 2 if self.aside else 1
        self.portion = 1
        self._executors: list[Executor | None] = [None] * jobs

    def submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        executor = self._executors[worker]
        if executor is None:
            executor = self._executors[worker] = ProcessExecutor() if self.aside else ThisProcess()
        return executor.submit(run_job, job)

    def restart(self, worker: int) -> None:
        """See `Workers`."""
        executor = self._executors[worker]
        if executor is not None:
            executor.shutdown(cancel_futures=True)
        self._executors[worker] = None

    def close(self) -> None:
        """See `Workers`."""
        executors = [executor for executor in self._executors if executor is not None]
        self._executors = [None] * self.count
        # All at once: each is told before any is waited for, and waited for, or it would end while Python does.
        with ThreadPoolExecutor(max(1, len(executors))) as closing:
            for executor in executors:
                closing.submit(executor.shutdown, cancel_futures=True)
