"""Who does the jobs: this process, processes of this machine, or a cluster, behind one interface."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Protocol

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
            executor = self._executors[worker] = _new_process(self._executors) if self.aside else ThisProcess()
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


class ThisProcess(Executor):
    """An executor without processes: everything is done when it is submitted."""

    def submit(self, function, /, *arguments, **options):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN002, ANN003, ANN201
        """Do it now."""
        future: Future[object] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


def _new_process(others: Sequence[Executor | None]) -> Executor:
    fork = "fork" in multiprocessing.get_all_start_methods()  # shares what is loaded
    context = multiprocessing.get_context("fork" if fork else None)
    inherited = [other for other in others if isinstance(other, ProcessPoolExecutor)] if fork else []
    return ProcessPoolExecutor(1, context, initializer=_start_worker, initargs=(inherited,))


def _start_worker(others: Sequence[ProcessPoolExecutor]) -> None:
    """others: of which this process has inherited the end of the pipe that their own process reads.

    As long as somebody has it open, sending a job to a process that was killed waits for ever.
    """
    for other in others:
        other._call_queue._reader.close()  # type: ignore[attr-defined] # there is no other way to it
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which keeps what is finished
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would otherwise wait for work forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with contextlib.suppress(ChildProcessError):
            parent.join()
        os._exit(1)
