"""When images show what happens, over all phases of the cameras.

A camera takes an image every period, at a phase that nobody chooses. Cameras of one rate take theirs together, those of
different rates independently. What lies in a *window* is seen if an image falls into it. Times are piecewise linear in
the phase, so that suprema lie at the ends of pieces and, of one rate, means over the phase are sums over pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from sqrp_cli.records import dataclass

Array = NDArray[np.float64]
_GAUSS = np.array([0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5])
"""Of a piece, the two places whose mean is that of any polynomial up to the third degree over it."""
_LATTICE = 512  # Combinations of phases of several rates
_NARROW = 1e-9  # Pieces of the phase narrower than this share of a period do not count, nor shares of x
_AT_ONCE = 100_000  # pairs of times and pieces of phases that are compared at once, for the memory
Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True, order=True)
class Window:
    """A time in which every image of some cameras shows something, such as a fault."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012 - for files and the JSON Schema

    start: Seconds
    """From the start of the motion [s]."""
    end: Seconds
    """From the start of the motion [s]."""
    period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Between two images [s]."""
    lag: Seconds
    """From an image until what it shows is known [s]."""


@dataclass(frozen=True, eq=False)
class Onset:
    """From when on images show what happens at a time x, at points in order; linear in between."""

    x: Array  # When it happens, shape (n,), n >= 2 [s]
    shown: Array  # From when on images surely show it, shape (n,), never falling [s]
    usual: Array | None = None
    """From when on they usually do, shape (n,), never falling, not after `shown` [s]; None if that is the same."""

    @property
    def as_usual(self) -> Onset:
        """The onset whose images show it when they usually do."""
        return self if self.usual is None else Onset(self.x, self.usual)

    @classmethod
    def at_once(cls, start: float, end: float) -> Onset:
        """What images show from the moment at which it happens, between two times [s]."""
        return cls(np.array([start, end]), np.array([start, end]))


@dataclass(frozen=True)
class Delays:
    """How long after x something that happens at x is noticed, x uniform, over all phases."""

    mean: float | None  # Over the x after which an image shows it [s]; None without any
    worst: float | None  # The supremum [s]; None where `unseen` is more than 0
    noticed: float  # Share of x, mean over the phases, after which an image usually shows it, in 0..1
    unseen: float  # Share of x, mean over the phases, after which no image is sure to show it, in 0..1
    cost: float | None  # Mean of a cost of the time at which it is noticed; None where `unseen` is more than 0


def delays(windows: Sequence[Window], onset: Onset, cost: Callable[[Array], Array], bends: Array) -> Delays:
    """The delays of something that happens at any x of `onset` and that images show in windows.

    Worst and unseen are by when they surely show it, the rest by when they usually do. cost: of being noticed at times,
    shape (n,) each, linear between `bends` [s]. Of one rate all is exact; of several, mean, unseen share and cost are
    means over 512 combinations of phases.
    """
    usual = _delays(windows, onset.as_usual, cost, bends)
    if onset.usual is None:
        return usual
    sure = _delays(windows, Onset(onset.x, onset.shown), cost, bends)
    return replace(usual, worst=sure.worst, unseen=sure.unseen, cost=None if sure.unseen else usual.cost)


def _delays(windows: Sequence[Window], onset: Onset, cost: Callable[[Array], Array], bends: Array) -> Delays:
    """As `delays`, of an onset whose images always show it at one time."""
    # What of windows can matter: up to a period after an image is known that surely shows what happens last.
    first, last = onset.shown[0], onset.shown[-1]
    sure = [(max(one.start, last) + one.period, one) for one in windows]
    horizon = min((t + one.lag + one.period for t, one in sure if t <= one.end), default=np.inf)
    clipped = (replace(one, start=max(one.start, first), end=min(one.end, horizon)) for one in windows)
    windows = [one for one in clipped if one.end > one.start]
    if not windows:
        return Delays(mean=None, worst=None, noticed=0.0, unseen=1.0, cost=None)
    # When each image is taken at p phases, shape (p, n) [s], and what share of all x it shows.
    phases, weight = _phases(windows, onset, bends)
    numbers = [np.arange(np.floor(w.start / w.period) - 1, np.floor(w.end / w.period) + 1) for w in windows]
    window = np.repeat(np.arange(len(windows)), [len(of_one) for of_one in numbers])
    start, end, period, lag = np.array([(w.start, w.end, w.period, w.lag) for w in windows])[window].T
    t = (phases[:, window] + np.concatenate(numbers)) * period
    x0, length = onset.x[0], onset.x[-1] - onset.x[0]
    passed = (onset.x - x0) / length if length > 0 else np.linspace(0.0, 1.0, len(onset.x))
    shown = np.where((t >= start) & (t <= end), np.interp(t, onset.shown, passed), 0.0)
    # In the order in which they are known; nothing is shown before the first.
    order = np.argsort(t + lag, axis=1)
    known, shown = np.take_along_axis(t + lag, order, axis=1), np.take_along_axis(shown, order, axis=1)
    done = np.maximum.accumulate(np.pad(shown, ((0, 0), (1, 0))), axis=1)
    share = np.diff(done)
    seen, worst = float(weight @ done[:, -1]), _latest(windows, onset)
    late = (share * known).sum(axis=1) - x0 * done[:, -1] - 0.5 * length * done[:, -1] ** 2
    never = not np.isfinite(worst) or 1.0 - seen > _NARROW
    return Delays(
        mean=float(weight @ late) / seen if seen > _NARROW else None,
        noticed=seen if seen > _NARROW else 0.0,
        worst=None if never else worst,
        unseen=max(_NARROW, 1.0 - seen) if never else 0.0,
        cost=None if never else float(weight @ (share * cost(known.ravel()).reshape(known.shape)).sum(axis=1)),
    )


def _phases(windows: Sequence[Window], onset: Onset, bends: Array) -> tuple[Array, Array]:
    """Phases as shares of the period of each window, shape (p, windows), and their weights, (p,), which sum up to 1.

    Of one rate they are two for each piece in which all times are linear in the phase.
    """
    rates = sorted({window.period for window in windows})
    which = [rates.index(window.period) for window in windows]
    if len(rates) > 1:  # a lattice, Niederreiter, Random Number Generation and Quasi-Monte Carlo Methods, section 4.2
        steps = np.append(1.0 / _LATTICE, np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0]))[: len(rates)]
        return ((np.arange(_LATTICE)[:, None] + 0.5) * steps % 1.0)[:, which], np.full(_LATTICE, 1.0 / _LATTICE)
    times = [onset.shown, bends, *(bends - lag for lag in {window.lag for window in windows})]
    edges = np.concatenate([[w.start for w in windows], [w.end for w in windows], *times]) / rates[0] % 1.0
    every = np.sort(np.concatenate([[0.0, 1.0], edges]))
    widths = np.diff(every)
    kept = widths > _NARROW
    begin, width = every[:-1][kept], widths[kept]
    phases = (begin[:, None] + width[:, None] * _GAUSS).ravel()
    return np.repeat(phases[:, None], len(which), axis=1), np.repeat(0.5 * width / width.sum(), 2)


def _latest(windows: Sequence[Window], onset: Onset) -> float:
    """The longest delay, whatever the phases of each rate; infinite if something may never be noticed.

    As rates are independent, the first of the slowest images of each rate counts. What happens when is cut into pieces
    in which the slowest image of each rate changes evenly.
    """
    rates = [[one for one in windows if one.period == period] for period in {window.period for window in windows}]
    first, last, cuts = onset.shown[0], onset.shown[-1], [onset.x]
    for own in rates:
        every = np.arange(np.floor(first / own[0].period) - 1, np.ceil(last / own[0].period) + 1) * own[0].period
        edges = (every[:, None] + _edges(own)[:-1]).ravel()
        cuts.append(np.interp(edges[(edges > first) & (edges < last)], onset.shown, onset.x))
    x = np.sort(np.concatenate(cuts))
    x = np.repeat(x, 2) if len(x) == 1 else x
    shown = np.interp(x, onset.x, onset.shown)
    inside = np.minimum(1e-10, 0.25 * np.diff(shown))
    begin, end = shown[:-1] + inside, shown[1:] - inside
    slowest = [np.maximum(_slowest(own, begin) - x[:-1], _slowest(own, end) - x[1:]) for own in rates]
    return float(np.min(slowest, axis=0).max())


def _edges(windows: Sequence[Window]) -> Array:
    """The phases of one rate between which it does not change which images fall into a window [s], from 0 on."""
    period = windows[0].period
    edges = np.sort([0.0, *(edge % period for w in windows for edge in (w.start, w.end))])
    return np.append(edges[np.append(np.diff(edges) > _NARROW, period - edges[-1] > _NARROW)], period)


def _slowest(windows: Sequence[Window], t: Array) -> Array:
    """When an image of one rate that is taken from times (n,) on is known at the latest, shape (n,) [s]."""
    edges, period = _edges(windows), windows[0].period
    low, high = edges[:-1], edges[1:]
    number = np.arange(int(min(w.start for w in windows) // period) - 1, int(max(w.end for w in windows) // period) + 2)
    taken = 0.5 * (low + high)[:, None] + number * period
    known = np.full((len(low), len(number) + 1), np.inf)  # [s] after the phase; none is after the last
    for w in windows:
        inside = (taken >= w.start) & (taken <= w.end)
        known[:, :-1] = np.minimum(known[:, :-1], np.where(inside, number * period + w.lag, np.inf))
    known = np.minimum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    piece, found = np.arange(len(low)), np.empty(len(t))
    few = max(1, _AT_ONCE // len(low))
    for part in (slice(at, at + few) for at in range(0, len(t), few)):
        next_one = np.ceil((t[part, None] - low) / period - 1e-11).astype(np.int64)
        phase = t[part, None] - (next_one - 1) * period  # before it in a piece, the image before the next is too early
        later = known[piece, np.clip(next_one - number[0], 0, len(number))]
        sooner = known[piece, np.clip(next_one - 1 - number[0], 0, len(number))]
        cut = (phase > low) & (phase < high)
        found[part] = np.where(cut, np.maximum(phase + later, high + sooner), high + later).max(axis=1)
    return found
