"""Computing candidates, each once: kept results are not computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.scoring.work.cluster import Cluster, DaskWorkers
from sqrp_cli.scoring.work.dispatcher import Dispatcher, Done, LocalWorkers, Workers
from sqrp_cli.scoring.work.identity import candidate_key
from sqrp_cli.scoring.work.job import Job, PackedWorkspace
from sqrp_cli.scoring.work.results import Outcome, Results


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
    """A computer with these means; at Ctrl-C it first finishes and keeps what is under way.

    Raises InputError for a folder that cannot be used.
    """
    workers = LocalWorkers(means.jobs) if means.cluster is None else DaskWorkers(means.cluster)
    with closing(workers), closing(Results(means.out)) as results:
        computer = Computer(workers, results, means.sampling, means.seed)
        try:
            yield computer
        except KeyboardInterrupt:
            computer.give_up()
            raise


@dataclass(frozen=True, eq=False)
class Wanted:
    """A request for the figures of a candidate."""

    workspace: Workspace
    content: str
    """Digest of the workspace, see `identity.content_digest`."""
    candidate: Candidate


class Computer:
    """Gets outcomes of candidates, from kept results or from workers.

    computed, failed: how many were computed, and how many could not be.
    """

    def __init__(self, workers: Workers, results: Results, sampling: Sampling, seed: int = 0) -> None:
        self.sampling = sampling
        self.computed = self.failed = 0
        self._seed = seed
        self._results = results
        self._dispatcher = Dispatcher(workers, self._keep)
        self._awaited: set[str] = set()  # keys of what is begun
        self._problems: dict[str, tuple[Problem, ...]] = {}  # of what cannot be computed, by key
        self._advance: Callable[[int], None] | None = None

    def begin(self, wanted: Sequence[Wanted], *, coverage: bool = False) -> None:
        """Let workers that are other processes begin with candidates of which there is no outcome; see `compute`."""
        missing: dict[str, Wanted] = {}
        for want in wanted:
            key = self._key(want.content, want.candidate, coverage=coverage)
            known = key in self._awaited or key in self._problems
            if not known and self._outcome(key, want.candidate) is None:
                missing[key] = want
        self._awaited.update(missing)
        by_workspace: dict[str, list[Wanted]] = {}
        for want in missing.values():
            by_workspace.setdefault(want.workspace.digest, []).append(want)
        for members in by_workspace.values():
            packed = PackedWorkspace.of(members[0].workspace)
            self._dispatcher.add(
                [Job(packed, one.content, (one.candidate,), self.sampling, self._seed, coverage) for one in members]
            )

    def compute(self, wanted: Sequence[Wanted], advance: Callable[[int], None], *, coverage: bool = False) -> None:
        """Make every candidate available to `outcome`; `advance` is called with the number of finished ones.

        coverage: with their coverage; each is then a way, which leaves nothing free. At Ctrl-C what is under way is
        finished and kept, then KeyboardInterrupt is raised. Raises InputError if results cannot be kept.
        """
        self.begin(wanted, coverage=coverage)
        advance(len(wanted) - len(self._awaited))
        self._advance = advance
        try:
            self._dispatcher.finish()
        except KeyboardInterrupt:
            self.give_up()
            raise
        finally:
            self._advance = None

    def give_up(self) -> None:
        """Begin nothing more, and keep what is under way."""
        self._dispatcher.give_up()
        self._awaited.clear()

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

    def _keep(self, done: Done) -> None:
        job = done.job
        keys = [self._key(job.content, candidate, coverage=job.coverage) for candidate in job.candidates]
        for key, text in zip(keys, done.outcomes, strict=False):
            self._results.keep(key, text)
            self.computed += 1
        if done.problems:
            self.failed += len(keys)
            self._problems.update(dict.fromkeys(keys, done.problems))
        self._awaited.difference_update(keys)
        if self._advance is not None:
            self._advance(len(keys))

    def _key(self, content: str, candidate: Candidate, *, coverage: bool) -> str:
        return candidate_key(content, candidate, self.sampling, self._seed, coverage=coverage)
