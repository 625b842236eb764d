"""Gains and losses of sight in dense samples, and whether a timeline knows of them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Mask
from sqrp_cli.study.stage import Samples
from sqrp_cli.study.timeline import Timeline


class Event(NamedTuple):
    """A time in which a box is seen between two in which it is not, or the other way round."""

    start: float
    end: float
    """[s]."""
    gained: bool
    """Whether it is seen then."""
    found: bool
    """Whether a sample says so."""

    @property
    def length(self) -> float:
        """[s]."""
        return self.end - self.start


def events_of(timeline: Timeline, samples: Samples, covered: Mask) -> list[Event]:
    """The events between changes of `covered`, the truth in dense samples; no event goes on where nothing is asked."""
    own, found = timeline.samples.t, []
    edges = np.flatnonzero(covered[1:] != covered[:-1])
    for first, last in pairwise(edges.tolist()):
        start, end = float(samples.t[first + 1]), float(samples.t[last])
        if np.diff(samples.t[first + 1 : last + 1]).max(initial=0.0) < 0.01:
            within = (own >= start) & (own <= end) & timeline.monitored
            known = bool((timeline.covered[within] == covered[first + 1]).any())
            found.append(Event(start, end, gained=bool(covered[first + 1]), found=known))
    return found
