"""When images show something, against all images of many phases one by one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.geometry import Array
from sqrp_cli.logic.image_time import Delays, Onset, Window, Windows, delays

END = 4.5

PHASES, INSTANTS = 100, 400

NO_BENDS: Array = np.empty(0)


def known(t: Array) -> Array:
    return t


def images(windows: list[Window], shares: list[float]) -> list[tuple[float, float]]:
    """When each image in a window is taken and known, by the phase of each period as a share of it."""
    phases = dict(zip(sorted({w.period for w in windows}), shares, strict=False))
    found = []
    for w in windows:
        t = (np.arange(-2, 6 / w.period) + phases[w.period]) * w.period
        found += [(float(one), float(one) + w.lag) for one in t if w.start <= one <= w.end]
    return sorted(found)


def noticed(windows: list[Window], onset: Onset, shares: list[float], x: Array) -> Array:
    """When what happens at x is noticed, by looking at one image after the other."""
    shown, taken = np.interp(x, onset.x, onset.shown), images(windows, shares)
    return np.array([next((late for t, late in taken if t >= s), END) for s in shown.tolist()])


def enumerated(windows: list[Window], onset: Onset) -> tuple[float, float, float]:
    """Mean, worst and unseen share over phases and x."""
    x = onset.x[0] + (np.arange(INSTANTS) + 0.5) / INSTANTS * (onset.x[-1] - onset.x[0])
    late = np.array([noticed(windows, onset, [share], x) for share in (np.arange(PHASES) + 0.5) / PHASES])
    return float((late - x).mean()), float((late - x).max()), float((late == END).mean())


@st.composite
def some_windows(draw: st.DrawFn, periods: tuple[float, ...]) -> list[Window]:
    edges = sorted(draw(st.lists(st.floats(0.0, 4.0), min_size=0, max_size=10, unique=True)))
    cuts = [(a, b if draw(st.booleans()) else min(b, a + 0.06)) for a, b in list(pairwise(edges))[::2]]
    return [Window(a, b, draw(st.sampled_from(periods)), draw(st.sampled_from([0.02, 0.05]))) for a, b in cuts if b > a]


@st.composite
def onsets(draw: st.DrawFn) -> Onset:
    start, length = draw(st.floats(0.0, 2.0)), draw(st.sampled_from([0.05, 0.4, 1.5]))
    x = np.linspace(start, start + length, 4)
    late = np.array(draw(st.lists(st.sampled_from([0.0, 0.03, 0.3]), min_size=4, max_size=4)))
    return Onset(x, np.maximum.accumulate(x + late))


def of(windows: list[Window], onset: Onset) -> Delays:
    return delays(Windows.always(windows), onset, END, known, NO_BENDS)


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1,)), onset=onsets())
def test_delays_are_those_of_every_image_at_every_phase(windows: list[Window], onset: Onset) -> None:
    mean, worst, unseen = enumerated(windows, onset)
    found = of(windows, onset)
    edges = 2 * len(windows) + 4  # each is a cell of the phases off, or one of x
    off = edges * (1 / PHASES + 1 / INSTANTS) * min(1.0, 0.1 / float(onset.x[-1] - onset.x[0]) + 1 / INSTANTS * 10)
    assert found.mean == pytest.approx(mean, abs=END * off)
    assert found.unseen == pytest.approx(unseen, abs=off)
    assert found.cost == pytest.approx(found.mean + 0.5 * (onset.x[0] + onset.x[-1]))
    assert worst <= found.worst + 1e-9


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1,)), onset=onsets())
def test_some_phase_comes_as_close_to_the_worst_delay_as_one_likes(windows: list[Window], onset: Onset) -> None:
    edges = [0.0, *(edge / 0.1 % 1.0 for w in windows for edge in (w.start, w.end))]
    edges += [float(shown) / 0.1 % 1.0 for shown in onset.shown]
    near, latest = 1e-6, 0.0
    for phase in {(edge + side) % 1.0 for edge in edges for side in (-near, near)}:
        taken = np.array([t for t, _ in images(windows, [phase])])
        after = np.interp(taken, onset.shown, onset.x)
        x = np.unique(np.clip(np.concatenate([onset.x, onset.x + near, after + near]), onset.x[0], onset.x[-1]))
        latest = max(latest, float((noticed(windows, onset, [phase], x) - x).max()))
    assert latest == pytest.approx(of(windows, onset).worst, abs=1e-4)


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1, 0.07)), onset=onsets(), shares=st.tuples(st.floats(0, 0.999), st.floats(0, 0.999)))
def test_no_phases_of_cameras_with_several_rates_exceed_the_worst_delay(
    windows: list[Window], onset: Onset, shares: tuple[float, float]
) -> None:
    x = np.linspace(onset.x[0], onset.x[-1], 300)
    latest = (noticed(windows, onset, list(shares), x) - x).max()
    assert latest <= of(windows, onset).worst + 1e-9


def test_the_worst_delay_of_several_rates_is_that_at_the_end_of_the_faster_windows() -> None:
    windows = [Window(0.0, 1.5, 0.1, 0.05), Window(1.5, 4.0, 1 / 7, 0.12)]
    assert of(windows, Onset.at_once(1.0, 1.3)).worst == pytest.approx(0.1 + 0.05)
    assert of(windows, Onset.at_once(1.0, 2.0)).worst == pytest.approx(1.5 - 1.4 + 1 / 7 + 0.12)
    assert of(windows, Onset.at_once(1.6, 2.0)).worst == pytest.approx(1 / 7 + 0.12)


@settings(max_examples=30, deadline=None)
@given(onset=onsets(), change=st.floats(0.0, 4.0), lag=st.sampled_from([0.02, 0.05]))
def test_no_change_of_rate_costs_more_than_an_image_of_each(onset: Onset, change: float, lag: float) -> None:
    windows = [Window(0.0, change, 0.1, lag), Window(change, END, 0.07, lag)]
    parted = float((onset.shown - onset.x).max())
    assert of(windows, onset).worst <= parted + 0.1 + 0.07 + lag + 1e-9


def test_a_window_shorter_than_a_period_is_no_sure_image() -> None:
    found = of([Window(2.0, 2.052, 0.1, 0.05)], Onset.at_once(1.0, 1.0))
    assert found.unseen == pytest.approx(0.48)
    assert found.worst == pytest.approx(END - 1.0)
    assert found.mean == pytest.approx(0.52 * (2.026 + 0.05 - 1.0) + 0.48 * (END - 1.0))


def test_two_short_windows_are_a_sure_image_if_every_phase_falls_into_one() -> None:
    windows = [Window(2.0, 2.06, 0.1, 0.05), Window(2.35, 2.41, 0.1, 0.05)]
    found = of(windows, Onset.at_once(1.0, 1.0))
    assert found.unseen == pytest.approx(0.0)
    assert found.worst == pytest.approx(2.40 + 0.05 - 1.0)


def test_what_parts_late_is_shown_by_later_images_only() -> None:
    found = of([Window(0.0, 4.0, 0.1, 0.05)], Onset(np.array([1.0, 2.0]), np.array([1.03, 2.03])))
    assert (found.mean, found.worst) == (pytest.approx(0.13), pytest.approx(0.18))


@settings(max_examples=15, deadline=None)
@given(windows=some_windows((0.1,)), onset=onsets(), sooner=st.floats(0.0, 1.0))
def test_the_mean_is_by_what_images_usually_show_and_the_worst_by_what_they_surely_do(
    windows: list[Window], onset: Onset, sooner: float
) -> None:
    usual = np.maximum.accumulate(onset.x + sooner * (onset.shown - onset.x))
    both = of(windows, Onset(onset.x, onset.shown, usual))
    assert both.mean == of(windows, Onset(onset.x, usual)).mean
    assert both.worst == of(windows, onset).worst
    assert both.mean <= of(windows, onset).mean + 1e-9
