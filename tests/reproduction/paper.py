"""What the paper reports, in its section on performance evaluation. Nothing of it enters a computation."""

from __future__ import annotations

from typing import NamedTuple


class Figures(NamedTuple):
    """Qualities [%] and duration [s] of a candidate, of the paper or of ours."""

    q_avg: float
    q_eoi: float
    time: float


SIMULATION = {
    "g1": Figures(67.80, 0.0, 23.81),
    "g2": Figures(80.25, 100.0, 13.83),
    "g3": Figures(83.87, 66.12, 19.62),
    "g4": Figures(79.88, 55.41, 18.78),
    "g5": Figures(36.67, 100.0, 23.89),
}
"""Six cameras and a suction cup, 10 samples per primitive; g6 is out of reach."""

Q_AVG_BY_SAMPLES = {"5": "57.5", **dict.fromkeys(("10", "20", "40"), "67.6 to 67.9")}
"""Q_avg of g1 [%] against samples per primitive, as far as text and figure give it."""

COMPUTING_BY_SAMPLES = {"5": "0.388", "40": "1.31"}
"""Time to compute Q_avg of g1 [s] against samples per primitive, on the authors' machine."""

REAL_WORLD = {"red1": Figures(92.27, 100.0, 28.47), "red2": Figures(11.19, 0.0, 28.34)}
"""Four cameras and a two-finger gripper, a sample every second."""

RETRY_EARLIER = 13.0
"""By how much picking red1 finishes earlier than picking red2 after a slip and a retry [s]."""
