"""All candidates of a task, assessed one after the other or in parallel processes, with the same results."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.assessment import Assessment, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.robustness import Calibration, under_calibration_errors
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.verdict import verdict

WORTH_A_PROCESS = 8
"""Candidates that another process should at least have to do; fewer are not worth starting it."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """What is to be computed for each candidate: in which cell and world, and how it is sampled.

    calibration: how exactly the cameras are calibrated, if what that does to the qualities is to be computed.
    """

    cell: Cell
    world: World
    sampling: Sampling
    calibration: Calibration | None = None

    def assess(self, candidate: Candidate) -> Assessment:
        """The figures of one candidate, or why it is infeasible."""
        result = study(self.cell, candidate, self.world, self.sampling, full=False)
        if isinstance(result, Infeasible):
            return Assessment(candidate, feasible=False, reasons=result.reasons, verdict=result.reasons[0])
        assessment = result.assessment(verdict(self.cell, result))
        if self.calibration is None:
            return assessment
        recalibrated = under_calibration_errors(self.cell, result, self.sampling, self.calibration)
        return replace(assessment, recalibrated=recalibrated)


def assess_all(assignment: Assignment, candidates: Sequence[Candidate], jobs: int) -> Iterator[Assessment]:
    """The assessments in the order of the candidates, each as soon as it and those before it are done.

    jobs: number of processes at most. Processes are forked, so that they share what is loaded; where the platform
    cannot fork, one does all.
    """
    processes = min(jobs, len(candidates) // WORTH_A_PROCESS)
    if processes < 2 or "fork" not in multiprocessing.get_all_start_methods():
        yield from map(assignment.assess, candidates)
        return
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(processes, context, initializer=_start_worker, initargs=(assignment, candidates)) as pool:
        try:
            for candidate, assessment in zip(
                candidates, pool.map(_assess_in_worker, range(len(candidates))), strict=True
            ):
                # What came back carries its own copy of the skill; the caller's is shared by all.
                yield replace(assessment, candidate=candidate)
        finally:
            pool.shutdown(cancel_futures=True)


_inherited: list[tuple[Assignment, Sequence[Candidate]]] = []
"""In a worker: what it was forked with."""


def _start_worker(assignment: Assignment, candidates: Sequence[Candidate]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which prints what is finished
    _inherited.append((assignment, candidates))


def _assess_in_worker(index: int) -> Assessment:
    assignment, candidates = _inherited[0]
    return assignment.assess(candidates[index])
