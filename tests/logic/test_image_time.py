"""When images show something, against all images of many phases one by one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.geometry import Array
from sqrp_cli.logic.image_time import Delays, Onset, Window, delays

PHASES, INSTANTS = 100, 400

NO_BENDS: Array = np.empty(0)


def known(t: Array) -> Array:
    return t


def images(windows: list[Window], shares: tuple[float, ...]) -> list[tuple[float, float]]:
    """When each image in a window is taken and known, by the phase of each period as a share of it."""
    phases = dict(zip(sorted({w.period for w in windows}), shares, strict=False))
    found = []
    for w in windows:
        t = (np.arange(-2, 6 / w.period) + phases[w.period]) * w.period
        found += [(float(one), float(one) + w.lag) for one in t if w.start <= one <= w.end]
    return found


def noticed(windows: list[Window], onset: Onset, shares: tuple[float, ...], x: Array) -> Array:
    """When what happens at x is noticed, infinite if never, by looking at every image."""
    shown, taken = np.interp(x, onset.x, onset.shown), images(windows, shares)
    return np.array([min((late for t, late in taken if t >= s), default=np.inf) for s in shown.tolist()])


def instants(onset: Onset) -> Array:
    inside: Array = onset.x[0] + (np.arange(INSTANTS) + 0.5) / INSTANTS * (onset.x[-1] - onset.x[0])
    return inside


@st.composite
def some_windows(draw: st.DrawFn, periods: tuple[float, ...]) -> list[Window]:
    """Windows of cameras of some rates, those of one camera apart from each other."""
    found = []
    for period, lag in draw(st.sets(st.tuples(st.sampled_from(periods), st.sampled_from([0.02, 0.05])), max_size=3)):
        edges = sorted(draw(st.lists(st.floats(0.0, 4.0), min_size=0, max_size=8, unique=True)))
        cuts = [(a, b if draw(st.booleans()) else min(b, a + 0.06)) for a, b in list(pairwise(edges))[::2]]
        found += [Window(a, b, period, lag) for a, b in cuts if b > a]
    return found


@st.composite
def onsets(draw: st.DrawFn) -> Onset:
    start, length = draw(st.floats(0.0, 2.0)), draw(st.sampled_from([0.05, 0.4, 1.5]))
    x = np.linspace(start, start + length, 4)
    late = np.array(draw(st.lists(st.sampled_from([0.0, 0.03, 0.3]), min_size=4, max_size=4)))
    return Onset(x, np.maximum.accumulate(x + late))


def of(windows: list[Window], onset: Onset) -> Delays:
    return delays(windows, onset, known, NO_BENDS)


@settings(max_examples=25, deadline=None)
@given(windows=some_windows((0.1,)), onset=onsets())
def test_delays_are_those_of_every_image_at_every_phase(windows: list[Window], onset: Onset) -> None:
    x, found = instants(onset), of(windows, onset)
    late = np.array([noticed(windows, onset, (share,), x) for share in (np.arange(PHASES) + 0.5) / PHASES])
    seen = np.isfinite(late)
    edges = 2 * len(windows) + 4  # each is a cell of the phases off, or one of x
    off = edges * (1 / PHASES + 1 / INSTANTS) * min(1.0, 0.1 / float(onset.x[-1] - onset.x[0]) + 1 / INSTANTS * 10)
    assert found.unseen == pytest.approx(1.0 - seen.mean(), abs=off)
    if seen.mean() > off:
        assert found.mean is not None
        mean = float((late - x)[seen].mean())
        assert found.mean == pytest.approx(mean, abs=4.5 * off / seen.mean())
    if not seen.all():
        assert found.unseen > 0
    assert (found.worst is None) == (found.cost is None) == (found.unseen > 0)
    if found.worst is not None and found.mean is not None:
        assert (late - x).max() <= found.worst + 1e-9
        assert found.cost == pytest.approx(found.mean + 0.5 * (onset.x[0] + onset.x[-1]))


def latest(windows: list[Window], onset: Onset) -> float:
    """The longest delay at phases right beside those at which images enter or leave a window."""
    near, found = 1e-6, 0.0
    periods = sorted({w.period for w in windows})
    shares = []
    for period in periods:
        own = [edge for w in windows if w.period == period for edge in (w.start, w.end)]
        cells = {float(edge) / period % 1.0 for edge in [0.0, *own, *onset.shown]}
        shares.append([(cell + side) % 1.0 for cell in cells for side in (-near, near)])
    knots = np.unique(np.concatenate([onset.x, instants(onset)]))
    after = [[t for share in of_one for t, _ in images([w for w in windows if w.period == p], (share,))]
             for p, of_one in zip(periods, shares, strict=True)]  # fmt: skip
    x = np.unique(np.concatenate([knots, *(np.interp(t, onset.shown, onset.x) for t in after)]))
    x = np.unique(np.clip(np.concatenate([x, x + near]), onset.x[0], onset.x[-1]))
    slowest = [
        np.max([noticed([w for w in windows if w.period == p], onset, (share,), x) for share in of_one], axis=0)
        for p, of_one in zip(periods, shares, strict=True)
    ]  # of each rate by itself, as their phases are independent
    return max(found, float((np.min(slowest, axis=0) - x).max()))


@settings(max_examples=25, deadline=None)
@given(windows=some_windows((0.1, 0.07)), onset=onsets())
def test_some_phases_come_as_close_to_the_worst_delay_as_one_likes(windows: list[Window], onset: Onset) -> None:
    found = of(windows, onset)
    if found.worst is not None:
        assert latest(windows, onset) == pytest.approx(found.worst, abs=1e-4)
    elif windows and found.unseen > 1e-4:
        assert latest(windows, onset) == np.inf


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1, 0.07)), onset=onsets())
def test_means_of_several_rates_are_those_over_independent_phases(windows: list[Window], onset: Onset) -> None:
    rng, x, found = np.random.default_rng(0), instants(onset)[::4], of(windows, onset)
    late = np.array([noticed(windows, onset, (float(a), float(b)), x) for a, b in rng.uniform(size=(300, 2))])
    seen = np.isfinite(late)
    assert found.unseen == pytest.approx(1.0 - seen.mean(), abs=0.05)
    if seen.mean() > 0.3 and found.mean is not None:
        rows = [float((row - x)[np.isfinite(row)].sum()) for row in late]
        error = 4.0 * float(np.std(rows)) / 300**0.5 / float(seen.mean()) / len(x)
        assert found.mean == pytest.approx(float((late - x)[seen].mean()), abs=0.02 + error)


@settings(max_examples=25, deadline=None)
@given(windows=some_windows((0.1, 0.07)), onset=onsets(), shut=st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 4.0)))
def test_no_delay_gets_shorter_where_images_show_less(
    windows: list[Window], onset: Onset, shut: tuple[float, float]
) -> None:
    start, end = min(shut), max(shut)
    parts = [(replace(one, end=min(one.end, start)), replace(one, start=max(one.start, end))) for one in windows]
    less = of([part for both in parts for part in both if part.end > part.start], onset)
    more = of(windows, onset)
    assert less.unseen >= more.unseen - 1e-9
    if less.worst is not None and less.mean is not None:
        assert more.worst is not None and more.mean is not None  # noqa: PT018
        assert less.worst >= more.worst - 1e-9
        assert less.mean >= more.mean - 1e-6 - 0.01 * (len({one.period for one in windows}) > 1)
    if more.worst is not None:
        assert more.worst >= min(one.lag for one in windows)


SHIFTED = Onset(np.array([1.0, 2.0]), np.array([1.03, 2.03]))
TWO_RATES = [Window(0.0, 1.5, 0.1, 0.05), Window(1.5, 4.0, 1 / 7, 0.12)]


@pytest.mark.parametrize(
    ("windows", "onset", "unseen", "mean", "worst"),
    [
        # The worst delay of several rates is that at the end of the faster windows.
        (TWO_RATES, Onset.at_once(1.0, 1.3), 0.0, ..., 0.1 + 0.05),
        (TWO_RATES, Onset.at_once(1.0, 2.0), 0.0, ..., 1.5 - 1.4 + 1 / 7 + 0.12),
        (TWO_RATES, Onset.at_once(1.6, 2.0), 0.0, ..., 1 / 7 + 0.12),
        # A window shorter than a period is no sure image; two are one if every phase falls into one of them.
        ([Window(2.0, 2.052, 0.1, 0.05)], Onset.at_once(1.0, 1.0), 0.48, 2.026 + 0.05 - 1.0, None),
        ([Window(2.0, 2.06, 0.1, 0.05), Window(2.35, 2.41, 0.1, 0.05)], Onset.at_once(1.0, 1.0), 0.0, ..., 1.45),
        # A short window of a fast camera promises nothing before that of a slow one.
        ([Window(2.0, 2.05, 0.1, 0.05), Window(3.0, 4.0, 0.1, 0.12)], Onset.at_once(1.0, 1.0), 0.0, ..., 2.22),
        ([Window(2.0, 2.05, 0.1, 0.05), Window(3.0, 4.0, 0.07, 0.12)], Onset.at_once(1.0, 1.0), 0.0, ..., 2.19),
        # What parts late is shown by later images only.
        ([Window(0.0, 4.0, 0.1, 0.05)], SHIFTED, 0.0, 0.13, 0.18),
        *(  # what is always seen takes a period and the latency at worst
            ([Window(start, 9.0, 0.1, lag)], Onset(np.array([start, start + 1.7]), np.array([start, start + 1.71])),
             0.0, ..., 0.11 + lag)
            for start in (0.1, 6.358472639) for lag in (0.0, 0.05)
        ),
    ],
)  # fmt: skip
def test_delays_worked_out_by_hand(
    windows: list[Window], onset: Onset, unseen: float, mean: object, worst: float | None
) -> None:
    found = of(windows, onset)
    assert (found.unseen, found.worst) == (pytest.approx(unseen, abs=1e-9), worst and pytest.approx(worst))
    assert mean is ... or found.mean == pytest.approx(mean)


@settings(max_examples=30, deadline=None)
@given(onset=onsets(), change=st.floats(0.0, 4.0), lag=st.sampled_from([0.02, 0.05]))
def test_no_change_of_rate_costs_more_than_an_image_of_each(onset: Onset, change: float, lag: float) -> None:
    windows = [Window(0.0, change, 0.1, lag), Window(change, 4.5, 0.07, lag)]
    parted, worst = float((onset.shown - onset.x).max()), of(windows, onset).worst
    assert worst is not None
    assert worst <= parted + 0.1 + 0.07 + lag + 1e-9


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1,)), onset=onsets(), sooner=st.floats(0.0, 1.0))
def test_the_mean_is_by_what_images_usually_show_and_the_worst_by_what_they_surely_do(
    windows: list[Window], onset: Onset, sooner: float
) -> None:
    usual = np.maximum.accumulate(onset.x + sooner * (onset.shown - onset.x))
    both = of(windows, Onset(onset.x, onset.shown, usual))
    assert both.mean == of(windows, Onset(onset.x, usual)).mean
    assert (both.worst, both.unseen) == (of(windows, onset).worst, of(windows, onset).unseen)
