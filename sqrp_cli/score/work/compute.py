"""Computing candidates, each once: kept results are not computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Problem
from sqrp_cli.platform.interrupts import first_interrupt_noted
from sqrp_cli.platform.processes import Pool, died, forked
from sqrp_cli.records import dataclass
from sqrp_cli.score.work.cluster import Cluster
from sqrp_cli.score.work.identity import candidate_key
from sqrp_cli.score.work.job import Answer, Job, PackedWorkspace, run_job
from sqrp_cli.score.work.results import Outcome, Results
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.task.task import Candidate

COMPUTED_WITHIN = 3600.0
"""A process that takes longer for a candidate [s] is taken for dead."""


@dataclass(frozen=True)
class Means:
    """How to compute, with which workers, and where to keep results."""

    sampling: Sampling
    jobs: int = 1
    """Processes of this machine."""
    cluster: Cluster | None = None
    """Computes instead of them."""
    out: Path | None = None
    """Folder of the results; None: they are kept in memory only."""
    seed: int = 0
    """Of what planning draws at random."""


@contextmanager
def open_computer(means: Means) -> Iterator[Computer]:
    """A computer with these means. Raises InputError for a folder that cannot be used."""
    with closing(Results(means.out)) as results, closing(Computer(means, results)) as computer:
        yield computer


@dataclass(frozen=True, eq=False)
class Wanted:
    """A request for the figures of a candidate."""

    workspace: Workspace
    content: str
    """Digest of the workspace, see `identity.content_digest`."""
    candidate: Candidate


class Computer:
    """Gets outcomes of candidates: those that are kept, and others from processes, a cluster, or itself.

    computed, failed: how many were computed, and how many could not be.
    """

    def __init__(self, means: Means, results: Results) -> None:
        self.sampling = means.sampling
        self.computed = self.failed = 0
        self._means, self._results = means, results
        self._pool: Pool[Job, list[Answer]] | None = None
        self._problems: dict[str, tuple[Problem, ...]] = {}  # of what cannot be computed, by key

    def compute(self, wanted: Sequence[Wanted], advance: Callable[[int], None], *, coverage: bool = False) -> None:
        """Make every candidate available to `outcome`; `advance` is called with the number of finished ones.

        coverage: with their coverage; each is then a way, which leaves nothing free. At Ctrl-C what other processes are
        at is finished and kept, then KeyboardInterrupt is raised. Raises InputError if results cannot be kept.
        """
        missing: dict[str, Wanted] = {}
        for want in wanted:
            key = self._key(want.content, want.candidate, coverage=coverage)
            if key not in self._problems and self._outcome(key, want.candidate) is None:
                missing[key] = want
        packed: dict[str, PackedWorkspace] = {}
        jobs = []
        for want in missing.values():
            workspace = packed.get(want.workspace.digest) or PackedWorkspace.of(want.workspace)
            packed[want.workspace.digest] = workspace
            candidates, seed = (want.candidate,), self._means.seed
            jobs.append(Job(workspace, want.content, candidates, self.sampling, seed, coverage))
        advance(len(wanted) - len(missing))
        others = self._means.cluster is not None or self._means.jobs > 1
        with first_interrupt_noted() if others else nullcontext(_never) as interrupted:
            for index, answers in self._answered(jobs, interrupted):
                for candidate, answer in zip(jobs[index].candidates, answers, strict=True):
                    self._keep(self._key(jobs[index].content, candidate, coverage=coverage), candidate, answer)
                    advance(1)

    def _answered(self, jobs: Sequence[Job], interrupted: Callable[[], bool]) -> Iterator[tuple[int, Sequence[Answer]]]:
        """The answers of jobs, by number, as they come; none of those that are not begun once it is interrupted."""
        if self._means.cluster is not None:
            yield from self._means.cluster.answers(jobs, interrupted)
        elif self._means.jobs < 2:
            for index, job in enumerate(jobs):
                yield index, run_job(job)
        elif jobs:
            if self._pool is None:  # a job carries its workspace: a second one would wait in the pipe
                self._pool = Pool(self._means.jobs, forked(), _runner, deadline=COMPUTED_WITHIN, ahead=0)
            found = self._pool.answers(jobs, lambda job: job.workspace.digest, interrupted)
            for index, answers in found:
                yield index, [(died(jobs[index].told),)] if isinstance(answers, Exception) else answers

    def _keep(self, key: str, candidate: Candidate, answer: Answer) -> None:
        if isinstance(answer, str) and self._means.cluster is not None:
            try:
                Outcome.from_text(answer, candidate)
            except ValueError:
                message = f"a worker of the cluster answered for {candidate.name} with what is no result"
                answer = (Problem("worker-died", message),)
        if isinstance(answer, str):
            self._results.keep(key, answer)
            self.computed += 1
        else:
            self._problems[key] = answer
            self.failed += 1

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.kill()

    def outcome(self, wanted: Wanted, *, coverage: bool = False) -> Outcome | None:
        """The outcome of a candidate, if there is one."""
        return self._outcome(self._key(wanted.content, wanted.candidate, coverage=coverage), wanted.candidate)

    def why_not(self, wanted: Wanted) -> tuple[Problem, ...]:
        """Why a candidate cannot be computed; empty if no reason is known."""
        return self._problems.get(self._key(wanted.content, wanted.candidate, coverage=False), ())

    def _outcome(self, key: str, candidate: Candidate) -> Outcome | None:
        text = self._results.get(key)
        if text is None:
            return None
        try:
            return Outcome.from_text(text, candidate)
        except ValueError:  # a damaged file is as good as none
            return None

    def _key(self, content: str, candidate: Candidate, *, coverage: bool) -> str:
        return candidate_key(content, candidate, self.sampling, self._means.seed, coverage=coverage)


def _never() -> bool:
    return False


def _runner() -> Callable[[Job], list[Answer]]:
    return run_job
