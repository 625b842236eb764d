"""Sensing quality: the share of the monitored time that the cameras cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import check_finite
from sqrp_cli.programming.coverage.timeline import Timeline


@dataclass(frozen=True)
class Qualities:
    """Q_avg and Q_eoi in 0..1, None where undefined."""

    q_avg: float | None
    q_eoi: float | None

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
