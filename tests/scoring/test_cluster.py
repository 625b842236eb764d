"""What a Dask cluster is told to do, and when."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest

from sqrp_cli.errors import InputError


def test_a_scheduler_reads_tasks_without_loading_the_program():
    code = """
import pickle, sys
from sqrp_cli.scoring.work.cluster import run_packed
pickle.loads(pickle.dumps(run_packed))
print(*({"numpy", "coal", "pinocchio", "sqrp_cli.scoring.work.job"} & set(sys.modules)))
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"


def test_workers_load_the_program_before_there_are_jobs(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    from sqrp_cli.scoring.work import job
    from sqrp_cli.scoring.work.cluster import connected

    prepared = threading.Event()
    monkeypatch.setattr(job, "prepare", prepared.set)
    options = {"dashboard_address": ":0", "protocol": "tcp", "local_directory": str(tmp_path)}
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **options) as local,
        connected(local.scheduler_address, print) as cluster,
    ):
        assert cluster is not None
        assert len(cluster.workers) == 1
        assert prepared.wait(timeout=60)


def test_it_is_told_when_all_workers_are_gone(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    from sqrp_cli.scoring.work import cluster, job

    monkeypatch.setattr(job, "prepare", lambda: None)
    monkeypatch.setattr(cluster, "LOOKS", 0.05)
    told, gone = [], threading.Event()

    def tell(text: str) -> None:
        told.append(text)
        gone.set()

    options = {"dashboard_address": ":0", "protocol": "tcp", "local_directory": str(tmp_path)}
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **options) as local,
        cluster.connected(local.scheduler_address, tell),
    ):
        assert not gone.wait(timeout=0.5)
        local.scale(0)
        assert gone.wait(timeout=60)
    assert told == ["the cluster has no workers any more; waiting for new ones (Ctrl-C ends it)"]


@pytest.mark.parametrize("port", ["0", "-1", "65536", "9223372036854775808", "9" * 400])
def test_a_port_that_no_machine_has_is_refused(port):
    pytest.importorskip("distributed")
    from sqrp_cli.scoring.work.cluster import connected

    with pytest.raises(InputError, match="no Dask scheduler answers at"), connected(f"tcp://127.0.0.1:{port}", print):
        pass
