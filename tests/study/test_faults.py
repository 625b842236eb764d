"""How late a fault is noticed, against all images of many phases one by one; stopping against ruckig."""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Trajectory

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import FaultMetrics
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.image_time import Onset, Window
from sqrp_cli.logic.literal import Literal
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.stop_and_return import Recovery, stop
from sqrp_cli.motion.timing import MotionLimits
from sqrp_cli.study.analysis import Analysis, fault_metrics
from sqrp_cli.study.fault_sights import FaultWatch, fault_windows
from sqrp_cli.study.find import WantedWay, find_way
from sqrp_cli.study.sampling import Adaptive, first_samples
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.task.pieces import cut_into_pieces
from sqrp_cli.task.task import read_task
from tests.task.studies import ATOMS, Story, always, eventually, make_story, moments, stories

PERIOD = 0.06
"""Between two images [s]."""

LATENCY = 0.04
"""[s]."""

CAMERA: Any = SimpleNamespace(rate=1 / PERIOD, latency=LATENCY, lag=LATENCY)

PHASES, INSTANTS = 40, 400
"""Phases of the cameras, and instants x at which the delay is evaluated."""


def recovery(seed: int, total: float) -> Recovery:
    rng = np.random.default_rng(seed)
    return np.linspace(0.0, total, 8), rng.uniform(0.5, 3.0, 8)


def windows_of(story: Story) -> tuple[Window, ...]:
    literals = story.formulas[-1].literals
    columns = tuple((ATOMS.index(literal.atom),) for literal in literals)
    fault = FaultWatch("slip", literals, (story.interval,), columns)
    return fault_windows(story.timeline, (), fault, [CAMERA], story.total)


def figures(story: Story, back: Recovery) -> FaultMetrics:
    return fault_metrics(
        windows_of(story), [Onset.at_once(story.interval.start, story.interval.end)], back, story.total
    )


def shows_fault(story: Story, t: Array) -> Mask:
    """Whether an image at each time t shows the fault, by the samples around it."""
    found, interval = np.zeros(len(t), dtype=bool), story.interval
    pieces = story.timeline.samples.piece.tolist()
    for (t0, first), (t1, second), number, after in zip(
        moments(story), moments(story)[1:], pieces, pieces[1:], strict=False
    ):
        piece, literals = story.timeline.planned.stage.pieces[number], story.formulas[-1].literals
        within = interval.start - 1e-9 <= piece.start and piece.end <= interval.end + 1e-9
        opposed = piece.start >= interval.end - 1e-9 and any(lit.negated() in piece.literals for lit in literals)
        if first and second and number == after and t0 < t1 and (within or opposed):
            until = t1 + PERIOD * (t1 == story.total)  # a run looks once more at the end
            found |= (t0 <= t) & (t <= until)
    return found


def enumerated(story: Story, back: Recovery) -> FaultMetrics:
    """The figures by every one of many phases: all images one by one, and which of them shows each fault first."""
    start, end = story.interval.start, story.interval.end
    x = start + (np.arange(INSTANTS) + 0.5) * (end - start) / INSTANTS
    late, seen = [], []
    for phase in (np.arange(PHASES) + 0.5) / PHASES * PERIOD:
        t = np.arange(phase, story.total + PERIOD, PERIOD)
        shows = shows_fault(story, t)
        first = np.searchsorted(t[shows], x)
        late.append(np.append(t[shows] + LATENCY, np.inf)[first])
        seen.append(first < shows.sum())
    blind = (~shows_fault(story, x)).tolist()
    runs = [len(list(run)) for hidden, run in groupby(blind) if hidden]
    noticed, never = np.array(late), not np.all(seen)
    done = noticed + np.interp(noticed, *back) + story.total
    return FaultMetrics(
        delay_mean=float((noticed - x)[np.array(seen)].mean()) if np.any(seen) else None,
        delay_worst=None if never else float((noticed - x).max()),
        blind_longest=max(runs, default=0) * (end - start) / INSTANTS,
        unseen=float(1.0 - np.mean(seen)),
        expected_time=None if never else float(done.mean()),
    )


@settings(max_examples=60)
@given(story=stories(), seed=st.integers(0, 1000))
def test_metrics_are_those_of_every_image_at_every_phase(story: Story, seed: int) -> None:
    back = recovery(seed, story.total)
    found = figures(story, back)
    if story.interval.length == 0:
        return
    expected = enumerated(story, back)
    # Every edge of a window is off by a cell of the phases, of the few images that it concerns, or by one of x.
    edges = 2 * len(windows_of(story)) + 4
    off = edges * (1 / INSTANTS + min(1.0, 2 * PERIOD / story.interval.length) / PHASES)
    assert found.unseen == pytest.approx(expected.unseen, abs=off)
    if expected.unseen < 1.0 - 2 * off:
        assert found.delay_mean == pytest.approx(expected.delay_mean, abs=story.total * off / (1.0 - expected.unseen))
    step = story.interval.length / INSTANTS
    if all(one.end - one.start > step for one in windows_of(story)):  # no instant falls into others
        assert found.blind_longest == pytest.approx(expected.blind_longest, abs=2 * step)
    assert (found.delay_worst is None) == (found.expected_time is None) == (found.unseen > 0)
    assert 0 <= found.unseen <= 1 + 1e-9
    assert 0 <= found.blind_longest <= story.interval.length + 1e-12
    if found.delay_worst is not None:
        assert expected.delay_worst is not None
        assert expected.delay_worst <= found.delay_worst + 1e-9
        assert found.expected_time == pytest.approx(expected.expected_time, abs=(story.total + 3.0) * off)


HOLD = Literal(ATOMS[0])


@pytest.mark.parametrize(
    ("window", "onset", "mean", "worst", "blind", "unseen"),
    [
        ([Window(0.0, 4.0, 0.1, 0.05)], Onset.at_once(1.0, 3.0), 0.10, 0.15, 0.0, 0.0),  # waits for the next image
        ([Window(2.0, 4.0, 0.1, 0.05)], Onset.at_once(1.5, 1.5), 0.60, 0.65, 0.0, 0.0),  # at one instant
        ([], Onset.at_once(1.0, 3.0), None, None, 2.0, 1.0),  # no image shows it
    ],
)
def test_metrics_worked_out_by_hand(window, onset, mean, worst, blind, unseen):
    found = fault_metrics(window, [onset], recovery(0, 4.0), 4.0)
    assert astuple(found)[:4] == (
        mean and pytest.approx(mean), worst and pytest.approx(worst), pytest.approx(blind), pytest.approx(unseen),
    )  # fmt: skip
    assert (found.expected_time is None) == (worst is None)


@pytest.mark.parametrize(
    ("formulas", "unseen"),
    [
        # A run looks once more at the end of a motion.
        ((eventually(1.0, 3.9, HOLD, fault="slip"),), 0.5 * PERIOD / 2.9),
        ((eventually(1.0, 4.0, HOLD, fault="slip"),), 0.0),
        # After the last image in the interval, half a period before its end on average, no other tells, unless a
        # formula requires the opposite then.
        ((always(2.0, 4.0, HOLD.negated()), eventually(1.0, 2.0, HOLD, fault="slip")), 0.0),
        ((always(2.0, 4.0, HOLD), eventually(1.0, 2.0, HOLD, fault="slip")), PERIOD / 2),
    ],
)
def test_what_images_show_after_the_interval_of_a_fault(formulas, unseen):
    found = figures(make_story([4.0], formulas, [5], seed=1, seen=1.0), recovery(0, 4.0))
    assert found.unseen == pytest.approx(unseen)


def fastest(folder: str, task: str) -> tuple[Cell, Analysis]:
    cell = Cell.load(load_workspace(Path(__file__).parents[2] / "workspaces" / folder))
    candidate = read_task(task, cell.workspace).candidates[0]
    found = find_way(cell, candidate, cell.initial_world, Adaptive(), WantedWay(fastest=True))
    assert not isinstance(found, Infeasible)
    return cell, found.analysis


def test_no_lost_part_is_shown_sooner_than_images_can_tell_it() -> None:
    onset = fastest("tabletop", "pickup g2")[1].onsets["slip"][0]
    lag = onset.shown - onset.x
    assert lag[0] > 0.1  # the cup has hardly moved: what it lost stands still below it
    assert (lag[onset.x > onset.x[0] + 1.5] < 0.03).all()


LIMITS = MotionLimits(np.array([1.0]), np.array([2.0]), np.array([10.0]))


@given(velocity=st.floats(-1, 1), acceleration=st.floats(-2, 2))
def test_stopping_takes_as_long_and_as_far_as_ruckig_says(velocity: float, acceleration: float) -> None:
    request = InputParameter(1)
    request.control_interface = ControlInterface.Velocity
    request.current_velocity, request.current_acceleration = [velocity], [acceleration]
    request.target_velocity, request.target_acceleration = [0.0], [0.0]
    request.max_acceleration, request.max_jerk = LIMITS.acceleration.tolist(), LIMITS.jerk.tolist()
    trajectory = Trajectory(1)
    assert Ruckig(1).calculate(request, trajectory) == Result.Working
    position, final, _ = trajectory.at_time(trajectory.duration)

    time, moved = stop(np.array([[velocity]]), np.array([[acceleration]]), LIMITS)

    assert final[0] == pytest.approx(0.0, abs=1e-8)
    assert time[0, 0] == pytest.approx(trajectory.duration, abs=1e-6)
    assert moved[0, 0] == pytest.approx(position[0], abs=1e-6)


def test_a_fault_in_two_intervals_is_averaged_over_both_and_not_over_the_time_between() -> None:
    first, second, back = Onset.at_once(0.5, 1.0), Onset.at_once(2.0, 3.5), recovery(0, 4.0)
    windows = [Window(0.7, 1.2, 0.1, 0.05), Window(3.0, 4.0, 0.1, 0.05)]
    parts = [fault_metrics(windows, [part], back, 4.0) for part in (first, second)]
    both = fault_metrics(windows, (first, second), back, 4.0)
    means, dones = ([getattr(part, name) for part in parts] for name in ("delay_mean", "expected_time"))
    assert both.delay_mean == pytest.approx(np.dot([0.25, 0.75], means))
    assert both.expected_time == pytest.approx(np.dot([0.25, 0.75], dones))
    assert (both.delay_worst, both.blind_longest) == (parts[1].delay_worst, pytest.approx(1.0))
    # One that may never be noticed in the second interval has the delay of the first on average.
    both = fault_metrics([Window(0.5, 1.2, 0.1, 0.05)], (first, second), back, 4.0)
    assert (both.delay_mean, both.delay_worst, both.expected_time) == (pytest.approx(0.1), None, None)
    assert both.unseen == pytest.approx(0.75)


@given(seed=st.integers(0, 10**6))
def test_each_kind_of_cameras_has_its_windows_and_together_they_show_what_none_shows_alone(seed: int) -> None:
    story = make_story([4.0], (eventually(1.0, 3.0, *map(Literal, ATOMS), fault="slip"),), [9], seed, seen=1.0)
    cameras: list[Any] = [SimpleNamespace(rate=10, lag=0.05), SimpleNamespace(rate=4, lag=0.02)]
    rng, t = np.random.default_rng(seed), story.timeline.samples.t
    sees = rng.random((len(ATOMS), len(t), 2)) < 0.7
    empty = np.zeros(sees.shape[1:])
    matrix = tuple((BoxVerdicts(np.where(one, 0, 9).astype(np.int8), empty.astype(int), empty, empty),) for one in sees)
    timeline = replace(story.timeline, observation=replace(story.timeline.observation, matrix=matrix))
    targets: list[Any] = [SimpleNamespace(cameras=1)] * 2
    fault = FaultWatch("slip", tuple(map(Literal, ATOMS)), (story.interval,), ((0,), (1,)))
    found = fault_windows(timeline, targets, fault, cameras, story.total)
    inside = (t[:-1] >= 1.0) & (t[1:] <= 3.0) & (np.diff(t) > 0)
    for number, of_clock in enumerate([(0.1, 0.05), (0.25, 0.02), (0.25, 0.05)]):
        own = sees[..., [number]] if number < 2 else sees
        shown = own.any(axis=2).all(axis=0)
        windows = [one for one in found if (one.period, one.lag) == of_clock]
        for i in np.flatnonzero(inside):
            contained = any(one.start <= t[i] and t[i + 1] <= one.end for one in windows)
            long = number < 2 or any(one.end - one.start > 0.25 for one in windows if one.start <= t[i] <= one.end)
            assert contained == (shown[i] and shown[i + 1] and long) or (number == 2 and not contained)


def test_once_it_is_lost_a_part_lies_where_it_stood_and_the_fingers_are_closed() -> None:
    cell, found = fastest("screws", "pickup red1")
    stage, lost = found.planned.stage, found.planned.stage.once_lost()
    samples = first_samples(Adaptive(), stage, cell.observer, found.planned.targets)
    as_planned, states = stage.states(samples).X_WF, lost.states(samples).X_WF
    carried = np.array([name is not None for name in stage.held(samples)])
    assert carried.any()
    assert np.allclose(states["red1"], stage.X_WO["red1"])
    # Closed, the pads of the gripper meet in the middle: `left_finger_joint` is half the distance between them.
    for finger in ("left_finger", "right_finger"):
        gap = np.linalg.norm(states[finger][carried, :3, 3] - states["gripper_palm"][carried, :3, 3], axis=1)
        assert np.allclose(gap, 0.05)
        assert np.array_equal(states[finger][~carried], as_planned[finger][~carried])
        half = stage.once_lost(0.5).states(samples).X_WF[finger][carried, :3, 3]
        assert np.allclose(half, (states[finger] + as_planned[finger])[carried, :3, 3] / 2)
    assert np.allclose(states["gripper_palm"], as_planned["gripper_palm"], atol=1e-12)
    # A tool that holds the part from the start has it where it is to stand.
    from_start = tuple(primitive for primitive in stage.motion.primitives if primitive.held == "red1")
    pieces = cut_into_pieces([(primitive.start, primitive.end) for primitive in from_start], ())
    carrying = Stage(stage.model, replace(stage.motion, primitives=from_start), pieces, stage.X_WO).once_lost()
    lies = carrying.states(Samples(np.zeros(1, dtype=np.int64), np.array([from_start[0].start]))).X_WF["red1"]
    assert np.array_equal(lies[0], stage.motion.final.X_WO["red1"])
    assert not np.allclose(lies[0], stage.X_WO["red1"])
