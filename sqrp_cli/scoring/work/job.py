"""A job: a portion of the work, how it travels to a process or a machine, and how it is done there.

Machines that do not share our disk get the content of a workspace's files, named by its digest.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from sqrp_cli.errors import Infeasible, InputError, Problem, bad_input
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.platform.memory import collect_seldom, keep_freed_memory
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.blind_spans import coverage_of, coverage_of_steps
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_study import whole_study
from sqrp_cli.scoring.work.identity import program_digest
from sqrp_cli.scoring.work.results import Outcome

CELLS_KEPT = 4
"""Cells that a worker keeps loaded; the jobs of one workspace mostly come one after the other."""


@dataclass(frozen=True, eq=False)
class PackedWorkspace:
    """A workspace as bytes: packed once, and unpacked only by a worker that has not loaded its cell yet."""

    digest: str
    """Of the workspace; a worker keeps its cell under it."""
    files: Mapping[Path, str]
    """The digest of each file that it is read from, by its path on the machine that packed it."""
    data: bytes

    @classmethod
    def of(cls, workspace: Workspace) -> PackedWorkspace:
        """Pack a workspace."""
        return cls(workspace.digest, workspace.meshes, pickle.dumps(workspace, pickle.HIGHEST_PROTOCOL))

    def unpack(self) -> Workspace:
        """The workspace."""
        workspace: Workspace = pickle.loads(self.data)  # noqa: S301 # what `of` packed, in a job of our own
        return workspace


@dataclass(frozen=True, eq=False)
class Job:
    """Some candidates of a workspace."""

    workspace: PackedWorkspace
    content: str
    """Digest of what their figures depend on, see `identity.content_digest`."""
    candidates: tuple[Candidate, ...]
    """With coverage each is a way, which leaves nothing free."""
    sampling: Sampling
    seed: int
    """Of what planning draws at random."""
    coverage: bool
    """Whether their coverage is wanted besides their figures."""

    def done_in(self, cell: Cell) -> tuple[str, ...]:
        """The outcome of each candidate, as text."""
        return tuple(_outcome(cell, self, candidate).to_text() for candidate in self.candidates)

    def goes_with(self, other: Job) -> bool:
        """Whether another job of the same run can be done together with this one."""
        return (self.content, self.coverage) == (other.content, other.coverage) and (
            self.workspace.digest == other.workspace.digest
        )


def joined(jobs: Sequence[Job]) -> Job:
    """Jobs that go with each other as one."""
    if len(jobs) == 1:
        return jobs[0]
    return replace(jobs[0], candidates=tuple(candidate for job in jobs for candidate in job.candidates))


def run_job(job: Job, placed: Callable[[Workspace], Workspace] | None = None) -> tuple[str, ...]:
    """The outcome of each candidate, as text; placed: maps the workspace's files to those on this machine.

    Raises InputError for meshes or a sampling that cannot be used.
    """
    with _one_at_a_time:  # a cell has working memory of its own, and a cluster may run threads
        return job.done_in(_cell(job, placed))


def _outcome(cell: Cell, job: Job, candidate: Candidate) -> Outcome:
    world = cell.initial_world
    if not job.coverage:
        return Outcome(Assignment(job.sampling, cell=cell, world=world).assess(candidate), None)
    found = whole_study(cell, candidate, world, job.sampling, full=True)
    if isinstance(found, Infeasible):
        return Outcome(Assessment.infeasible(candidate, found.reasons), None)
    coverage = [coverage_of(cell, step) for step in found.steps]
    return Outcome(found.assessment, coverage_of_steps(coverage) if candidate.steps else coverage[0])


_cells: OrderedDict[tuple[str, int], Cell] = OrderedDict()
_one_at_a_time = threading.Lock()


def _cell(job: Job, placed: Callable[[Workspace], Workspace] | None) -> Cell:
    name = (job.workspace.digest, job.seed)
    cell = _cells.pop(name, None)
    if cell is None:
        workspace = job.workspace.unpack()
        cell = Cell.load(workspace if placed is None else placed(workspace), job.seed)
    _cells[name] = cell
    if len(_cells) > CELLS_KEPT:
        _cells.popitem(last=False)
    return cell


def run_shipped(data: bytes, program: str, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Do a job that arrived as bytes, from a machine with another disk.

    program: digest of the program that sent it. contents: of the workspace's files, by their digests. Raises
    InputError like `run_job`, and if this machine runs another program or version.
    """
    if program != program_digest():
        message = "a worker of the cluster has another version of sqrp, or of a library that it computes with"
        raise bad_input("version-mismatch", message, mend="install the same versions on every worker")
    prepare()
    job: Job = pickle.loads(data)  # noqa: S301 # of the same program
    places = {path: _materialized(path, digest, contents[digest]) for path, digest in job.workspace.files.items()}
    try:
        return run_job(job, lambda workspace: workspace.relocated(lambda path: places[path]))
    except InputError as error:
        raise InputError(*(_translated(problem, places) for problem in error.problems)) from error


@cache
def prepare() -> None:
    """Load the program, and tune the memory management of this process."""
    keep_freed_memory()
    collect_seldom()
    program_digest()


def _materialized(path: Path, digest: str, content: bytes) -> Path:
    """The path of a content on this machine's disk, written if it is missing."""
    folder = Path(tempfile.gettempdir()) / f"sqrp-files-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    place = folder / f"{digest}{path.suffix}"
    if place not in _checked:
        if not place.is_file() or hashlib.sha256(place.read_bytes()).hexdigest() != digest:
            write_atomically(place, content)
        _checked.add(place)
    return place


_checked: set[Path] = set()
"""Files whose content this process has verified."""


def _translated(problem: Problem, places: Mapping[Path, Path]) -> Problem:
    """The problem with the files' names on the sender's machine."""
    message = problem.message
    for original, local in places.items():
        message = message.replace(str(local), str(original))
    place = problem.place
    if place is not None:
        originals = [original for original, local in places.items() if local == place.file]
        place = replace(place, file=originals[0]) if originals else place
    return replace(problem, message=message, place=place)
