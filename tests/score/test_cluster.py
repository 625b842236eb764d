"""What a Dask cluster is told to do, and when; and that nothing that a worker answers runs here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.score.cluster import connected, read_answer
from sqrp_cli.score.kept import Outcome, as_line, from_line, plain_of
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.task.task import read_task

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def test_a_scheduler_reads_tasks_without_loading_the_program():
    code = """
import pickle, sys
from sqrp_cli.score.cluster import run_packed
pickle.loads(pickle.dumps(run_packed))
print(*({"numpy", "coal", "pinocchio", "sqrp_cli.score.compute"} & set(sys.modules)))
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"


PRELUDE = """
import atexit, os, subprocess, sys, threading, time
from pathlib import Path
import distributed
from sqrp_cli.errors import InputError
from sqrp_cli.score import cluster
from sqrp_cli.score.cluster import connected

class Evil:
    def __init__(self, mark):
        self.mark = mark
    def __reduce__(self):
        return exec, (f"import os; open({self.mark!r} + str(os.getpid()), 'w')",)

class Failure(Evil, Exception):
    pass

def answer(mark): return Evil(mark)
def fail(mark): raise Failure(mark)
def listed(mark): return [1, {"a": Evil(mark)}]
def numbers(mark):
    import numpy
    return numpy.array([Evil(mark)], dtype=object)
def warn(mark):
    import cloudpickle
    distributed.get_worker().log_event("warn", {"message": cloudpickle.dumps(Evil(mark))})
    return "told"

folder = sys.argv[1]
file = f"{folder}/../scheduler.json"
python = [sys.executable, "-m", "distributed.cli.dask_scheduler" , "--port", "0", "--no-dashboard"]
def started(*more):
    quiet = {"stdout": -3, "stderr": -3}
    scheduler = subprocess.Popen([*python, "--scheduler-file", file, *more], **quiet)
    while not Path(file).exists():
        time.sleep(0.05)
    work = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", file, "--no-dashboard"]
    work += ["--no-nanny", "--nthreads", "1", "--local-directory", f"{folder}/.."]
    worker = subprocess.Popen([*work, *more], **quiet)
    atexit.register(ended, (scheduler, worker))
    return scheduler, worker
def ended(processes):
    for process in reversed(processes):
        process.kill()
def reached(*tls):
    for _ in range(200):
        try:
            with connected(file, print, *tls):
                return
        except InputError as error:
            if "has no workers" not in str(error):
                raise
            time.sleep(0.1)
"""
CLUSTER = """
from sqrp_cli.cli.main import run
processes = started()
reached()
with connected(file, print) as found:
    for name, work in (("result", answer), ("error", fail), ("list", listed), ("array", numbers)):
        try:
            print(name, type(found.args[0].submit(work, f"{folder}/{name}").result(timeout=5)).__name__)
        except BaseException as error:
            print(name, "refused")
    print(found.args[0].submit(warn, f"{folder}/warning").result(timeout=20))
    found.args[0].submit(len, "ab").result(timeout=20)
    print([path.name for path in Path(folder).iterdir() if path.name.endswith(str(os.getpid()))])
for more in ([], ["--cluster", file]):
    run(["score", sys.argv[2], "--json", *more])
    sys.stdout.flush()
cluster.LOOKS = 0.05
told, gone = [], threading.Event()
with connected(file, lambda text: (told.append(text), gone.set())) as found:
    print(len(found.args[0].nthreads()), gone.wait(timeout=0.5))
    processes[1].terminate()
    print(gone.wait(timeout=30))
print(told)
ended(processes)
"""


def ran(code: str, folder: Path, *arguments: object) -> list[str]:
    """The lines that a script prints that has a cluster of processes of its own."""
    script = folder / "script.py"
    script.write_text(PRELUDE + code)
    (folder / "marks").mkdir()
    command = [sys.executable, script, folder / "marks", *arguments]
    environment = {**ENVIRONMENT, "TMPDIR": str(folder)}
    found = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)
    assert found.returncode == 0, found.stderr
    return found.stdout.splitlines()


@pytest.fixture(autouse=True)
def _dask() -> None:
    pytest.importorskip("distributed")


def test_a_cluster_runs_nothing_here_gives_the_same_bytes_and_tells_when_it_has_no_workers(tmp_path: Path) -> None:
    """Results, exceptions, arrays of objects and warnings are pickles that would run what they name."""
    cell = Path(shutil.copytree(ROOT / "tests" / "cases" / "watch", tmp_path / "watch"))
    mesh = Path(shutil.copy(ROOT / "tests" / "cases" / "cell" / "cube.stl", cell))
    stray = "stray: {type: cube, size: [10 cm, 10 cm, 10 cm]"
    text = (cell / "workspace.yaml").read_text(encoding="utf-8").replace("watch green", "watch cube")
    text = text.replace(stray, f"{stray}, parts: [{{mesh: cube.stl, scale: 0.01}}]")
    (cell / "workspace.yaml").write_text(text, encoding="utf-8")
    *hostile, here, there, workers, gone, told = ran(CLUSTER, tmp_path, cell)
    assert hostile == ["result refused", "error refused", "list refused", "array refused", "told", "[]"]
    assert here == there
    assert '"status": "failed"' in here or '"status": "passed"' in here
    shipped = list(tmp_path.glob("sqrp-files-*/*"))
    assert [file.read_bytes() for file in shipped] == [mesh.read_bytes()]
    assert (workers, gone) == ("1 False", "True")
    assert told == "['the cluster has no workers any more; waiting for new ones (Ctrl-C ends it)']"


TLS = """
cert, key = f"{folder}/cert.pem", f"{folder}/key.pem"
request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=localhost", "-days", "2"]
subprocess.run([*request, "-keyout", key, "-out", cert], check=True, capture_output=True)
files, ca = [Path(cert), Path(cert), Path(key)], cert
processes = started("--tls-ca-file", ca, "--tls-cert", cert, "--tls-key", key, "--protocol", "tls")
reached(tuple(files))
with connected(file, print, tuple(files)) as found:
    print(found.args[0].scheduler.address.split(":")[0], found.args[0].submit(len, "abc").result(timeout=20))
try:
    with connected(file, print):
        print("connected")
except InputError as error:
    print("no Dask scheduler answers" in str(error))
ended(processes)
"""


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl")
def test_connections_are_encrypted_as_asked(tmp_path: Path) -> None:
    assert ran(TLS, tmp_path) == ["tls 3", "True"]


def test_ports_that_no_machine_has_are_refused() -> None:
    code = """
from sqrp_cli.errors import InputError
from sqrp_cli.score.cluster import connected
for port in ("0", "-1", "65536", "9223372036854775808", "9" * 400):
    try:
        with connected(f"tcp://127.0.0.1:{port}", print):
            pass
    except InputError as error:
        print(str(error)[:33])
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.stdout.splitlines() == ["no Dask scheduler answers at `tcp:"[:33]] * 5


@pytest.mark.parametrize(
    "text", [None, b"[]", "", "{}", "[]", "[1]", "[[{}]]", '["a", "b"]', '[{"code": 1}]', "[" * 9000, "x" * 20_000_000]
)
def test_answers_that_are_none_are_refused(text: object) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 # pydantic's own is one of these
        read_answer(text)
    with pytest.raises(InputError, match="--tls is about --cluster"), connected(None, print, (ROOT, ROOT, ROOT)):
        pass


def test_figures_of_another_type_are_no_result() -> None:
    workspace = load_workspace(ROOT / "tests" / "cases" / "watch")
    candidate = read_task("watch seen", workspace).candidates[0]
    good = Outcome(CandidateResult.infeasible(candidate, ("too far",)), None)
    assert Outcome.from_text(good.to_text(), candidate).result.reasons == ("too far",)
    for name, wrong in (("time", "1"), ("reasons", {"@": "tuple", "of": [5]}), ("feasible", 1), ("ways", {"a": 1})):
        plain = {**plain_of(good.result), name: wrong}
        text = as_line({"@": "tuple", "of": [plain, None]})
        with pytest.raises(ValueError, match=f"CandidateResult.{name} is no"):
            from_line(text, [candidate.skill])
