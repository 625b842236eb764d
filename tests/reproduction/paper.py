"""What the paper reports, in its section on performance evaluation. Nothing of it enters a computation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reported:
    """Qualities [%] and duration [s] of a candidate."""

    q_avg: float
    q_eoi: float
    time: float


SIMULATION = {
    "g1": Reported(67.80, 0.0, 23.81),
    "g2": Reported(80.25, 100.0, 13.83),
    "g3": Reported(83.87, 66.12, 19.62),
    "g4": Reported(79.88, 55.41, 18.78),
    "g5": Reported(36.67, 100.0, 23.89),
}
"""Six cameras and a suction cup, 10 samples per primitive; g6 is out of reach."""

Q_AVG_BY_SAMPLES = {5: "57.5", 10: "67.6 to 67.9", 20: "67.6 to 67.9", 40: "67.6 to 67.9"}
"""Q_avg of g1 [%] against samples per primitive, as far as text and figure give it."""

COMPUTING_BY_SAMPLES = {5: 0.388, 40: 1.31}
"""Time to compute Q_avg of g1 [s] against samples per primitive, on the authors' machine."""

REAL_WORLD = {"red1": Reported(92.27, 100.0, 28.47), "red2": Reported(11.19, 0.0, 28.34)}
"""Four cameras and a two-finger gripper, a sample every second."""

RETRY_EARLIER = 13.0
"""By how much picking red1 finishes earlier than picking red2 after a slip and a retry [s]."""
