"""Computing what is asked of candidates, each once: what is kept already is not computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.scoring.identity import candidate_key
from sqrp_cli.scoring.job import Job
from sqrp_cli.scoring.outcome import Outcome
from sqrp_cli.scoring.results_folder import Results, results_in
from sqrp_cli.scoring.run_jobs import Done, run_jobs
from sqrp_cli.scoring.workers import Workers, open_workers


@dataclass(frozen=True)
class Means:
    """How to compute: how, with what, and where results are kept; None: in memory only.

    jobs: processes of this machine; cluster: a Dask cluster instead, see `open_workers`. seed: of what planning draws.
    """

    sampling: Sampling
    jobs: int = 1
    cluster: str | None = None
    out: Path | None = None
    seed: int = 0


@contextmanager
def open_computer(means: Means) -> Iterator[Computer]:
    """What computes candidates by these means. Raises InputError for a folder or a cluster that cannot be used."""
    with results_in(means.out) as results, open_workers(means.jobs, means.cluster) as workers:
        yield Computer(workers, results, means.sampling, means.seed)


@dataclass(frozen=True, eq=False)
class Wanted:
    """A candidate whose figures are wanted; content: digest of its workspace, see `identity.content_digest`."""

    workspace: Workspace
    content: str
    candidate: Candidate


@dataclass(eq=False)
class Computer:
    """Gets outcomes of candidates, from where results are kept or from workers.

    seed: of what planning draws at random. computed: how many had to be computed. problems: of those that cannot be
    computed, by key.
    """

    workers: Workers
    results: Results
    sampling: Sampling
    seed: int = 0
    computed: int = 0
    problems: dict[str, tuple[Problem, ...]] = field(default_factory=dict)

    def compute(self, wanted: Sequence[Wanted], advance: Callable[[int], None], *, coverage: bool = False) -> None:
        """See to it that `outcome` finds every candidate; `advance` is told how many more are done.

        coverage: with their coverage. Raises InputError where results cannot be kept.
        """
        missing = {
            self._key(want.content, want.candidate, coverage=coverage): want
            for want in wanted
            if self.outcome(want, coverage=coverage) is None
        }
        advance(len(wanted) - len(missing))

        def keep(done: Done) -> None:
            job = done.job
            keys = [self._key(job.content, candidate, coverage=coverage) for candidate in job.candidates]
            for key, text in zip(keys, done.outcomes, strict=False):
                self.results.keep(key, text)
                self.computed += 1
            if done.problems:
                self.problems.update(dict.fromkeys(keys, done.problems))
            advance(len(keys))

        run_jobs(self.workers, list(self._jobs(list(missing.values()), coverage=coverage)), keep)

    def outcome(self, wanted: Wanted, *, coverage: bool = False) -> Outcome | None:
        """The outcome of a candidate, if there is one."""
        text = self.results.get(self._key(wanted.content, wanted.candidate, coverage=coverage))
        if text is None:
            return None
        try:
            return Outcome.from_text(text, wanted.candidate)
        except ValueError:  # a damaged file is as good as none
            return None

    def why_not(self, wanted: Wanted) -> tuple[Problem, ...]:
        """Why a candidate cannot be computed; empty where nothing is known to prevent it."""
        return self.problems.get(self._key(wanted.content, wanted.candidate, coverage=False), ())

    def _key(self, content: str, candidate: Candidate, *, coverage: bool) -> str:
        return candidate_key(content, candidate, self.sampling, self.seed, coverage=coverage)

    def _jobs(self, wanted: Sequence[Wanted], *, coverage: bool) -> Iterator[Job]:
        groups: dict[str, list[Wanted]] = {}
        for want in wanted:
            groups.setdefault(want.content, []).append(want)
        for content, members in groups.items():
            count = ceil(len(members) / self.workers.portion)
            for index in range(count):
                candidates = tuple(member.candidate for member in members[index::count])
                yield Job(members[0].workspace, content, candidates, self.sampling, self.seed, coverage)
