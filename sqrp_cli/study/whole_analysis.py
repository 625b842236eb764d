"""A way of doing a task with all data behind its figures, step by step; most tasks have one step.

How the figures of the whole follow from those of its steps is on the page of numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import Qualities
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.study.analysis import SUMMED, Analysis, planned_motion, with_delays
from sqrp_cli.study.program_update import world_after
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.timeline import PlannedMotion, Timeline, observe
from sqrp_cli.task.candidate import Candidate, whole_candidate
from sqrp_cli.task.feasibility import feasible_motion

if TYPE_CHECKING:
    from sqrp_cli.program.record import Step


def reasons_of_step(candidate: Candidate, number: int, reasons: Sequence[str]) -> tuple[str, ...]:
    """Why a candidate cannot be done because one of its steps cannot; number: of the step, from 1."""
    if not candidate.steps:
        return tuple(reasons)
    return tuple(f"step {number}, {candidate.steps[number - 1].task}: {reason}" for reason in reasons)


def result_of_steps(candidate: Candidate, done: Sequence[CandidateResult]) -> CandidateResult:
    """The figures of a candidate over all its steps, or why the last of them is infeasible.

    done: the steps in order, up to the first infeasible one.
    """
    last = done[-1]
    if not last.feasible:
        reasons = reasons_of_step(candidate, len(done), last.reasons)
        return replace(CandidateResult.infeasible(candidate, reasons, reasons[0]), steps=tuple(done))
    times = [one.time or 0.0 for one in done]
    seen = mean_qualities((one, one.t_total, one.t_eoi) for one in done)
    # The worst seen first; where all miss nothing, one stands for all.
    numbered = sorted(enumerate(done, 1), key=lambda pair: _worth(pair[1]))
    missing = [(f"Step {n}, {one.candidate.task}: ", one) for n, one in numbered if min(_worth(one)) < 1.0]
    (step, worst), *_ = said = missing or [("", done[0])]
    sums: dict[str, Any] = {k: sum(v for one in done if (v := getattr(one, k)) is not None) for k in SUMMED}
    return CandidateResult(
        candidate=candidate,
        feasible=True,
        **sums,
        q_avg=seen.q_avg,
        q_eoi=seen.q_eoi,
        q_expected=mean_quality([(one.q_expected, one.t_total) for one in done]),
        faults={
            f"{number}.{name}": fault
            if fault.expected_time is None
            else replace(fault, expected_time=fault.expected_time + sum(times) - times[number - 1])
            for number, one in enumerate(done, 1)
            for name, fault in one.faults.items()
        },
        retried=tuple(f"{number}.{name}" for number, one in enumerate(done, 1) for name in one.retried),
        error=max((one.error for one in done if one.error is not None), default=None),
        largest_gap=max((one.largest_gap for one in done if one.largest_gap is not None), default=None),
        remarks=tuple(f"{n}.{text}" for n, one in enumerate(done, 1) for text in one.remarks),
        verdict=" ".join(f"{step}{one.verdict}" for step, one in said),
        blind_spot=f"{step}{worst.blind_spot}",
        remedy=worst.remedy,
        recalibrated=tuple(
            mean_qualities((drawn, one.t_total, one.t_eoi) for drawn, one in zip(draw, done, strict=True))
            for draw in zip(*(one.recalibrated for one in done), strict=True)
        ),
        best_way=whole_candidate(candidate.skill, [one.way for one in done]),
        steps=tuple(done),
    )


def worst_seen(steps: Sequence[Qualities] | Sequence[Step]) -> int:
    """The index of the step that is seen worst, by Q_eoi, then Q_avg; of several the first."""
    return min(range(len(steps)), key=lambda index: _worth(steps[index]))


def world_left(cell: Cell, result: CandidateResult, world: World) -> World | None:
    """The world that a candidate leaves which begins in another one; None if it cannot be done."""
    if not result.feasible:
        return None
    motion = feasible_motion(cell, result.way, world)
    return None if isinstance(motion, Infeasible) else world_after(result.way, motion, world)


def mean_quality(parts: Iterable[tuple[float | None, float | None]]) -> float | None:
    """The mean of qualities, each weighted by the time that it is about; None where there is no such time."""
    known = [(quality, time) for quality, time in parts if quality is not None and time]
    total = sum(time for _, time in known)
    return min(1.0, sum(quality * time for quality, time in known) / total) if known else None


def mean_qualities(steps: Iterable[tuple[Qualities, float | None, float | None]]) -> Qualities:
    """The qualities of the whole from those of its steps, each with the times T and T_eoi that it is about [s]."""
    known = list(steps)
    q_avg, q_eoi = [(one.q_avg, T) for one, T, _ in known], [(one.q_eoi, T_eoi) for one, _, T_eoi in known]
    return Qualities(mean_quality(q_avg), mean_quality(q_eoi))


def _worth(seen: Qualities | Step) -> tuple[float, ...]:
    return tuple(1.0 if quality is None else quality for quality in (seen.q_eoi, seen.q_avg))


@dataclass(frozen=True, eq=False)
class WholeAnalysis:
    """A feasible way with the analysis of each of its steps, in the world that those before it leave."""

    candidate: Candidate  # The way, of one step or several
    steps: tuple[Analysis, ...]  # At least one

    @property
    def result(self) -> CandidateResult:
        """The figures of the whole, without a verdict."""
        each = [step.result for step in self.steps]
        return result_of_steps(self.candidate, each) if self.candidate.steps else each[0]


def whole_analysis(
    cell: Cell, way: Candidate, world: World, sampling: Sampling, *, full: bool
) -> WholeAnalysis | Infeasible:
    """Study a way that starts in `world`, of one step or several; see `analyse`."""
    observed = whole_observed(cell, way, world, sampling, full=full)
    if isinstance(observed, Infeasible):
        return observed
    return WholeAnalysis(way, tuple(with_delays(cell, one, sampling) for one in observed))


def whole_observed(
    cell: Cell, way: Candidate, world: World, sampling: Sampling, *, full: bool
) -> tuple[Timeline, ...] | Infeasible:
    """The steps of `whole_analysis` without delays, which take as long as all the rest."""
    done: list[Timeline] = []
    for planned in planned_steps(cell, way.steps or (way,), world):
        if isinstance(planned, Infeasible):
            return Infeasible(reasons_of_step(way, len(done) + 1, planned.reasons), planned.tried)
        done.append(observe(planned, cell.observer, sampling, full=full))
    return tuple(done)


def planned_steps(cell: Cell, ways: Iterable[Candidate], world: World) -> Iterator[PlannedMotion | Infeasible]:
    """The motion of each way of a step, from the world that those before it leave; nothing after one that has none."""
    for way in ways:
        motion = feasible_motion(cell, way, world)
        if isinstance(motion, Infeasible):
            yield motion
            return
        yield planned_motion(cell, way, world, motion)
        world = world_after(way, motion, world)
