"""`rank`: the candidates of a task, best first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sqrp_cli.document import LEFT_OUT, Record, TaskDocument
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.programming.coverage.assessment import Assessment, WaysFound
from sqrp_cli.programming.coverage.quality import Figures
from sqrp_cli.programming.coverage.robustness import DRAWS
from sqrp_cli.programming.coverage.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.ranking import Criterion, Ranked, winners


@dataclass(frozen=True, kw_only=True)
class CandidatePlace(Record):
    """A candidate and its place in the ranking."""

    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    feasible: bool
    """Whether the robot can do it."""
    rank: int | None
    """Place in the ranking from 1; null if it is infeasible."""
    reasons: tuple[str, ...]
    """Why it is infeasible, most useful first."""


@dataclass(frozen=True, kw_only=True)
class StepFigures(Figures):
    """The figures of one step of a candidate of several."""

    q_expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show all that must be seen, mean over T; left out where no detector has a curve."""
    task: str
    """The skill and its objects."""
    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name, of the way behind the figures."""
    feasible: bool
    """Whether the robot can do it after the steps before it."""
    verdict: str
    """Where it is blind, why, and what would help."""

    @classmethod
    def of(cls, found: Assessment) -> StepFigures:
        """The figures of a step."""
        return completed(cls, found, task=found.candidate.task, parameters=found.way.parameters)


@dataclass(frozen=True, kw_only=True)
class CandidateFigures(Figures, CandidatePlace):
    """The figures of a candidate; those of an infeasible one are null.

    A dataclass begins with the fields of its last base: here with the place, then come the figures.
    """

    pareto: bool
    """Whether no other candidate is at least as good in q_avg, q_eoi and time, and better in one."""
    verdict: str
    """Where it is blind, why, and what would help."""
    ways: WaysFound | None
    """The ways in which it can be done; its own figures are those of the first."""
    q_expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show all that must be seen, mean over T; left out where no detector has a curve."""
    steps: tuple[StepFigures, ...] | None = field(default=None, metadata=LEFT_OUT)
    """Of a task of several steps: the figures of each. Names of parameters and faults begin with the step's number."""

    @classmethod
    def of(cls, ranked: Ranked) -> CandidateFigures:
        """The figures of a candidate in a ranking."""
        found = ranked.assessment
        steps = tuple(map(StepFigures.of, found.steps)) or None
        return completed(cls, found, ranked, parameters=found.candidate.parameters, steps=steps)


@dataclass(frozen=True, kw_only=True)
class SamplingDone(Record):
    """How the motions were sampled."""

    mode: Literal["adaptive", "samples", "dt"]
    """How instants were chosen: adaptively, a number per primitive action, or at equal steps of time."""
    samples: int | None = field(default=None, metadata=LEFT_OUT)
    """Instants per primitive."""
    dt: float | None = field(default=None, metadata=LEFT_OUT)
    """Time between instants [s]."""
    tolerance: float | None = field(default=None, metadata=LEFT_OUT)
    """Error of Q that sampling may leave."""
    max_motion: float | None = field(default=None, metadata=LEFT_OUT)
    """How far anything moves between two instants [m]."""
    error: float | None
    """Largest remaining error of Q."""
    max_gap: float | None
    """Largest time between two instants at which something must be seen while something moves [s]. No gain or loss of
    sight that lasts as long is missed; shorter ones may be."""

    @classmethod
    def of(cls, sampling: Sampling, assessments: Sequence[Assessment]) -> SamplingDone:
        """How the motions of some candidates were sampled."""
        error = max((a.error for a in assessments if a.error is not None), default=None)
        gap = max((a.largest_gap for a in assessments if a.largest_gap is not None), default=None)
        match sampling:
            case FixedCount(samples):
                return cls(mode="samples", samples=samples, error=error, max_gap=gap)
            case FixedStep(dt):
                return cls(mode="dt", dt=dt, error=error, max_gap=gap)
            case Adaptive(tolerance):
                return cls(mode="adaptive", tolerance=tolerance, max_motion=MAX_MOTION, error=error, max_gap=gap)


@dataclass(frozen=True, kw_only=True)
class _Inexact(Record):
    """A candidate under inexact camera poses."""

    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    q_avg: list[float] | None
    """Least and most: 5th and 95th percentile of the draws, or what any pose gives; null where it is undefined."""
    q_eoi: list[float] | None
    """The same within the events of interest."""


@dataclass(frozen=True, kw_only=True)
class _PoseErrors(Record):
    """How inexact camera poses are."""

    position: float
    """Of each camera [m]: standard deviation along each axis, or the longest distance."""
    rotation: float
    """Of each camera [rad]: standard deviation about each axis, or the largest angle about any."""


@dataclass(frozen=True, kw_only=True)
class RecalibratedCandidate(_Inexact):
    """Effect of drawn camera poses on a candidate."""

    first: int
    """Draws of camera poses in which it is ranked first."""


@dataclass(frozen=True, kw_only=True)
class Recalibrated(_PoseErrors):
    """Effect of drawn camera poses."""

    seed: int
    """Of the random errors of camera poses."""
    draws: int
    """Number of random sets of camera poses."""
    candidates: tuple[RecalibratedCandidate, ...]
    """The feasible ones, in the order of the task."""

    @classmethod
    def of(cls, assignment: Assignment, assessments: Sequence[Assessment], by: Criterion) -> Recalibrated | None:
        """How often each candidate is first, and the spread of its qualities; None if not requested."""
        calibration = assignment.calibration
        if calibration is None:
            return None
        first = winners(assessments, by)
        return completed(
            cls,
            calibration,
            draws=DRAWS,
            candidates=tuple(
                RecalibratedCandidate(
                    parameters=assessment.candidate.parameters,
                    first=first[assessment.candidate.name],
                    q_avg=percentiles([q.q_avg for q in assessment.recalibrated]),
                    q_eoi=percentiles([q.q_eoi for q in assessment.recalibrated]),
                )
                for assessment in assessments
                if assessment.feasible
            ),
        )


def percentiles(values: Sequence[float | None]) -> list[float] | None:
    """The 5th and 95th percentile, None where a value is undefined."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    return [float(value) for value in np.percentile(known, [5, 95])]


@dataclass(frozen=True, kw_only=True, repr=False)
class RankDocument(TaskDocument):
    """What `sqrp rank` finds."""

    document: Literal["rank"] = "rank"
    by: Criterion
    """What counts first."""
    sampling: SamplingDone
    """How the motions were sampled; errors and gaps are the largest of all candidates."""
    calibration: Recalibrated | None = field(default=None, metadata=LEFT_OUT)
    """With `--calibration`."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all candidates were finished."""
    candidates: tuple[CandidateFigures, ...]
    """Best first, infeasible ones last."""
