"""When images show what happens: exactly, over all phases of the cameras.

A camera takes an image every period, at a phase that nobody chooses. Cameras of one rate take theirs together. What
lies in a *window* is seen if an image falls into it. Times are piecewise linear in the phase, so that means over it are
sums over pieces, and suprema lie at their ends: nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.logic.formula_time import SAME_INSTANT

Array = NDArray[np.float64]

_GAUSS = np.array([0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5])
"""Of a piece, the two places whose mean is that of any polynomial up to the third degree over it."""

_NARROW = 1e-9
"""Pieces of the phase narrower than this share of a period do not count, nor shares of x."""


class Window(NamedTuple):
    """A time in which every image of some cameras shows something."""

    start: float
    """[s]."""
    end: float
    """[s]."""
    period: float
    """Between two images [s]."""
    lag: float
    """From an image until what it shows is known [s]."""


class Windows(NamedTuple):
    """When images show something: windows in order, apart from each other."""

    sure: tuple[Window, ...]
    """In which they surely do."""
    usual: tuple[Window, ...]
    """In which they usually do: those, and others."""

    @classmethod
    def always(cls, windows: Iterable[Window]) -> Windows:
        """What images show in the same windows surely and usually."""
        found = tuple(windows)
        return cls(found, found)


def within(windows: Iterable[Window], start: float, end: float) -> list[Window]:
    """What of windows lies between two times [s]."""
    clipped = (one._replace(start=max(one.start, start), end=min(one.end, end)) for one in windows)
    return [one for one in clipped if one.end > one.start]


def overlaps(windows: Iterable[Window], others: Sequence[Window]) -> list[Window]:
    """Where windows meet others, with the slower cameras of both."""
    return [
        found._replace(period=max(one.period, found.period), lag=max(one.lag, found.lag))
        for one in windows
        for found in within(others, one.start, one.end)
    ]


def joined(*windows: Sequence[Window]) -> tuple[Window, ...]:
    """Windows, with what of the next ones lies outside of those before; in order, apart from each other."""
    found: list[Window] = []
    for some in windows:
        edges = [-np.inf, *(edge for one in found for edge in (one.start, one.end)), np.inf]
        new = [one for start, end in zip(edges[::2], edges[1::2], strict=True) for one in within(some, start, end)]
        every, found = sorted([*found, *new]), []
        for one in every:
            if found and found[-1][1:] == (one.start, one.period, one.lag):
                one = found.pop()._replace(end=one.end)
            found.append(one)
    return tuple(found)


def shown_until(windows: Iterable[Window], start: float) -> float:
    """Until when one window after the other shows what happens from a time on [s]; that time where none does."""
    until = start
    for window in windows:
        if window.start <= until + SAME_INSTANT:
            until = max(until, window.end)
    return until


@dataclass(frozen=True, eq=False)
class Onset:
    """From when on images show what happens at a time x, at points in order; linear in between."""

    x: Array
    """When it happens, shape (n,), n >= 2 [s]."""
    shown: Array
    """From when on images surely show it, shape (n,), never falling [s]."""
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

    @property
    def share(self) -> Array:
        """The share of all x up to each point, shape (n,), from 0 to 1."""
        length = self.x[-1] - self.x[0]
        return (self.x - self.x[0]) / length if length > 0 else np.linspace(0.0, 1.0, len(self.x))


@dataclass(frozen=True)
class Delays:
    """How long after x something that happens at x is noticed, x uniform, over all phases."""

    mean: float
    """[s]."""
    worst: float
    """The supremum [s]."""
    unseen: float
    """Share of x, mean over the phases, after which no image shows it, in 0..1."""
    cost: float
    """Mean of a cost of the time at which it is noticed."""


def delays(windows: Windows, onset: Onset, end: float, cost: Callable[[Array], Array], bends: Array) -> Delays:
    """The delays of something that happens at any x of `onset`: the worst by what is sure, the rest by what is usual.

    end: when it is noticed if no image shows it [s]. cost: of being noticed at times, shape (n,) each, linear between
    `bends` [s].

    Of several rates, the mean takes the phases to be the same share of every period, and the worst delay only counts on
    windows as long as a period, so that it holds whatever the phases are.
    """
    usual = _delays(windows.usual, onset.as_usual, end, cost, bends)
    if onset.usual is None and windows.sure == windows.usual:
        return usual
    return replace(usual, worst=_delays(windows.sure, Onset(onset.x, onset.shown), end, cost, bends).worst)


def _delays(
    windows: Sequence[Window], onset: Onset, end: float, cost: Callable[[Array], Array], bends: Array
) -> Delays:
    """As `delays`, of an onset whose images always show it at one time."""
    whole, windows = windows, list(_useful(windows, onset))
    shares, widths = _phases(windows, onset, bends)
    images = _images(windows, onset, shares)
    x, length = onset.x[0], onset.x[-1] - onset.x[0]
    weight = np.repeat(0.5 * widths, 2)
    gone = 1.0 - images.done[:, -1]
    costs = cost(np.append(images.known.ravel(), end))
    spent = (images.share * costs[:-1].reshape(images.known.shape)).sum(axis=1) + gone * costs[-1]
    noticed = (images.share * images.known).sum(axis=1) + gone * end
    several = len({window.period for window in windows}) > 1
    worst = _surely(whole, onset, end) if several else _latest(images, onset, end)
    return Delays(
        mean=float(weight @ noticed - x - 0.5 * length),
        worst=worst,
        unseen=float(weight @ gone),
        cost=float(weight @ spent),
    )


def _useful(windows: Sequence[Window], onset: Onset) -> Iterator[Window]:
    """The windows up to the first image that surely shows what happens last, without what cannot matter."""
    first, last = onset.shown[0], onset.shown[-1]
    for window in windows:
        if window.end < first:
            continue
        sure = max(window.start, last) + window.period
        yield window._replace(end=min(window.end, sure))
        if window.end >= sure:
            return


class _ImagesAtPhases(NamedTuple):
    """The images in windows at p phases, in order of their times; n places, where some have no image."""

    known: Array
    """When each is known, shape (p, n) [s]."""
    share: Array
    """Share of all x that it is the first to show, shape (p, n)."""
    done: Array
    """Share of all x that it or one before it shows, 0 in the first column, shape (p, n + 1)."""


def _images(windows: Sequence[Window], onset: Onset, shares: Array) -> _ImagesAtPhases:
    """Every image at phases that are shares of the period, shape (p,)."""
    number, window = _numbers(windows)
    start, end, period, lag = np.array(windows, dtype=float).reshape(-1, 4)[window].T
    t = (shares[:, None] + number) * period
    reached = np.interp(t, onset.shown, onset.share)
    done = np.maximum.accumulate(np.where((t >= start) & (t <= end), reached, 0.0), axis=1)
    done = np.concatenate([np.zeros((len(shares), 1)), done], axis=1)
    return _ImagesAtPhases(t + lag, np.diff(done, axis=1), done)


def _numbers(windows: Sequence[Window]) -> tuple[Array, NDArray[np.int64]]:
    """The numbers of all images that may fall into a window at some phase, with the index of the window."""
    of_each = [np.arange(np.floor(w.start / w.period) - 1, np.floor(w.end / w.period) + 1) for w in windows]
    index = np.repeat(np.arange(len(of_each)), [len(numbers) for numbers in of_each])
    return np.concatenate([np.empty(0), *of_each]), index


def _phases(windows: Sequence[Window], onset: Onset, bends: Array) -> tuple[Array, Array]:
    """Phases, two for each piece in which all times are linear in the phase, and the widths of the pieces.

    Phases are shares of the period, shape (2 p,); widths (p,) sum up to 1.
    """
    edges = [np.array([0.0, 1.0])]
    for period, lag in sorted({(window.period, window.lag) for window in windows}):
        own = [(w.start, w.end) for w in windows if (w.period, w.lag) == (period, lag)]
        edges += [np.ravel(own) / period % 1.0, onset.shown / period % 1.0, (bends - lag) / period % 1.0]
    every = np.unique(np.concatenate(edges))
    widths = np.diff(every)
    kept = widths > _NARROW
    begin, width = every[:-1][kept], widths[kept]
    return (begin[:, None] + width[:, None] * _GAUSS).ravel(), width / width.sum()


def _latest(images: _ImagesAtPhases, onset: Onset, end: float) -> float:
    """The longest delay at any phase: linear in each piece of the phases, so at one of its ends."""
    x0, length = onset.x[0], onset.x[-1] - onset.x[0]
    known = np.concatenate([images.known, np.full((len(images.known), 1), end)], axis=1)
    share = np.concatenate([images.share, 1.0 - images.done[:, -1:]], axis=1)
    delay = np.where(share > _NARROW, known - (x0 + length * images.done), -np.inf)
    first, second = delay[0::2], delay[1::2]
    both = np.isfinite(first) & np.isfinite(second)
    slope = np.subtract(second, first, out=np.zeros_like(first), where=both) / (_GAUSS[1] - _GAUSS[0])
    ends = np.where(both, np.maximum(first - slope * _GAUSS[0], second + slope * _GAUSS[0]), -np.inf)
    return float(ends.max())


def _surely(windows: Sequence[Window], onset: Onset, end: float) -> float:
    """A bound on the delay whatever the phases: an image falls into a window as soon as a period of it has passed."""
    start, stop, period, lag = np.array(windows, dtype=float).reshape(-1, 4).T
    last = stop - period
    x0, length = onset.x[0], onset.x[-1] - onset.x[0]
    inner = last[(last > onset.shown[0]) & (last < onset.shown[-1])]
    shown = np.concatenate([onset.shown, inner])
    x = np.concatenate([onset.x, x0 + length * np.interp(inner, onset.shown, onset.share)])
    seen = np.where(shown[:, None] < last, np.maximum(start, shown[:, None]) + period + lag, np.inf)
    known = seen.min(axis=1, initial=np.inf)
    return float((np.where(np.isfinite(known), known, end) - x).max())
