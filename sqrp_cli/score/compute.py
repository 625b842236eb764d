"""Computing candidates, each once: what is kept is not computed again, the rest is by processes or by a cluster."""

from __future__ import annotations

import pickle
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import field
from functools import partial
from pathlib import Path

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible, InputError, Problem
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.platform.processes import Pool, died, forked
from sqrp_cli.records import dataclass
from sqrp_cli.score.kept import Outcome, Results, key_of, plain_of
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.whole_analysis import whole_analysis
from sqrp_cli.task.task import Candidate

CELLS_KEPT = 4  # cells that a worker keeps loaded; the jobs of one workspace mostly come one after the other
COMPUTED_WITHIN = 3600.0  # a process that takes longer for a candidate [s] is taken for dead
Answer = str | tuple[Problem, ...]  # the outcome of a job as text, or why there is none


def packed(workspace: Workspace) -> tuple[str, Mapping[Path, str], bytes]:
    """The first three fields of all jobs about a workspace."""
    return workspace.digest, workspace.meshes, pickle.dumps(workspace, pickle.HIGHEST_PROTOCOL)


@dataclass(frozen=True, eq=False)
class Job:
    """A piece of work about a candidate, as it travels to a process or a machine."""

    digest: str  # of the workspace; a worker keeps its cell under it
    files: Mapping[Path, str]  # the digest of each file that it is read from, by its path on the machine that packed it
    data: bytes  # the workspace, unpacked only by a worker that has not loaded its cell yet
    seed: int  # of what planning draws at random
    candidate: Candidate
    work: Callable[[Cell, Candidate], str]  # gives the outcome, as text: a function of a module, or a part of one


def score_candidate(cell: Cell, candidate: Candidate, sampling: Sampling, *, coverage: bool) -> str:
    """The figures of a candidate: an `Outcome`, as text.

    coverage: whether its coverage is wanted besides; it is then a way, which leaves nothing free.
    """
    world = cell.initial_world
    if not coverage:
        return Outcome(RankJob(sampling, cell=cell, world=world).assess(candidate), None).to_text()
    from sqrp_cli.study.blind_spans import coverage_of, coverage_of_steps

    found = whole_analysis(cell, candidate, world, sampling, full=True)
    if isinstance(found, Infeasible):
        return Outcome(CandidateResult.infeasible(candidate, found.reasons), None).to_text()
    each = [coverage_of(cell, step) for step in found.steps]
    return Outcome(found.result, coverage_of_steps(each) if candidate.steps else each[0]).to_text()


def run_job(job: Job, placed: Callable[[Workspace], Workspace] = lambda workspace: workspace) -> Answer:
    """The answer to a job. placed: maps the workspace's files to those on this machine."""
    with _one_at_a_time:
        try:
            name = (job.digest, job.seed)
            if name not in _cells:
                workspace: Workspace = pickle.loads(job.data)  # noqa: S301 # what a job of our own packed
                _cells[name] = Cell.load(placed(workspace), job.seed)
            _cells.move_to_end(name)
            if len(_cells) > CELLS_KEPT:
                _cells.popitem(last=False)
            return job.work(_cells[name], job.candidate)
        except InputError as error:
            return error.problems
        except Exception as error:
            return (Problem("internal-error", " ".join(f"{type(error).__name__}: {error}".split())),)


_cells: OrderedDict[tuple[str, int], Cell] = OrderedDict()
_one_at_a_time = threading.Lock()  # a cell has working memory of its own, and a cluster may run threads
Workers = Callable[[Sequence[Job], Callable[[], bool]], Iterator[tuple[int, Answer]]]
"""Those that do jobs elsewhere, as `cluster.Cluster.answers`: the answer to each job, by number, as they come; none of
those that are not done once it is enough."""


@dataclass(frozen=True)
class Means:
    """How to compute, with which workers, and where to keep results."""

    sampling: Sampling
    jobs: int = 1  # processes of this machine
    cluster: Workers | None = None  # computes instead of them
    out: Path | None = None  # folder of the results; None: they are kept in memory only
    seed: int = 0  # of what planning draws at random


@dataclass(frozen=True, eq=False)
class ScoreRequest:
    """A request for the figures of a candidate."""

    workspace: Workspace
    content: str  # digest of all in the workspace that they depend on, see `score.read_cell`
    candidate: Candidate
    coverage: bool = False  # as in `score_candidate`


@contextmanager
def open_computer(means: Means) -> Iterator[Computer]:
    """A computer with these means. Raises InputError for a folder that cannot be used."""
    with closing(Results(means.out)) as results:
        computer = Computer(means, results)
        try:
            yield computer
        finally:
            if computer.pool is not None:
                computer.pool.close(at_once=True)


@dataclass(eq=False)
class Computer:
    """Gets outcomes of candidates: those that are kept, and others from processes, a cluster, or itself."""

    means: Means
    results: Results
    computed: int = 0  # how many were computed, ...
    failed: int = 0  # ... and how many could not be
    pool: Pool[Job, Answer] | None = None  # the processes, once there are any
    problems: dict[str, tuple[Problem, ...]] = field(default_factory=dict)  # of what cannot be computed, by key

    def compute(self, requests: Sequence[ScoreRequest], advance: Callable[[int], None]) -> None:
        """Make every candidate available to `outcome`; `advance` is called with the number of finished ones.

        At Ctrl-C what other processes are at is finished and kept, then KeyboardInterrupt is raised. Raises InputError
        if results cannot be kept.
        """
        means = self.means
        missing = {self._key(one): one for one in requests if self.outcome(one) is None}
        workspaces = {id(one.workspace): one.workspace for one in missing.values()}
        bytes_of = {name: packed(workspace) for name, workspace in workspaces.items()}
        jobs = [
            Job(
                *bytes_of[id(one.workspace)],
                means.seed,
                one.candidate,
                partial(score_candidate, sampling=means.sampling, coverage=one.coverage),
            )
            for one in missing.values()
        ]
        keys, alone = list(missing), means.cluster is None and means.jobs < 2
        advance(len(requests) - len(missing))
        if jobs and not alone and means.cluster is None and self.pool is None:
            # A job carries its workspace: a second one would wait in the pipe.
            self.pool = Pool(means.jobs, forked(), partial, run_job, deadline=COMPUTED_WITHIN, ahead=0)
        with nullcontext(lambda: False) if alone else interrupts_later(second_raises=True) as interrupted:
            # By number, as they come; none of jobs that are not begun once it is interrupted.
            answers: Iterable[tuple[int, Answer | Exception]] = enumerate(map(run_job, jobs))
            if means.cluster is not None:
                answers = means.cluster(jobs, interrupted)
            elif self.pool is not None and not alone:
                answers = self.pool.answers(jobs, lambda job: job.digest, interrupted)
            for index, answer in answers:
                if isinstance(answer, Exception):
                    answer = (died(jobs[index].candidate.name),)
                if isinstance(answer, str) and means.cluster is not None:
                    name = (candidate := jobs[index].candidate).name
                    try:
                        Outcome.from_text(answer, candidate)
                    except ValueError:
                        why = f"a worker of the cluster answered for {name} with what is no result"
                        answer = (Problem("worker-died", why),)
                if isinstance(answer, str):
                    self.results.keep(keys[index], answer)
                    self.computed += 1
                else:
                    self.problems[keys[index]] = answer
                    self.failed += 1
                advance(1)

    def outcome(self, request: ScoreRequest) -> Outcome | list[Problem] | None:
        """The outcome of a candidate, or why it cannot be computed, if either is known.

        A damaged file is as good as none.
        """
        key = self._key(request)
        text = self.results.get(key)
        with suppress(ValueError):
            if text is not None:
                return Outcome.from_text(text, request.candidate)
        return list(self.problems[key]) if key in self.problems else None

    def _key(self, request: ScoreRequest) -> str:
        way, means = request.candidate, self.means
        about = (way.skill.name, way.parameters, way.vias, means.sampling, means.seed, request.coverage)
        return key_of(request.content, plain_of(about))
