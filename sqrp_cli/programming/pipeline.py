"""All candidates of a task, assessed one after the other or in parallel processes, with the same results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, WaysFound, study
from sqrp_cli.programming.coverage.robustness import Calibration, under_calibration_errors
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.verdict import verdict
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way

WORTH_A_PROCESS, WORTH_WITH_WAYS = 8, 2
"""Least number of candidates per further process, and of those of which all ways are tried; fewer are not worth it."""


class Explained(NamedTuple):
    """A candidate with all that its figures were computed from."""

    ranked: Ranked
    """With the figures of the study."""
    study: Study | None
    """None if the candidate is infeasible."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """What is to be computed for each candidate."""

    cell: Cell
    world: World
    """That every candidate starts from."""
    sampling: Sampling
    calibration: Calibration | None = None
    """Accuracy of the cameras' calibration, to compute its influence on the qualities; None to leave it out."""
    wanted: WantedWay = WantedWay()  # noqa: RUF009 - it is frozen
    """Which way of each candidate."""

    def assess(self, candidate: Candidate) -> Assessment:
        """The figures of one candidate in the wanted way, or why it is infeasible."""
        found = find_way(self.cell, candidate, self.world, self.sampling, self.wanted)
        if isinstance(found, Infeasible):
            ways = WaysFound(tried=found.tried, feasible=0, pareto=())
            return Assessment.infeasible(candidate, found.reasons, verdict=found.reasons[0], ways=ways)
        study = found.study
        assessment = study.assessment(verdict(self.cell, study))
        assessment = replace(assessment, candidate=candidate, best_way=study.candidate, ways=found.ways)
        if self.calibration is None:
            return assessment
        recalibrated = under_calibration_errors(self.cell, study, self.sampling, self.calibration)
        return replace(assessment, recalibrated=recalibrated)

    def explain(self, ranked: Ranked) -> Explained:
        """A candidate with the full study of its way, and the figures from that."""
        if ranked.rank is None:
            return Explained(ranked, None)
        known = ranked.assessment
        found = study(self.cell, known.way, self.world, self.sampling, full=True)
        if isinstance(found, Infeasible):
            raise ValueError(f"{known.candidate.name} was feasible a moment ago")
        assessment = found.assessment(verdict(self.cell, found))
        assessment = replace(assessment, candidate=known.candidate, best_way=known.best_way, ways=known.ways)
        return Explained(replace(ranked, assessment=assessment), found)


def assess_all(assignment: Assignment, candidates: Sequence[Candidate], jobs: int) -> Iterator[Assessment]:
    """The assessments in the order of the candidates, each as soon as it and those before it are done.

    jobs: number of processes at most.
    """
    tried = not assignment.wanted.fastest and any(candidate.leaves_free for candidate in candidates)
    least = WORTH_WITH_WAYS if tried else WORTH_A_PROCESS
    assessments = _assessed(assignment, candidates, min(jobs, len(candidates) // least))
    for candidate, assessment in zip(candidates, assessments, strict=True):
        # A result from a process has its own copy of the skill; replace it by the caller's, which all share.
        way = assessment.best_way and replace(assessment.best_way, skill=candidate.skill)
        yield replace(assessment, candidate=candidate, best_way=way)


def _assessed(assignment: Assignment, candidates: Sequence[Candidate], processes: int) -> Iterator[Assessment]:
    if processes < 2:
        return map(assignment.assess, candidates)
    from sqrp_cli.platform.processes import in_processes

    return in_processes(assignment.assess, candidates, processes)
