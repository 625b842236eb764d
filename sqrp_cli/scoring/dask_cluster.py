"""Jobs on an existing Dask cluster. The only module that knows Dask."""

from __future__ import annotations

import json
import logging
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.relocation import files_to_load
from sqrp_cli.scoring.identity import program_digest
from sqrp_cli.scoring.job import Job
from sqrp_cli.scoring.shipping import prepare, run_shipped

CONNECT_TIMEOUT = 10.0
"""How long to wait for the scheduler [s]."""

CANDIDATES_PER_JOB = 6
"""A job takes some 10 ms to get to a worker, a candidate some 100 ms to compute."""

JOBS_PER_THREAD = 3
"""Jobs under way per thread of the cluster, so that none waits for us."""


class DaskWorkers:
    """The workers of a cluster; see `Workers`.

    Files travel once to each worker that needs them: each is the result of a task of its own, which Dask hands on from
    worker to worker and makes again where one died.
    """

    def __init__(self, cluster: str) -> None:
        """Connect to a scheduler by its address or its scheduler file. Raises InputError where none answers."""
        try:
            import distributed
        except ImportError as error:
            message = "--cluster needs Dask, which is not installed"
            raise InputError(Problem("missing-extra", message, mend="pip install 'sqrp[cluster]'")) from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            address = _checked_address(cluster)
            self._client: Any = distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TypeError, LookupError) as error:
            message = f"no Dask scheduler answers at `{cluster}`: {error}"
            mend = "start one with `dask scheduler`, and give its address (tcp://HOST:8786) or its scheduler file"
            raise InputError(Problem("no-cluster", message, mend=mend)) from error
        threads = sum(self._client.nthreads().values())
        if threads == 0:
            self._client.close()
            message = f"the cluster at `{cluster}` has no workers"
            raise InputError(Problem("no-cluster", message, mend=f"dask worker {cluster}"))
        self._client.run(prepare, wait=False, on_error="ignore")  # while we read workspaces
        self.capacity = JOBS_PER_THREAD * threads
        self.portion = CANDIDATES_PER_JOB
        self._executor = self._client.get_executor(pure=False)
        self._contents: dict[str, Any] = {}

    def submit(self, job: Job) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        if self._client.status not in ("running", "connecting"):
            message = "the connection to the cluster is lost; what is finished is kept where --out was given"
            raise InputError(Problem("no-cluster", message, mend="run the same command again, with --out and --resume"))
        contents = {digest: self._content(path, digest) for path, digest in files_to_load(job.workspace).items()}
        future: Future[tuple[str, ...]] = self._executor.submit(run_shipped, job, program_digest(), contents)
        return future

    def restart(self) -> None:
        """Nothing to do: the cluster starts its workers itself."""

    def close(self) -> None:
        """See `Workers`."""
        self._executor.shutdown(wait=False)
        self._contents.clear()
        self._client.close()

    def _content(self, path: Path, digest: str) -> Any:  # noqa: ANN401 # a future of Dask's
        if digest not in self._contents:
            key = f"sqrp-file-{digest}"
            self._contents[digest] = self._client.submit(bytes, path.read_bytes(), key=key)
        return self._contents[digest]


def _checked_address(cluster: str) -> str:
    """The address of a scheduler, from its file if that is what is given.

    Raises ValueError, TypeError or LookupError for what is none: a client that never had an address fails as it ends.
    """
    from distributed.comm import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    path = Path(cluster)
    address = str(json.loads(path.read_text(encoding="utf-8"))["address"]) if path.is_file() else cluster
    scheme, place = parse_address(address)
    get_backend(scheme)
    parse_host_port(place)
    return address
