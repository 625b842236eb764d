"""A ranking under way: candidates are assessed in processes that end as soon as nobody needs the ranking."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sqrp_cli.api.session import Session
from sqrp_cli.errors import bad_input
from sqrp_cli.platform.processes import Worker, WorkerDied, forked
from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.programming.pipeline import Assignment, described
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.sensing.sight_memory import Seen, SightMemory
from sqrp_cli.studio.requests import Rank

LOWER_PRIORITY = 10
"""By how much processes that take longer are nicer than others."""


@dataclass(frozen=True)
class _Assessed:
    """The answer of a process."""

    assessment: CandidateResult
    seen: Sequence[Seen]
    """What it learnt of what cameras see."""


class RankingRun:
    """A ranking under way."""

    def __init__(self, asked: Rank, session: Session, jobs: int, memory: SightMemory) -> None:
        """jobs: processes at most. memory: of the session's cell; what the processes learn is added to it."""
        self.asked, self.session, self._memory = asked, session, memory
        candidates = session.task.candidates
        memory.learnt.clear()  # by this process, which need not be told; the others begin with what it knows
        self._left, self._found = deque(range(len(candidates))), dict[int, CandidateResult]()
        workers = [
            Worker(forked(), _assessor, session.assignment, candidates, memory)
            for _ in range(min(jobs, len(candidates)))
        ]
        self._workers: dict[Worker[int, _Assessed], int | None] = dict.fromkeys(workers)
        for worker in workers:
            self._hand_out(worker)

    @property
    def busy(self) -> list[Worker[int, _Assessed]]:
        """The processes that compute."""
        return [worker for worker, index in self._workers.items() if index is not None]

    @property
    def done(self) -> int:
        """How many candidates are assessed."""
        return len(self._found)

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.session.task.candidates)

    def take(self, worker: Worker[int, _Assessed]) -> None:
        """Take the answer of a busy process. Raises InputError where it was killed."""
        index = self._workers[worker]
        assert index is not None  # noqa: S101 - it is busy
        try:
            answer = worker.receive()
        except WorkerDied as error:
            raise bad_input("worker-died", "a process was killed; is there enough memory?") from error
        candidate, assessment = self.session.task.candidates[index], answer.assessment
        way = assessment.best_way and replace(assessment.best_way, skill=candidate.skill)
        self._found[index] = replace(assessment, candidate=candidate, best_way=way)
        for seen in answer.seen:
            self._memory.take(seen)
        self._hand_out(worker)

    def ranking(self) -> list[CandidateResult]:
        """All candidates, once they are assessed."""
        return [*map(described, rank([self._found[index] for index in range(self.count)], self.asked.by))]

    def end(self) -> None:
        """End all processes at once."""
        for worker in self._workers:
            worker.kill()

    def _hand_out(self, worker: Worker[int, _Assessed]) -> None:
        self._workers[worker] = index = self._left.popleft() if self._left else None
        if index is not None:
            worker.send(index)


def let_others_go_first() -> None:
    """Let browser and sketches go first, in a process that computes what takes longer."""
    os.nice(LOWER_PRIORITY)


def _assessor(
    assignment: Assignment, candidates: Sequence[Candidate], memory: SightMemory
) -> Callable[[int], _Assessed]:
    let_others_go_first()

    def assess(index: int) -> _Assessed:
        memory.learnt.clear()
        return _Assessed(assignment.assess(candidates[index]), memory.learnt)

    return assess
