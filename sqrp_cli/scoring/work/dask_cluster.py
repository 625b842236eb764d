"""Jobs on a Dask cluster."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.text.input_file import LARGEST, read_input
from sqrp_cli.scoring.work.cluster_tasks import run_packed
from sqrp_cli.scoring.work.dask_client import Cluster
from sqrp_cli.scoring.work.identity import program_digest
from sqrp_cli.scoring.work.job import Job
from sqrp_cli.scoring.work.shipping import packed

JOBS_AT_ONCE = 10
"""Jobs done as one: that takes all processes together some 20 ms to send and answer, and a candidate some 50 ms."""

JOBS_PER_WORKER = 2
"""Jobs that a worker has at a time, so that it never waits for us."""


class DaskWorkers:
    """The workers of a cluster; see `Workers`.

    Files travel once to each worker that needs them: each is the result of a task of its own, which Dask hands on from
    worker to worker and makes again where one died.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._client = cluster.client
        self.count, self.ahead, self.portion, self.aside = len(cluster.workers), JOBS_PER_WORKER, JOBS_AT_ONCE, True
        # Where a worker dies, or another one has nothing to do, the scheduler gives its jobs to others.
        options = {"pure": False, "allow_other_workers": True}
        self._executors = [self._client.get_executor(workers=[address], **options) for address in cluster.workers]
        self._contents: dict[str, Any] = {}

    def submit(self, job: Job, worker: int) -> Future[tuple[str, ...]]:
        """See `Workers`."""
        if self._client.status not in ("running", "connecting"):
            message = "the connection to the cluster is lost; what is finished is kept where --out was given"
            raise InputError(Problem("no-cluster", message, mend="run the same command again, with --out and --resume"))
        contents = {digest: self._content(path, digest) for path, digest in job.workspace.files.items()}
        executor: Executor = self._executors[worker]
        return executor.submit(run_packed, packed(job), program_digest(), contents)

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
