"""Computing what is asked of candidates, each once: what is kept already is not computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.scoring.identity import candidate_key
from sqrp_cli.scoring.job import Job
from sqrp_cli.scoring.outcome import Outcome
from sqrp_cli.scoring.results_folder import Results
from sqrp_cli.scoring.run_jobs import Done, run_jobs
from sqrp_cli.scoring.workers import Workers

CANDIDATES_PER_JOB = 4
"""Small enough that little is lost with a worker, large enough that sending costs little."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A candidate whose figures are wanted; content: digest of its workspace, see `identity.content_digest`."""

    workspace: Workspace
    content: str
    candidate: Candidate


@dataclass(eq=False)
class Computer:
    """Gets outcomes of candidates, from where results are kept or from workers.

    computed: how many had to be computed. problems: of those that cannot be computed, by key.
    """

    workers: Workers
    results: Results
    sampling: Sampling
    computed: int = 0
    problems: dict[str, tuple[Problem, ...]] = field(default_factory=dict)

    def compute(self, wanted: Sequence[Wanted], advance: Callable[[int], None], *, coverage: bool = False) -> None:
        """See to it that `outcome` finds every candidate; `advance` is told how many more are done.

        coverage: with their coverage. Raises InputError where results cannot be kept.
        """
        missing = {self._key(want, coverage): want for want in wanted if self.outcome(want, coverage=coverage) is None}
        advance(len(wanted) - len(missing))

        def keep(done: Done) -> None:
            job = done.job
            keys = [candidate_key(job.content, c, self.sampling, coverage=coverage) for c in job.candidates]
            for key, text in zip(keys, done.outcomes, strict=False):
                self.results.keep(key, text)
                self.computed += 1
            if done.problems:
                self.problems.update(dict.fromkeys(keys, done.problems))
            advance(len(keys))

        run_jobs(self.workers, list(self._jobs(list(missing.values()), coverage=coverage)), keep)

    def outcome(self, wanted: Wanted, *, coverage: bool = False) -> Outcome | None:
        """The outcome of a candidate, if there is one."""
        text = self.results.get(self._key(wanted, coverage))
        if text is None:
            return None
        try:
            return Outcome.from_text(text, wanted.candidate)
        except ValueError:  # a damaged file is as good as none
            return None

    def why_not(self, wanted: Wanted) -> tuple[Problem, ...]:
        """Why a candidate cannot be computed; empty where nothing is known to prevent it."""
        return self.problems.get(self._key(wanted, coverage=False), ())

    def _key(self, wanted: Wanted, coverage: bool) -> str:
        return candidate_key(wanted.content, wanted.candidate, self.sampling, coverage=coverage)

    def _jobs(self, wanted: Sequence[Wanted], *, coverage: bool) -> Iterator[Job]:
        groups: dict[str, list[Wanted]] = {}
        for want in wanted:
            groups.setdefault(want.content, []).append(want)
        for content, members in groups.items():
            for start in range(0, len(members), CANDIDATES_PER_JOB):
                candidates = tuple(member.candidate for member in members[start : start + CANDIDATES_PER_JOB])
                yield Job(members[0].workspace, content, candidates, self.sampling, coverage)
