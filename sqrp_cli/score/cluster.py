"""Jobs on a Dask cluster: the connection to it, its workers, and what travels.

The only module that imports Dask. The scheduler of a cluster also imports the modules of every task, and blocks
meanwhile: so this module imports nothing that computes; workers do. Workers run what we send; of what they answer,
nothing runs here, see `_distrust`. Machines that do not share our disk get the content of a workspace's files, named by
its digest.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import hashlib
import io
import logging
import os
import pickle
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any

from sqrp_cli.errors import Place, Problem, bad_input, bad_option, needed
from sqrp_cli.files.input_file import LARGEST, read_input, read_text
from sqrp_cli.files.json_file import parse_json
from sqrp_cli.platform.files import write_atomically

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from sqrp_cli.score.compute import Answer, Job, Workers

CONNECT_TIMEOUT = 5.0  # how long to wait for the scheduler, first for its greeting, then for the connection [s]
LOOKS = 5.0  # period of checking for workers [s]
MOST_BYTES = 1_000_000  # largest scheduler file that is read
_MEND = "start one with `dask scheduler`, and give its address (tcp://HOST:8786) or its scheduler file"
Tls = tuple[Path, Path, Path]
"""Files that encrypt connections to a cluster: the certificate of its authority, our own, and the key of that."""


def answers(
    client: Any,  # noqa: ANN401 # of Dask's, connected to a cluster
    jobs: Sequence[Job],
    enough: Callable[[], bool],
) -> Iterator[tuple[int, Answer]]:
    """The answer to each job, by number, as they come; none of those that are not done once it is enough.

    Files travel once to each worker that needs them: each is the result of its own task, which Dask passes from worker
    to worker and repeats if a worker died. What a worker answers is read as JSON, and nothing else. Raises InputError
    where the connection is lost.
    """
    from distributed import as_completed

    from sqrp_cli.score.kept import program_digest

    number: dict[Any, int] = {}
    for _, group in groupby(range(len(jobs)), key=lambda index: jobs[index].digest):
        indices = list(group)
        contents = {
            digest: client.submit(bytes, read_input(path, LARGEST), key=f"sqrp-file-{digest}")
            for path, digest in jobs[indices[0]].files.items()
        }
        packed = [pickle.dumps(jobs[index], pickle.HIGHEST_PROTOCOL) for index in indices]
        told = {"program": program_digest(), "contents": contents, "pure": False}
        number.update(zip(client.map(run_packed, packed, **told), indices, strict=True))
    for future in as_completed(list(number), loop=client.loop):
        index = number[future]
        if future.status not in ("finished", "error"):
            message = "the connection to the cluster is lost; what is finished is kept where --out was given"
            raise bad_input("no-cluster", message, mend="run the same command again, with --out and --resume")
        try:
            yield index, read_answer(future.result())
        except Exception:  # whatever a worker answers with
            name = jobs[index].candidate.name
            why = f"a worker of the cluster has died of {name}, or answered with what is no result"
            yield index, (Problem("worker-died", why),)
        if enough():
            client.cancel(list(number))
            return


@contextmanager
def connected(address: str | None, warn: Callable[[str], None], tls: Tls | None = None) -> Iterator[Workers | None]:
    """Those who do jobs on the cluster of a scheduler, which its address or its file names; None if neither is given.

    Its workers begin to load the program: a command that connects before loading it itself does not wait for them
    later. warn: called with a message when no workers are left, since work then waits for new ones. tls: encrypts, and
    proves who is who; by default as Dask's own configuration says. Raises InputError if no scheduler answers, or it
    has no workers.
    """
    if address is None:
        if tls is not None:
            raise bad_option("--tls is about --cluster, which is missing")
        yield None
        return
    client, ended = _client(address, tls), threading.Event()

    def watch() -> None:
        """Warn once each time that all workers are gone."""
        warned = False
        while not ended.wait(LOOKS):
            try:
                gone = not client.nthreads()
            except (OSError, RuntimeError, concurrent.futures.CancelledError):
                continue  # the connection is lost or being closed, which shows elsewhere
            if gone and not warned:
                warn("the cluster has no workers any more; waiting for new ones (Ctrl-C ends it)")
            warned = gone

    try:
        if not client.nthreads():
            message = f"the cluster at `{address}` has no workers"
            scheduler = f"--scheduler-file {address}" if Path(address).is_file() else address
            raise bad_input("no-cluster", message, mend=f"dask worker {scheduler} --nworkers 2 --nthreads 1")
        client.run(prepare_worker, wait=False, on_error="ignore")
        threading.Thread(target=watch, daemon=True).start()
        yield partial(answers, client)
    finally:
        ended.set()
        client.close()


async def prepare_worker() -> None:
    """Load the program while the worker goes on serving others."""

    def load() -> None:
        import sqrp_cli.score.compute  # noqa: F401
        from sqrp_cli.score.kept import program_digest

        program_digest()

    await asyncio.to_thread(load)


def run_packed(packed: bytes, program: str, contents: Mapping[str, bytes]) -> str:
    """Do a job that arrives as bytes from a machine with another disk; the answer as JSON, see `read_answer`.

    program: digest of the program that sent it. contents: of the workspace's files, by their digests.
    """
    from sqrp_cli.score.compute import run_job
    from sqrp_cli.score.kept import program_digest

    if program != program_digest():
        message = "a worker of the cluster has another version of sqrp, or of a library that it computes with"
        wrong = Problem("version-mismatch", message, mend="install the same versions on every worker")
        return _answers().dump_json((wrong,)).decode()
    job: Job = pickle.loads(packed)  # noqa: S301 # of the same program, from one whom the worker's owner trusts
    folder, places = Path(tempfile.gettempdir()) / f"sqrp-files-{os.getuid()}", dict[Path, Path]()
    folder.mkdir(mode=0o700, exist_ok=True)
    for path, digest in job.files.items():
        places[path] = place = folder / f"{digest}{path.suffix}"
        if place not in _checked:
            if not place.is_file() or hashlib.sha256(place.read_bytes()).hexdigest() != digest:
                write_atomically(place, contents[digest])
            _checked.add(place)
    answer = run_job(job, lambda workspace: workspace.relocated(lambda path: places[path]))
    if isinstance(answer, str):
        return _answers().dump_json(answer).decode()
    as_sent = []  # with the files' names on the sender's machine
    for problem in answer:
        message, where = problem.message, problem.place
        for original, local in places.items():
            message = message.replace(str(local), str(original))
            where = replace(where, file=original) if where and where.file == local else where
        as_sent.append(replace(problem, message=message, place=where))
    return _answers().dump_json(tuple(as_sent)).decode()


_checked: set[Path] = set()  # files whose content this process has verified


def read_answer(text: object) -> Answer:
    """What `run_packed` answers. Raises ValueError for anything else, from wherever it comes."""
    from sqrp_cli.score.kept import MAX_BYTES

    if not isinstance(text, str) or len(text) > MAX_BYTES:
        raise ValueError("no text, or far too much")
    return _answers().validate_json(text, strict=True)


@cache
def _answers() -> TypeAdapter[Answer]:
    from pydantic import Field, TypeAdapter

    return TypeAdapter(str | Annotated[tuple[Problem, ...], Field(min_length=1)])


def _client(cluster: str, tls: Tls | None) -> Any:  # noqa: ANN401 # a client of Dask's
    with needed("--cluster needs Dask, which is not installed", "pip install 'sqrp[cluster]'"):
        import distributed
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    _distrust()
    try:
        security = distributed.Security()
        if tls is not None:
            for file in tls:
                read_text(file, MOST_BYTES)  # says which cannot be read
            names = ("tls_ca_file", "tls_client_cert", "tls_client_key")
            security = distributed.Security(require_encryption=True, **dict(zip(names, map(str, tls), strict=True)))
        # The address of a scheduler, read from its file if a file is given.
        from distributed.comm import parse_address, parse_host_port
        from distributed.comm.registry import get_backend

        path = Path(cluster)
        address = cluster
        if path.is_file():
            data = parse_json(path, read_text(path, MOST_BYTES))
            address = data.get("address", "") if isinstance(data, dict) else ""
            if not (isinstance(address, str) and address):
                message = "this is no scheduler file: it lacks the text `address`, such as `tcp://HOST:8786`"
                raise bad_input("no-cluster", message, Place(path), mend=_MEND)
        scheme, place = parse_address(address)
        get_backend(scheme)
        _, port = parse_host_port(place)
        if not 0 < port < 2**16:
            raise ValueError(f"there is no port {port}")
        asyncio.run(asyncio.wait_for(_greeted(address, security), CONNECT_TIMEOUT))
        return distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False, security=security)
    except (MemoryError, OSError, ValueError, TypeError, LookupError, RuntimeError) as error:
        why = str(error) or f"nothing was said within {CONNECT_TIMEOUT:g} s"
        if isinstance(error, MemoryError):  # the first bytes of a greeting say how long it is
            why = "what answers there is something else"
        raise bad_input("no-cluster", f"no Dask scheduler answers at `{cluster}`: {why}", mend=_MEND) from error


class _PlainUnpickler(pickle.Unpickler):
    """Reads numbers, texts, bytes and lists of them: what would name code of any other kind is refused."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401
        if module == "builtins" and name in ("bytes", "bytearray", "str"):
            return {"bytes": bytes, "bytearray": bytearray, "str": str}[name]
        raise pickle.UnpicklingError(f"{module}.{name}: an answer of a cluster names no code")


@cache
def _distrust() -> None:
    """Have Dask's client in this process unpickle nothing that could run.

    Results, exceptions, types and warnings of workers all reach it as pickles, and so may messages of the scheduler.
    """
    import distributed.protocol.pickle as of_dask

    def plain(data: bytes, *, buffers: Sequence[object] = ()) -> object:
        return _PlainUnpickler(io.BytesIO(data), buffers=buffers).load()

    theirs = of_dask.loads
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] == "distributed":
            for attribute, value in list(vars(module).items()):
                if value is theirs:
                    setattr(module, attribute, plain)
    sys.modules["distributed.client"].pickle = SimpleNamespace(loads=plain)  # type: ignore[attr-defined]


async def _greeted(address: str, security: Any) -> None:  # noqa: ANN401 # of Dask's
    """Wait for the greeting of a server; Dask's client would wait minutes for one that stays silent."""
    from distributed.comm import connect

    comm = await connect(address, timeout=CONNECT_TIMEOUT, **security.get_connection_args("client"))
    comm.abort()
