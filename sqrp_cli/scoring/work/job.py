"""One portion of the work, as it travels to a process or a machine, and what is done there."""

from __future__ import annotations

import pickle
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, study
from sqrp_cli.programming.coverage.blind_spans import coverage_of
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.verdict import verdict
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.task import Candidate
from sqrp_cli.scoring.work.outcome import Outcome

CELLS_KEPT = 4
"""Cells that a worker keeps loaded; the jobs of one workspace mostly come one after the other."""


@dataclass(frozen=True, eq=False)
class PackedWorkspace:
    """A workspace as bytes: packed once, and unpacked only by a worker that has not loaded its cell yet.

    digest: of the workspace, under which a worker keeps its cell. files: the digest of each file that is read to load
    it, by where it is on the machine that packed it.
    """

    digest: str
    files: Mapping[Path, str]
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
    """Some candidates of a workspace.

    content: digest of what their figures depend on, see `identity.content_digest`. seed: of what planning draws at
    random. coverage: whether their coverage is wanted besides their figures.
    """

    workspace: PackedWorkspace
    content: str
    candidates: tuple[Candidate, ...]
    sampling: Sampling
    seed: int
    coverage: bool

    def goes_with(self, other: Job) -> bool:
        """Whether a job of the same run can be done as one with this."""
        return (self.content, self.coverage) == (other.content, other.coverage) and (
            self.workspace.digest == other.workspace.digest
        )


def joined(jobs: Sequence[Job]) -> Job:
    """Jobs that go with each other as one."""
    first, *others = jobs
    if not others:
        return first
    return replace(first, candidates=tuple(candidate for job in jobs for candidate in job.candidates))


def run_job(job: Job, placed: Callable[[Workspace], Workspace] | None = None) -> tuple[str, ...]:
    """The outcome of each candidate, as text; placed: puts the workspace's files where they are on this machine.

    Raises InputError for meshes or a sampling that cannot be used.
    """
    with _one_at_a_time:  # a cell has working memory of its own, and a cluster may run threads
        cell = _cell(job, placed)
        return tuple(_outcome(cell, job, candidate).to_text() for candidate in job.candidates)


def _outcome(cell: Cell, job: Job, candidate: Candidate) -> Outcome:
    world = cell.initial_world
    if not job.coverage:
        return Outcome(Assignment(cell, world, job.sampling).assess(candidate), None)
    found = study(cell, candidate, world, job.sampling, full=True)
    if isinstance(found, Infeasible):
        return Outcome(Assessment(candidate, feasible=False, reasons=found.reasons), None)
    return Outcome(found.assessment(verdict(cell, found)), coverage_of(cell, found))


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
