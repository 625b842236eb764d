"""Keeping workers busy with jobs until all are done, whatever happens to the workers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
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


def run_jobs(workers: Workers, jobs: Sequence[Job], keep: Callable[[Done], None]) -> None:
    """Hand every job to `keep` as it is done, in whatever order that is.

    When a worker dies, what was under way is done again, one job at a time; a job whose worker dies again is given up.
    At Ctrl-C what is under way is finished and kept before KeyboardInterrupt goes on.
    """
    running: dict[Future[tuple[str, ...]], Job] = {}
    try:
        _run(workers, iter(jobs), running, keep)
    except KeyboardInterrupt:
        for future in running:
            future.cancel()
        wait(running)
        for future, job in running.items():
            done = _result(future, job)
            if done is not None and done.outcomes:
                keep(done)
        raise


def _run(
    workers: Workers,
    waiting: Iterator[Job],
    running: dict[Future[tuple[str, ...]], Job],
    keep: Callable[[Done], None],
) -> None:
    """See `run_jobs`; running: what is under way and not yet kept."""
    suspects: deque[Job] = deque()
    while True:
        alone = bool(suspects)
        if alone:
            job = suspects.popleft()
            running[workers.submit(job)] = job
        while not alone and len(running) < workers.capacity and (next_job := next(waiting, None)) is not None:
            running[workers.submit(next_job)] = next_job
        if not running:
            return
        wait(running, return_when=FIRST_COMPLETED)
        if any(future.done() and isinstance(future.exception(), BrokenExecutor) for future in running):
            wait(running)  # whatever else is under way is lost with it
            workers.restart()
        for future in [future for future in running if future.done()]:
            done = _result(future, running[future])
            if done is not None:
                keep(done)
            elif alone:
                keep(Done(running[future], problems=(_died(running[future]),)))
            else:
                suspects.append(running[future])
            del running[future]


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
