"""Jobs for machines that do not share our disk: the files of a workspace travel as content, named by its digest."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.platform.memory import collect_seldom, keep_freed_memory
from sqrp_cli.scoring.work.identity import program_digest
from sqrp_cli.scoring.work.job import Job, run_job


def packed(job: Job) -> bytes:
    """A job as bytes, which pass through a cluster unread."""
    return pickle.dumps(job, pickle.HIGHEST_PROTOCOL)


def run_shipped(data: bytes, program: str, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Do a `packed` job whose workspace's files are not on this machine.

    program: digest of the program that sent it. contents: of the files, by digest. Raises InputError as `run_job`, and
    where this machine runs another program or version.
    """
    if program != program_digest():
        message = "a worker of the cluster has another version of sqrp, or of a library that it computes with"
        raise InputError(Problem("version-mismatch", message, mend="install the same versions on every worker"))
    prepare()
    job: Job = pickle.loads(data)  # noqa: S301 # what the same program packed
    places = {path: _materialized(path, digest, contents[digest]) for path, digest in job.workspace.files.items()}
    try:
        return run_job(job, lambda workspace: workspace.relocated(lambda path: places[path]))
    except InputError as error:
        raise InputError(*(_translated(problem, places) for problem in error.problems)) from error


@cache
def prepare() -> None:
    """Load the program, and see to the memory of this process."""
    keep_freed_memory()
    collect_seldom()
    program_digest()


def _materialized(path: Path, digest: str, content: bytes) -> Path:
    """The file with a content on this machine's disk, written if it is not there yet."""
    folder = Path(tempfile.gettempdir()) / f"sqrp-files-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    place = folder / f"{digest}{path.suffix}"
    if place not in _checked:
        if not place.is_file() or hashlib.sha256(place.read_bytes()).hexdigest() != digest:
            write_atomically(place, content)
        _checked.add(place)
    return place


_checked: set[Path] = set()
"""Files whose content this process has seen to be right."""


def _translated(problem: Problem, places: Mapping[Path, Path]) -> Problem:
    """The problem with the names that the files have where the job came from."""
    message = problem.message
    for original, local in places.items():
        message = message.replace(str(local), str(original))
    place = problem.place
    if place is not None:
        originals = [original for original, local in places.items() if local == place.file]
        place = replace(place, file=originals[0]) if originals else place
    return replace(problem, message=message, place=place)
