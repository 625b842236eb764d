"""Detection delay of faults, and its cost in time, on the nominal motion: by images, over all phases of the cameras."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.image_time import Onset, Window, Windows, delays
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.motion.stop_and_return import Recovery

_PROMPT = 1e-3
"""Times and shares up to this explain no delay [s, 1]."""


def fault_metrics(windows: Windows, onsets: Sequence[Onset], recovery: Recovery, total: float) -> FaultMetrics:
    """The metrics of a fault that may happen at any time of its intervals, on a motion of duration `total` [s].

    windows: in which images show it. onsets: of each interval. Means and shares are over all the time of the intervals
    together, the rest is the largest of any of them.
    """
    parts = [interval_metrics(windows, onset, recovery, total) for onset in onsets]
    lengths = [float(onset.x[-1] - onset.x[0]) for onset in onsets]
    length = sum(lengths)
    weights = [one / length if length > 0 else 1.0 / len(parts) for one in lengths]

    def mean(values: Iterable[float]) -> float:
        return float(sum(weight * value for weight, value in zip(weights, values, strict=True)))

    return FaultMetrics(
        delay_mean=mean(part.delay_mean for part in parts),
        delay_worst=max(part.delay_worst for part in parts),
        blind_longest=max(part.blind_longest for part in parts),
        unseen=mean(part.unseen for part in parts),
        expected_time=mean(part.expected_time for part in parts),
    )


def why_late(fault: FaultMetrics, windows: Windows, onsets: Sequence[Onset]) -> str:
    """What takes so long until a fault is noticed, at worst; see `fault_metrics`."""
    if not windows.usual:
        return "no image shows it"
    if fault.blind_longest > _PROMPT:
        return f"no image shows it for up to {fault.blind_longest:.2f} s"
    if fault.unseen > _PROMPT:
        return "of what happens last, no image tells before the end"
    parting = max(float((onset.shown - onset.x).max()) for onset in onsets)
    if parting > _PROMPT:
        return f"tool and part have to part for up to {parting:.2f} s before an image shows it"
    return "so long take a frame and the latency of the camera that sees it"


def interval_metrics(windows: Windows, onset: Onset, recovery: Recovery, total: float) -> FaultMetrics:
    """The metrics of a fault that may happen at any x of `onset`, on a motion of duration `total` [s].

    It is noticed by the first image that shows it, or else at the end. expected_time = mean of the time at which it is
    noticed + stop + move back to the start + `total`.
    """

    def done(noticed: Array) -> Array:
        return noticed + recovery.at(noticed) + total

    found = delays(windows, onset, total, done, recovery.t)
    return FaultMetrics(
        delay_mean=found.mean,
        delay_worst=found.worst,
        blind_longest=longest_gap(windows.sure, Stretch(float(onset.x[0]), float(onset.x[-1]))),
        unseen=found.unseen,
        expected_time=found.cost,
    )


def longest_gap(windows: Sequence[Window], interval: Stretch) -> float:
    """The longest stretch of an interval that no window contains [s]; windows are in order."""
    edges = [interval.start, *(edge for window in windows for edge in (window.start, window.end)), interval.end]
    within = np.clip(edges, interval.start, interval.end)
    return float((within[1::2] - within[::2]).max())
