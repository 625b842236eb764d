"""The figures of a candidate, first of all its sensing quality: how much of the time that matters is covered."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sqrp_cli.figures import FaultMetrics, Figures, Qualities
from sqrp_cli.study.timeline import Timeline


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


def qualities_over(timeline: Timeline) -> Qualities:
    """Both qualities of a timeline."""
    return Qualities(average_quality(timeline), interest_quality(timeline))


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
