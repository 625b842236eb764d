"""Jobs on a Dask cluster: the connection to it, its workers, and their tasks.

The only module that imports Dask. The scheduler of a cluster also imports the modules of every task, and blocks
meanwhile: so this module imports nothing that computes; workers do.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import pickle
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, needed
from sqrp_cli.knowledge.text.input_file import LARGEST, read_input, read_text
from sqrp_cli.knowledge.text.json_file import parse_json

if TYPE_CHECKING:
    from sqrp_cli.scoring.work.job import Job

CONNECT_TIMEOUT = 5.0
"""How long to wait for the scheduler, first for its greeting, then for the connection [s]."""

LOOKS = 5.0
"""Period of checking for workers [s]."""

MAX_BYTES = 1_000_000
"""Largest scheduler file that is read."""

JOBS_AT_ONCE = 10
"""Jobs done as one: sending and answering takes all processes together some 20 ms, a candidate some 50 ms."""

JOBS_PER_WORKER = 2
"""Jobs in the queue of a worker, so that it never waits for us."""

_MEND = "start one with `dask scheduler`, and give its address (tcp://HOST:8786) or its scheduler file"


@dataclass(frozen=True, eq=False)
class Cluster:
    """A connected Dask cluster."""

    client: Any
    """Of Dask's, connected to it."""
    workers: tuple[str, ...]
    """Their addresses."""


@contextmanager
def connected(address: str | None, warn: Callable[[str], None]) -> Iterator[Cluster | None]:
    """The cluster of a scheduler, given by its address or its scheduler file; None if neither is given.

    Its workers begin to load the program: a command that connects before loading it itself does not wait for them
    later. warn: called with a message when no workers are left, since work then waits for new ones. Raises InputError
    if no scheduler answers, or it has no workers.
    """
    if address is None:
        yield None
        return
    client = _client(address)
    ended = threading.Event()
    try:
        workers = tuple(sorted(client.nthreads()))
        if not workers:
            message = f"the cluster at `{address}` has no workers"
            scheduler = f"--scheduler-file {address}" if Path(address).is_file() else address
            raise bad_input("no-cluster", message, mend=f"dask worker {scheduler} --nworkers 2 --nthreads 1")
        client.run(prepare_worker, wait=False, on_error="ignore")
        threading.Thread(target=_watch, args=(client, warn, ended), daemon=True).start()
        yield Cluster(client, workers)
    finally:
        ended.set()
        client.close()


class DaskWorkers:
    """The workers of a cluster; see `dispatcher.Workers`.

    Files travel once to each worker that needs them: each is the result of its own task, which Dask passes from worker
    to worker and repeats if a worker died.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._client = cluster.client
        self.count, self.aside = len(cluster.workers), True
        self.ahead, self.portion = JOBS_PER_WORKER, JOBS_AT_ONCE
        # When a worker dies, or another one is idle, the scheduler gives its jobs to others.
        options = {"pure": False, "allow_other_workers": True}
        self._executors: list[Executor] = [
            self._client.get_executor(workers=[address], **options) for address in cluster.workers
        ]
        self._contents: dict[str, Any] = {}

    def submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        from sqrp_cli.scoring.work.identity import program_digest

        if self._client.status not in ("running", "connecting"):
            message = "the connection to the cluster is lost; what is finished is kept where --out was given"
            raise bad_input("no-cluster", message, mend="run the same command again, with --out and --resume")
        contents = {digest: self._content(path, digest) for path, digest in job.workspace.files.items()}
        data = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)  # passes through a cluster unread
        return self._executors[worker].submit(run_packed, data, program_digest(), contents)

    def restart(self, worker: int) -> None:
        """Nothing to do: the cluster starts its workers itself."""

    def close(self) -> None:
        """See `Workers`."""
        for executor in self._executors:
            executor.shutdown(wait=False)
        self._contents.clear()

    def _content(self, path: Path, digest: str) -> Any:  # noqa: ANN401 # a future of Dask's
        if digest not in self._contents:
            key = f"sqrp-file-{digest}"
            self._contents[digest] = self._client.submit(bytes, read_input(path, LARGEST), key=key)
        return self._contents[digest]


async def prepare_worker() -> None:
    """Load the program, see `job.prepare`, while the worker goes on serving others."""
    import asyncio  # every worker has it, and a run without a cluster need not load it

    await asyncio.to_thread(_prepare)


def _prepare() -> None:
    from sqrp_cli.scoring.work.job import prepare

    prepare()


def run_packed(job: bytes, program: str, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Do a job that arrives as bytes, see `job.run_shipped`."""
    from sqrp_cli.scoring.work.job import run_shipped

    return run_shipped(job, program, contents)


def _watch(client: Any, warn: Callable[[str], None], ended: threading.Event) -> None:  # noqa: ANN401
    """Warn once each time that all workers are gone, until `ended`."""
    warned = False
    while not ended.wait(LOOKS):
        try:
            gone = not client.nthreads()
        except (OSError, RuntimeError, concurrent.futures.CancelledError):
            continue  # the connection is lost or being closed, which shows elsewhere
        if gone and not warned:
            warn("the cluster has no workers any more; waiting for new ones (Ctrl-C ends it)")
        warned = gone


def _client(cluster: str) -> Any:  # noqa: ANN401 # a client of Dask's
    with needed("--cluster needs Dask, which is not installed", "pip install 'sqrp[cluster]'"):
        import distributed
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        address = _checked_address(cluster)
        asyncio.run(asyncio.wait_for(_greeted(address), CONNECT_TIMEOUT))
        return distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except MemoryError as error:  # the first bytes of a greeting say how long it is
        raise InputError(_no_cluster(cluster, "what answers there is something else")) from error
    except (OSError, ValueError, TypeError, LookupError) as error:
        why = str(error) or f"nothing was said within {CONNECT_TIMEOUT:g} s"
        raise InputError(_no_cluster(cluster, why)) from error


def _no_cluster(cluster: str, why: str) -> Problem:
    return Problem("no-cluster", f"no Dask scheduler answers at `{cluster}`: {why}", mend=_MEND)


async def _greeted(address: str) -> None:
    """Wait for the greeting of a server; Dask's client would wait minutes for one that stays silent."""
    from distributed.comm import connect

    comm = await connect(address, timeout=CONNECT_TIMEOUT)
    comm.abort()


def _checked_address(cluster: str) -> str:
    """The address of a scheduler, read from its file if a file is given.

    Raises ValueError, TypeError or LookupError for a bad one, since a client without an address fails when it ends.
    """
    from distributed.comm import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    path = Path(cluster)
    address = _address_in(path) if path.is_file() else cluster
    scheme, place = parse_address(address)
    get_backend(scheme)
    _, port = parse_host_port(place)
    if not 0 < port < 2**16:
        raise ValueError(f"there is no port {port}")
    return address


def _address_in(path: Path) -> str:
    """The address in a scheduler file. Raises InputError, with file and line, for any other file."""
    data = parse_json(path, read_text(path, MAX_BYTES))
    address = data.get("address") if isinstance(data, dict) else None
    if not isinstance(address, str):
        message = "this is no scheduler file: it lacks the text `address`, such as `tcp://HOST:8786`"
        raise bad_input("no-cluster", message, Place(path), mend=_MEND)
    return address
