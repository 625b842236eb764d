"""The figures of a candidate, first of all its sensing quality: how much of the time that matters is covered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf

import numpy as np

from sqrp_cli.geometry import check_finite
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.coverage.timeline import Timeline


@dataclass(frozen=True, eq=False, kw_only=True)
class Figures:
    """The figures of a candidate, in the order in which documents have them.

    All are None, and `faults` is empty, where it is infeasible.
    """

    time: float | None
    """Duration of the whole motion [s]."""
    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""
    t_total: float | None
    """T, the time that formulas monitor [s]."""
    t_eoi: float | None
    """T_eoi, the time of the events of interest [s]."""
    faults: Mapping[str, FaultMetrics]
    """By the fault's name."""
    states: int | None
    """Samples that hold literals."""

    @property
    def unseen(self) -> float | None:
        """The largest share of times after which a fault may never be noticed, in 0..1; None without faults."""
        return max((fault.unseen for fault in self.faults.values()), default=None)

    @property
    def latest(self) -> float | None:
        """The longest time until a fault is noticed [s]: infinite where one may never be, None without faults."""
        worst = [inf if fault.delay_worst is None else fault.delay_worst for fault in self.faults.values()]
        return max(worst, default=None)

    @property
    def delay_worst(self) -> float | None:
        """The same; None where a fault may never be noticed."""
        return None if self.latest == inf else self.latest

    def __post_init__(self) -> None:
        """Raises ValueError if a figure is not finite, also one of a subclass."""
        check_finite("the candidate", *(value for value in vars(self).values() if isinstance(value, float)))


NO_FIGURES = Figures(**{part.name: {} if part.name == "faults" else None for part in fields(Figures)})  # type: ignore[arg-type]
"""Those of an infeasible candidate."""

ROUNDING = 1e-9
"""By how much a quality may fall short of a threshold: sums of times are rounded."""


def falls_short(quality: float, least: float) -> bool:
    """Whether a quality is below a threshold."""
    return quality < least - ROUNDING


def figures_of(timeline: Timeline, time: float, faults: Mapping[str, FaultMetrics]) -> Figures:
    """The figures of a motion that takes `time` [s]."""
    return Figures(
        time=time,
        q_avg=average_quality(timeline),
        q_eoi=interest_quality(timeline),
        t_total=timeline.T,
        t_eoi=timeline.T_eoi,
        faults=faults,
        states=int(timeline.monitored.sum()),
    )


@dataclass(frozen=True)
class Qualities:
    """Q_avg and Q_eoi in 0..1, None where undefined."""

    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""

    def __post_init__(self) -> None:
        """Raises ValueError if a quality is not finite."""
        check_finite("the quality", self.q_avg, self.q_eoi)

    @classmethod
    def of(cls, timeline: Timeline) -> Qualities:
        """Both qualities of a timeline."""
        return cls(average_quality(timeline), interest_quality(timeline))


def average_quality(timeline: Timeline) -> float | None:
    """Q_avg: total length of the runs of covered states over T, in 0..1; None where no formula applies for any time.

    A run is a maximal sequence of consecutive covered samples inside one stretch of formula time; its length is last
    minus first (paper, section on sensing quality computation). Samples that share an instant add no length, so the sum
    over runs is the sum over neighbouring covered samples.
    """
    return _covered_length(timeline, interesting_only=False) / timeline.T if timeline.T > 0 else None


def interest_quality(timeline: Timeline) -> float | None:
    """Q_eoi: the same within the events of interest, over T_eoi; None where there are none."""
    return _covered_length(timeline, interesting_only=True) / timeline.T_eoi if timeline.T_eoi > 0 else None


def _covered_length(timeline: Timeline, *, interesting_only: bool) -> float:
    covered = timeline.covered & timeline.interesting if interesting_only else timeline.covered
    within = covered[:-1] & covered[1:] & ~np.isnan(timeline.steps)
    covered_length = float(timeline.steps[within].sum())
    return min(covered_length, timeline.T_eoi if interesting_only else timeline.T)  # rounding may add a little
