"""The connection to a Dask cluster. The only module that imports Dask, and none of what computes."""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.text.input_file import read_text
from sqrp_cli.knowledge.text.json_file import parse_json
from sqrp_cli.scoring.work.cluster_tasks import prepare_worker

CONNECT_TIMEOUT = 5.0
"""How long to wait for the scheduler, first until it says who it is, then until it knows us [s]."""

MAX_BYTES = 1_000_000
"""Largest scheduler file that is read."""

_MEND = "start one with `dask scheduler`, and give its address (tcp://HOST:8786) or its scheduler file"

LOOKS = 5.0
"""How often it is asked whether there are workers [s]."""


@dataclass(frozen=True, eq=False)
class Cluster:
    """A Dask cluster that answers: the client that is connected to it, and the addresses of its workers."""

    client: Any
    workers: tuple[str, ...]


@contextmanager
def connected(address: str | None, tell: Callable[[str], None]) -> Iterator[Cluster | None]:
    """The cluster of a scheduler, given by its address or its scheduler file; None where none is given.

    Its workers begin to load the program: a command that connects before it loads it itself does not wait for them
    later. tell: is told when there are no workers any more, since work then waits for new ones. Raises InputError where
    no scheduler answers, or it has no workers.
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
            raise InputError(Problem("no-cluster", message, mend=f"dask worker {scheduler} --nworkers 2 --nthreads 1"))
        client.run(prepare_worker, wait=False, on_error="ignore")
        threading.Thread(target=_watch, args=(client, tell, ended), daemon=True).start()
        yield Cluster(client, workers)
    finally:
        ended.set()
        client.close()


def _watch(client: Any, tell: Callable[[str], None], ended: threading.Event) -> None:  # noqa: ANN401
    """Tell once each time that all workers are gone, until `ended`."""
    told = False
    while not ended.wait(LOOKS):
        try:
            gone = not client.nthreads()
        except (OSError, RuntimeError, concurrent.futures.CancelledError):
            continue  # the connection is lost or being closed, which shows elsewhere
        if gone and not told:
            tell("the cluster has no workers any more; waiting for new ones (Ctrl-C ends it)")
        told = gone


def _client(cluster: str) -> Any:  # noqa: ANN401 # a client of Dask's
    try:
        import distributed
    except ImportError as error:
        message = "--cluster needs Dask, which is not installed"
        raise InputError(Problem("missing-extra", message, mend="pip install 'sqrp[cluster]'")) from error
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
    """Returns once whoever listens has said who it is; a client would wait for minutes for one that says nothing."""
    from distributed.comm import connect

    comm = await connect(address, timeout=CONNECT_TIMEOUT)
    comm.abort()


def _checked_address(cluster: str) -> str:
    """The address of a scheduler, from its file if that is what is given.

    Raises ValueError, TypeError or LookupError for what is none: a client that never had an address fails as it ends.
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
    """The address in a scheduler file. Raises InputError, with file and line, for what is none."""
    data = parse_json(path, read_text(path, MAX_BYTES))
    address = data.get("address") if isinstance(data, dict) else None
    if not isinstance(address, str):
        message = "this is no scheduler file: it lacks the text `address`, such as `tcp://HOST:8786`"
        raise InputError(Problem("no-cluster", message, Place(path), mend=_MEND))
    return address
