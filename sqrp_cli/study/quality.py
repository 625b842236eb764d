"""The sensing quality of a candidate: how much of the time that matters is covered."""

from __future__ import annotations

import numpy as np

from sqrp_cli.figures import Qualities
from sqrp_cli.study.timeline import Timeline


def qualities_over(timeline: Timeline) -> Qualities:
    """Q_avg: total length of the runs of covered states over T, in 0..1; Q_eoi: the same within the events of interest.

    A run is a maximal sequence of consecutive covered samples inside one stretch of formula time; its length is last
    minus first (paper, section on sensing quality computation). Samples that share an instant add no length, so the sum
    over runs is the sum over neighbouring covered samples. None where no formula, or no event, applies for any time.
    """
    gaps, within = timeline.samples.gaps, timeline.covered[:-1] & timeline.covered[1:]
    within &= np.diff(timeline.samples.piece) == 0
    of_interest = within & timeline.of_interest[:-1]
    parts = ((gaps[within], timeline.request.T), (gaps[of_interest], timeline.request.T_eoi))
    # Rounding may add a little.
    return Qualities(*(min(float(part.sum()), T) / T if T > 0 else None for part, T in parts))
