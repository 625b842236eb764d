"""From a candidate to its result: assessed in its best way, or explained with the analysis behind its figures.

All candidates of a task are assessed one after the other or in parallel processes, with the same results.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.find import Plans, WantedWay, find_way
from sqrp_cli.study.ranking import winners
from sqrp_cli.study.result import (
    CandidateResult,
    Criterion,
    Recalibrated,
    RecalibratedCandidate,
    SamplingDone,
    WaysFound,
)
from sqrp_cli.study.robustness import DRAWS, Calibration, expected_quality, under_calibration_errors
from sqrp_cli.study.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.study.verdict import with_verdict
from sqrp_cli.study.whole_analysis import result_of_steps, whole_analysis, whole_observed, world_left
from sqrp_cli.task.grips import choice_in_words, way_in_words
from sqrp_cli.task.task import Candidate, in_words

WORTH_A_PROCESS, WORTH_WITH_WAYS = 8, 2
"""Least number of candidates per further process, and of those of which all ways are tried; fewer are not worth it."""


class Explained(NamedTuple):
    """A candidate with all that its figures were computed from."""

    result: CandidateResult  # With the figures of its analysis, or of those of its steps
    analysis: Analysis | None = None  # Of a feasible candidate of one step
    steps: tuple[Explained, ...] = ()  # Of a feasible candidate of several steps, each


_Known = dict[tuple[str, ...], tuple[CandidateResult, World | None]]
"""Steps in their best ways, and the worlds that they leave; None of an infeasible one."""
_known: WeakKeyDictionary[World, WeakKeyDictionary[Cell, _Known]] = WeakKeyDictionary()
"""Steps that several candidates share, by the world that they start from."""


@dataclass(frozen=True, eq=False)
class RankJob:
    """What is to be computed for each candidate from one world of a cell."""

    sampling: Sampling = Adaptive()
    calibration: Calibration | None = None
    """Accuracy of the cameras' calibration, to compute its influence on the qualities; None to leave it out."""
    wanted: WantedWay = WantedWay()  # Which way of each candidate
    cell: Cell = field(kw_only=True)
    world: World = field(kw_only=True)  # That every candidate starts from
    plans: Plans | None = None  # The motions of candidates in this world, if they are to be kept for other cameras
    verdicts: bool = True  # Whether `assess` gives a verdict on each; where few are shown, `add_verdict` gives theirs

    def assess(self, candidate: Candidate) -> CandidateResult:
        """The figures of one candidate in the wanted way, or why it is infeasible."""
        if candidate.steps:
            return result_of_steps(candidate, [step for step, _ in self.steps_done(candidate)])
        found = find_way(self.cell, candidate, self.world, self.sampling, self.wanted, self.plans)
        if isinstance(found, Infeasible):
            ways = WaysFound(tried=found.tried, feasible=0, pareto=())
            return CandidateResult.infeasible(candidate, found.reasons, verdict=found.reasons[0], ways=ways)
        analysis, errors = found.analysis, self.calibration
        result = replace(
            found.result,
            candidate=candidate,
            best_way=analysis.planned.candidate,
            q_expected=expected_quality(self.cell, analysis),
            recalibrated=() if errors is None else under_calibration_errors(self.cell, analysis, self.sampling, errors),
        )
        return with_verdict(self.cell, analysis.timeline, result) if self.verdicts else result

    def add_verdict(self, known: CandidateResult) -> CandidateResult:
        """A feasible result with the verdict that `assess` left out."""
        seen = whole_observed(self.cell, known.way, self.world, self.sampling, full=False)
        if isinstance(seen, Infeasible):
            raise ValueError(f"{known.candidate.name} was feasible a moment ago")
        steps = [with_verdict(self.cell, *pair) for pair in zip(seen, known.steps or (known,), strict=True)]
        said = result_of_steps(known.candidate, steps) if known.steps else steps[0]
        return replace(known, verdict=said.verdict, blind_spot=said.blind_spot, remedy=said.remedy)

    def steps_done(self, candidate: Candidate) -> list[tuple[CandidateResult, World]]:
        """The steps of a candidate of several, each in its wanted way, with the world that those before it leave.

        The last is the first infeasible one, if any is. Steps that candidates share are assessed once.
        """
        asked = [repr(one) for one in (self.sampling, self.calibration, self.wanted, self.verdicts)]
        done: list[tuple[CandidateResult, World]] = []
        world: World | None = self.world
        for step in candidate.steps:
            if world is None:
                break
            key = (step.skill.name, repr(step.all_parameters), *asked)
            known = _known.setdefault(world, WeakKeyDictionary()).setdefault(self.cell, {})
            if key not in known:
                found = replace(self, world=world, plans=None).assess(step)
                known[key] = found, world_left(self.cell, found, world)
            result, after = known[key]
            done.append((result, world))
            world = after
        return done

    def explain(self, known: CandidateResult) -> Explained:
        """A candidate with the full analysis of each of its steps, and the figures from these."""
        if not known.feasible:
            return Explained(described(known))
        found = whole_analysis(self.cell, known.way, self.world, self.sampling, full=True)
        if isinstance(found, Infeasible):
            raise ValueError(f"{known.candidate.name} was feasible a moment ago")
        parts = [replace(step, rank=1, pareto=True) for step in known.steps] or [known]
        steps = list[Explained]()
        for one, analysis in zip(parts, found.steps, strict=True):
            judged = with_verdict(self.cell, analysis.timeline, analysis.result)
            judged = replace(judged, candidate=one.candidate, q_expected=expected_quality(self.cell, analysis))
            steps.append(Explained(_as_ranked(judged, one), analysis))
        if not known.steps:
            return steps[0]
        whole = result_of_steps(known.candidate, [step.result for step in steps])
        return Explained(_as_ranked(whole, known), steps=tuple(steps))


def _as_ranked(found: CandidateResult, known: CandidateResult) -> CandidateResult:
    """A result in words, with the place and the ways of the known one."""
    ranked = replace(found, best_way=known.best_way, rank=known.rank, pareto=known.pareto, ways=known.ways)
    return described(ranked)


def described(one: CandidateResult) -> CandidateResult:
    """A result with all that is said of it in words, as documents have it; also its steps and its ways."""
    candidate, way = one.candidate, one.way
    words = in_words(candidate.skill, candidate.all_parameters)
    happens = candidate.skill.fault_words if one.feasible else {}
    for fault in one.faults.keys() - happens.keys() if one.feasible and not one.steps else ():  # of a later grasp
        first = str(candidate.skill.of_fault(fault).name)
        happens[fault] = f"{happens[first]} (grasp {fault.removeprefix(first)})"
    remarks = [candidate.skill.in_pieces(said) for said in one.remarks]
    ways = one.ways and replace(
        one.ways,
        pareto=tuple(
            replace(found, words=way_in_words(candidate.skill, candidate.parameters, found.parameters))
            for found in one.ways.pareto
        ),
    )
    steps = [replace(described(step), task=step.candidate.task, parameters=step.way.parameters) for step in one.steps]
    if steps:
        remarks = [f"step {number}: {said}" for number, step in enumerate(steps, 1) for said in step.remarks]
    for number, step in enumerate(steps, 1):
        happens |= {f"{number}.{name}": f"{said} (step {number})" for name, said in step.happens.items()}
    return replace(
        one,
        parameters=candidate.parameters,
        name=candidate.name,
        objects=dict(candidate.binding),
        settings={name: value for name, value in words.items() if name not in candidate.binding},
        choice=choice_in_words(candidate, way) if one.feasible else "",
        happens=happens,
        remarks=tuple(remarks),
        why=tuple(map(candidate.skill.in_pieces, one.reasons)),
        ways=ways,
        steps=tuple(steps),
    )


def recalibrated(results: Sequence[CandidateResult], by: Criterion, calibration: Calibration) -> Recalibrated:
    """How often each candidate is first among draws of camera poses, and the spread of its qualities.

    results: of all candidates, with the qualities of each draw, in the order of the task: of equal ones the first wins.
    """
    feasible = [one for one in results if one.feasible]
    firsts, found = winners(feasible, by), []
    for one in feasible:
        spans: dict[str, list[float] | None] = {}  # the 5th and 95th percentile of each quality
        for name in ("q_avg", "q_eoi"):
            drawn = [getattr(quality, name) for quality in one.recalibrated]
            spans[name] = None if not drawn or None in drawn else np.percentile(drawn, [5, 95]).tolist()
        parameters, first = one.candidate.parameters, firsts[one.candidate.name]
        found.append(RecalibratedCandidate(parameters=parameters, first=first, **spans))
    return Recalibrated(
        position=calibration.position,
        rotation=calibration.rotation,
        seed=calibration.seed,
        draws=DRAWS,
        candidates=tuple(found),
    )


def sampling_done(sampling: Sampling, results: Sequence[CandidateResult]) -> SamplingDone:
    """How the motions of some candidates were sampled; errors and gaps are the largest of all."""
    error = max((one.error for one in results if one.error is not None), default=None)
    gap = max((one.largest_gap for one in results if one.largest_gap is not None), default=None)
    match sampling:
        case FixedCount(samples):
            return SamplingDone(mode="samples", samples=samples, error=error, max_gap=gap)
        case FixedStep(dt):
            return SamplingDone(mode="dt", dt=dt, error=error, max_gap=gap)
        case Adaptive(tolerance):
            return SamplingDone(mode="adaptive", tolerance=tolerance, max_motion=MAX_MOTION, error=error, max_gap=gap)


def assess_all(job: RankJob, candidates: Sequence[Candidate], jobs: int) -> Iterator[CandidateResult]:
    """The results in the order of the candidates, each as soon as it and those before it are done.

    jobs: number of processes at most.
    """
    fastest = job.wanted.fastest
    tried = not fastest and any(candidate.leaves_free for candidate in candidates)
    processes = min(jobs, len(candidates) // (WORTH_WITH_WAYS if tried else WORTH_A_PROCESS))
    results: Iterable[CandidateResult] = map(job.assess, candidates)
    if processes > 1:
        from sqrp_cli.platform.processes import in_processes

        results = in_processes(job.assess, candidates, processes)
    yield from map(shared, candidates, results)


def shared(candidate: Candidate, result: CandidateResult) -> CandidateResult:
    """The result of a candidate, of which a process has given a copy: with the caller's skill, which all share."""
    way = result.best_way and replace(result.best_way, skill=candidate.skill)
    return replace(result, candidate=candidate, best_way=way)
