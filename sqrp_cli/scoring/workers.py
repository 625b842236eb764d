"""Who does the jobs: this process, processes of this machine, or a cluster, behind one interface."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Protocol

from sqrp_cli.scoring.job import Job, run_job


class Workers(Protocol):
    """Where jobs are done.

    capacity: so many jobs should be under way at a time. portion: so many candidates make a good job: few, so that
    little is lost with a worker, but enough that sending them costs little.
    """

    capacity: int
    portion: int

    def submit(self, job: Job) -> Future[tuple[str, ...]]:
        """Begin a job; its result is that of `run_job`. A worker that died shows as `BrokenExecutor`.

        Raises InputError where there is no one left to do it.
        """

    def restart(self) -> None:
        """Replace workers that died."""

    def close(self) -> None:
        """Begin nothing more, and wait for what has begun."""


@contextmanager
def open_workers(jobs: int, cluster: str | None) -> Iterator[Workers]:
    """Processes of this machine, or the workers of a Dask cluster: its scheduler's address, or scheduler file.

    Raises InputError for a cluster that cannot be reached.
    """
    if cluster is not None:
        from sqrp_cli.scoring.dask_cluster import DaskWorkers

        workers: Workers = DaskWorkers(cluster)
    else:
        workers = LocalWorkers(jobs)
    try:
        yield workers
    finally:
        workers.close()


class LocalWorkers:
    """Processes of this machine; with one job at a time this process does it."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self.capacity = 1 if jobs == 1 else jobs + 1
        self.portion = 1
        self._executor = self._new_executor()

    def submit(self, job: Job) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        return self._executor.submit(run_job, job)

    def restart(self) -> None:
        """See `Workers`."""
        self.close()
        self._executor = self._new_executor()

    def close(self) -> None:
        """See `Workers`."""
        self._executor.shutdown(cancel_futures=True)

    def _new_executor(self) -> Executor:
        if self._jobs == 1:
            return ThisProcess()
        fork = "fork" in multiprocessing.get_all_start_methods()  # shares what is loaded
        context = multiprocessing.get_context("fork" if fork else None)
        return ProcessPoolExecutor(self._jobs, context, initializer=_start_worker)


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


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which keeps what is finished
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would otherwise wait for work forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with contextlib.suppress(ChildProcessError):
            parent.join()
        os._exit(1)
