"""How a step's own clock comes to a halt: time slows down along the path, from whatever rate it passes at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.trajectory import PiecewiseCubic

_RAMP = 0.4
"""Share of a stop in which the deceleration goes to its peak, and as much in which it falls to zero."""

_ON = PiecewiseCubic(np.array([0.0, 1.0]), np.array([[0.0, 1.0, 0.0, 0.0]]))
"""A clock that goes on at its usual rate."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A stop that begins at a time t [s], when the step's own clock shows tau [s], and lasts for a duration [s].

    law: the clock, less tau, over the time since t, both as shares of the duration. last: what the clock never passes
    [s].
    protective: whether it may go to the limits of a protective stop.
    """

    t: float
    tau: float
    duration: float
    last: float
    law: PiecewiseCubic
    protective: bool

    @classmethod
    def at_the_end(cls, t: float, tau: float, last: float, *, protective: bool) -> Stop:
        """The clock goes on as it would, up to `last`."""
        return cls(t, tau, max(last - tau, 0.0), last, _ON, protective)

    @property
    def stands(self) -> float:
        """When the arm stands [s]."""
        return self.t + self.duration

    @property
    def rests_at(self) -> float:
        """What the step's own clock shows then [s]."""
        return min(self.tau + self.duration * float(self.law.positions(1.0)), self.last)

    def clock(self, t: Array) -> tuple[Array, Array, Array]:
        """The step's own clock [s] at times t [s] of the stop, its rate and the change of its rate [1/s], (m,) each."""
        if not self.duration:
            return np.full_like(t, self.tau), np.ones_like(t), np.zeros_like(t)
        clock, rate, change, _ = self.law.derivatives((t - self.t) / self.duration)
        return np.minimum(self.tau + self.duration * clock, self.last), rate, change / self.duration


def slowing(rate: float, change: float) -> PiecewiseCubic:
    """The law of a clock whose rate falls to 0, with a trapezoidal deceleration that is continuous with what was.

    rate: at which the clock passes before, 1 where no stop has begun. change: of that rate, not above 0, over the
    whole stop. The deceleration goes from -change to the peak p at which all of the rate is lost, stays there, and
    falls to 0.
    """
    begin, ramp = -change, _RAMP
    peak = (rate - begin * ramp / 2) / (1.0 - ramp)
    second = rate - (begin + peak) * ramp / 2
    third = peak * ramp / 2
    rising = [0.0, rate, -begin / 2, -(peak - begin) / (6 * ramp)]
    after = rising[0] + ramp * (rising[1] + ramp * (rising[2] + ramp * rising[3]))
    steady = 1.0 - 2 * ramp
    later = after + steady * (second - steady * peak / 2)
    return PiecewiseCubic(
        np.array([0.0, ramp, 1.0 - ramp, 1.0]),
        np.array([rising, [after, second, -peak / 2, 0.0], [later, third, -peak / 2, peak / (6 * ramp)]]),
    )
