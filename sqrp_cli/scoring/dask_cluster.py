"""Jobs on an existing Dask cluster. The only module that knows Dask."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.relocation import files_to_load
from sqrp_cli.scoring.cluster_tasks import prepare_worker, run_packed
from sqrp_cli.scoring.identity import program_digest
from sqrp_cli.scoring.job import Job
from sqrp_cli.scoring.shipping import Shipment

CONNECT_TIMEOUT = 10.0
"""How long to wait for the scheduler [s]."""

JOBS_AT_ONCE = 10
"""Jobs done as one: that takes all processes together some 20 ms to send and answer, and a candidate some 50 ms."""

JOBS_PER_WORKER = 2
"""Jobs that a worker has at a time, so that it never waits for us."""


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
        addresses = sorted(self._client.nthreads())
        if not addresses:
            self._client.close()
            message = f"the cluster at `{cluster}` has no workers"
            raise InputError(Problem("no-cluster", message, mend=f"dask worker {cluster}"))
        self._client.run(prepare_worker, wait=False, on_error="ignore")  # while we read workspaces
        self.count, self.ahead, self.portion, self.aside = len(addresses), JOBS_PER_WORKER, JOBS_AT_ONCE, True
        # Where a worker dies, or another one has nothing to do, the scheduler gives its jobs to others.
        options = {"pure": False, "allow_other_workers": True}
        self._executors = [self._client.get_executor(workers=[address], **options) for address in addresses]
        self._contents: dict[str, Any] = {}
        self._files: dict[str, Mapping[Path, str]] = {}

    def submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        if self._client.status not in ("running", "connecting"):
            message = "the connection to the cluster is lost; what is finished is kept where --out was given"
            raise InputError(Problem("no-cluster", message, mend="run the same command again, with --out and --resume"))
        digest = job.workspace.digest
        if digest not in self._files:
            self._files[digest] = files_to_load(job.workspace.unpack())
        files = self._files[digest]
        contents = {digest: self._content(path, digest) for path, digest in files.items()}
        executor: Executor = self._executors[worker]
        return executor.submit(run_packed, Shipment(job, files).packed(), program_digest(), contents)

    def restart(self, worker: int) -> None:
        """Nothing to do: the cluster starts its workers itself."""

    def close(self) -> None:
        """See `Workers`."""
        for executor in self._executors:
            executor.shutdown(wait=False)
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
