"""A job: a portion of the work, how it travels to a process or a machine, and how it is done and answered there.

Machines that do not share our disk get the content of a workspace's files, named by its digest.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible, InputError, Place, Problem
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.platform.memory import collect_seldom, keep_freed_memory
from sqrp_cli.records import dataclass
from sqrp_cli.score.work.identity import program_digest
from sqrp_cli.score.work.results import MAX_BYTES, Outcome
from sqrp_cli.study.blind_spans import coverage_of, coverage_of_steps
from sqrp_cli.study.pipeline import Assignment
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.whole_study import whole_study
from sqrp_cli.task.task import Candidate

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

    def done_for(self, cell: Cell, candidate: Candidate) -> str:
        """The outcome of one of the candidates, as text."""
        return _outcome(cell, self, candidate).to_text()

    @property
    def told(self) -> str:
        """What it is about, for messages."""
        return ", ".join(candidate.name for candidate in self.candidates)


Answer = str | tuple[Problem, ...]
"""The outcome of a candidate as text, or why there is none."""


def run_job(job: Job, placed: Callable[[Workspace], Workspace] | None = None) -> list[Answer]:
    """The answer for each candidate. placed: maps the workspace's files to those on this machine."""
    with _one_at_a_time:  # a cell has working memory of its own, and a cluster may run threads
        try:
            cell = _cell(job, placed)
        except Exception as error:
            return [_problems(error)] * len(job.candidates)
        answers: list[Answer] = []
        for candidate in job.candidates:
            try:
                answers.append(job.done_for(cell, candidate))
            except Exception as error:
                answers.append(_problems(error))
        return answers


def _problems(error: Exception) -> tuple[Problem, ...]:
    if isinstance(error, InputError):
        return error.problems
    return (Problem("internal-error", " ".join(f"{type(error).__name__}: {error}".split())),)


def _outcome(cell: Cell, job: Job, candidate: Candidate) -> Outcome:
    world = cell.initial_world
    if not job.coverage:
        return Outcome(Assignment(job.sampling, cell=cell, world=world).assess(candidate), None)
    found = whole_study(cell, candidate, world, job.sampling, full=True)
    if isinstance(found, Infeasible):
        return Outcome(CandidateResult.infeasible(candidate, found.reasons), None)
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


def run_shipped(data: bytes, program: str, contents: Mapping[str, bytes]) -> str:
    """Do a job that arrived as bytes, from a machine with another disk; the answers as JSON, see `read_answers`.

    program: digest of the program that sent it. contents: of the workspace's files, by their digests.
    """
    if program != program_digest():
        message = "a worker of the cluster has another version of sqrp, or of a library that it computes with"
        return as_json([(Problem("version-mismatch", message, mend="install the same versions on every worker"),)])
    prepare()
    job: Job = pickle.loads(data)  # noqa: S301 # of the same program, from one whom the worker's owner trusts
    places = {path: _materialized(path, digest, contents[digest]) for path, digest in job.workspace.files.items()}
    answers = run_job(job, lambda workspace: workspace.relocated(lambda path: places[path]))
    return as_json(
        one if isinstance(one, str) else tuple(_translated(problem, places) for problem in one) for one in answers
    )


def as_json(answers: Iterable[Answer]) -> str:
    """Answers as JSON."""
    return json.dumps([one if isinstance(one, str) else [_told(problem) for problem in one] for one in answers])


def _told(problem: Problem) -> dict[str, object]:
    place = problem.place and (str(problem.place.file), problem.place.line, problem.place.column)
    return {**{name: getattr(problem, name) for name in ("code", "message", "severity", "mend")}, "place": place}


class _ToldProblem(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")

    code: str
    message: str
    severity: Literal["error", "warning"]
    mend: str | None
    place: tuple[str, int | None, int | None] | None

    @property
    def problem(self) -> Problem:
        place = None if self.place is None else Place(Path(self.place[0]), *self.place[1:])
        return Problem(self.code, self.message, place, severity=self.severity, mend=self.mend)


_ANSWERS: TypeAdapter[list[str | list[_ToldProblem]]] = TypeAdapter(list[str | list[_ToldProblem]])


def read_answers(text: object, count: int) -> list[Answer]:
    """What `as_json` wrote, for so many candidates. Raises ValueError for anything else, from wherever it comes."""
    if not isinstance(text, str) or len(text) > count * MAX_BYTES:
        raise ValueError("no text, or far too much")
    answers: list[Answer] = [
        one if isinstance(one, str) else tuple(told.problem for told in one) for one in _ANSWERS.validate_json(text)
    ]
    if len(answers) == 1 and isinstance(answers[0], tuple):
        return answers * count
    if len(answers) != count:
        raise ValueError(f"{len(answers)} answers, expected {count}")
    return answers


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
