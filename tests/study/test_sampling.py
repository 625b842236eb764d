"""Adaptive sampling against dense fixed sampling, and fixed sampling against its stated shortfall."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Place
from sqrp_cli.geometry import Mask, box_corners, transform
from sqrp_cli.logic.formula import bind
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators
from sqrp_cli.logic.literal import Literal
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.sampling import (
    DEFAULT_TOLERANCE,
    MAX_MOTION,
    Adaptive,
    FixedCount,
    FixedStep,
    Sampling,
    first_samples,
    longest_step,
)
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import Timeline, look_at, look_closely, observe
from sqrp_cli.task.pieces import cut_into_pieces, monitored_times
from sqrp_cli.task.task import read_task
from tests.cells import read_cases
from tests.conftest import TABLETOP
from tests.sight.views import make_camera
from tests.task.studies import HOLD, WatchedMotion, always, watched_motion

DENSE = int(os.environ.get("SQRP_DENSE_SAMPLES", "2000"))
"""Samples per primitive of the reference."""

SCENES = 5


Difference = tuple[str, float, float, int]
"""Name, by how much the error of an adaptive Q exceeds what is stated, the error [points], and changes of coverage."""


def changed(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return covered[1:] != covered[:-1]


def compare(name: str, adaptive: Timeline, dense: Timeline) -> list[Difference]:
    """The differences of Q_avg and, where there is one, Q_eoi from a dense reference.

    The reference cannot tell half of the steps in which it changes; events that are shorter than the largest gap may be
    missed.
    """
    edges = np.flatnonzero(changed(dense.covered))
    lengths = np.diff(dense.samples.t[edges + 1])
    short = float(lengths[lengths < adaptive.largest_gap].sum())
    found = []
    for quality, length, rows in (
        ("q_avg", dense.planned.T, np.ones(len(dense.samples), dtype=bool)),
        ("q_eoi", dense.planned.T_eoi, dense.of_interest),
    ):
        approximate, reference = (getattr(one.qualities, quality) for one in (adaptive, dense))
        if approximate is None or reference is None:
            assert approximate == reference
            continue
        turning = changed(dense.covered) & rows[1:] & rows[:-1]
        unsure = 0.5 * float(dense.samples.gaps[turning].sum()) / length
        error = abs(approximate - (reference + unsure))
        allowed = DEFAULT_TOLERANCE + unsure + short / length
        found.append((name, error - allowed, 100 * error, int(turning.sum())))
    return found


def judge(title: str, found: list[Difference]) -> None:
    """Print the largest error, and assert that every one is within the tolerance that the default states."""
    name, _, largest, _ = max(found, key=lambda one: one[2])
    print(f"\n{title}: largest error of Q {largest:.4f} points ({name}), {DENSE} samples per primitive, ", end="")
    print(f"{sum(turns for *_, turns in found)} transitions in {len(found)} values of Q")
    assert [one for one in found if one[1] > 0.0] == []


@pytest.mark.parametrize("name", [pytest.param("tabletop", marks=pytest.mark.trial), "screws", "tower"])
def test_the_default_is_within_its_tolerance_on_every_candidate_of_every_shipped_workspace(name: str) -> None:
    cell, found = Cell.load(load_workspace(TABLETOP.parent / name)), list[Difference]()
    tasks = (read_task(task.task, cell.workspace) for task in cell.workspace.tasks)
    for candidate in (candidate for task in tasks for candidate in task.candidates):
        studied = analyse(cell, candidate, cell.initial_world, Adaptive(), full=False)
        if isinstance(studied, Analysis):
            dense = observe(studied.planned, cell.observer, FixedCount(DENSE), full=False)
            found += compare(candidate.name, studied.timeline, dense)
    judge(name, found)


def test_the_default_is_within_its_tolerance_on_random_scenes(ur5: RobotModel) -> None:
    found = []
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        found += compare(f"scene {seed}", motion.timeline(Adaptive()), motion.timeline(FixedCount(DENSE)))
    assert sum(turns for *_, turns in found) > 2 * SCENES
    judge("random scenes", found)


@pytest.fixture(scope="module")
def watched_finely(ur5: RobotModel) -> list[tuple[WatchedMotion, Timeline]]:
    """The random scenes, each with its time line at a tolerance of a millionth."""
    motions = [watched_motion(seed, ur5) for seed in range(SCENES)]
    return [(motion, motion.timeline(Adaptive(1e-6))) for motion in motions]


def test_a_tighter_tolerance_is_kept_too(watched_finely: list[tuple[WatchedMotion, Timeline]]) -> None:
    for motion, fine in watched_finely:
        coarse = motion.timeline(Adaptive(1e-2))
        assert fine.transition_error <= 1e-6
        assert coarse.transition_error <= 1e-2
        assert coarse.qualities.q_avg == pytest.approx(fine.qualities.q_avg, abs=1e-2)


@pytest.mark.parametrize("sampling", [FixedCount(5), FixedCount(23), FixedStep(0.21), FixedStep(0.05)])
def test_the_shortfall_of_fixed_sampling_is_at_most_transitions_times_spacing(
    watched_finely: list[tuple[WatchedMotion, Timeline]], sampling: Sampling
) -> None:
    for motion, fine in watched_finely:
        coarse = motion.timeline(sampling)
        spacing = float(coarse.samples.gaps.max())
        length = (fine.qualities.q_avg - coarse.qualities.q_avg) * fine.planned.T
        assert abs(length) <= (changed(fine.covered).sum() + 1e-3) * spacing


def test_fixed_samples_are_where_they_were_asked_for(ur5: RobotModel) -> None:
    motion = watched_motion(3, ur5)
    primitives = motion.stage.motion.primitives
    count = first_samples(FixedCount(7), motion.stage, motion.observer, motion.targets)
    step = first_samples(FixedStep(0.3), motion.stage, motion.observer, motion.targets)
    edges = {time for piece in motion.stage.pieces for time in (piece.start, piece.end)}
    for primitive in primitives:
        equal = np.linspace(primitive.start, primitive.end, 7)
        every = np.append(np.arange(primitive.start, primitive.end, 0.3), primitive.end)
        for samples, wanted in ((count, equal), (step, every)):
            of_primitive = [motion.stage.pieces[number].primitive for number in samples.piece]
            own = samples.t[[primitives[index] is primitive for index in of_primitive]]
            assert all(np.abs(own - time).min() < 2e-9 for time in wanted)
            assert all(np.abs(wanted - time).min() < 2e-9 or time in edges for time in own)


def test_both_ends_of_every_primitive_and_interval_are_samples_in_every_mode(ur5: RobotModel) -> None:
    motion = watched_motion(5, ur5)
    edges = [time for p in (*motion.stage.motion.primitives, *motion.formulas) for time in (p.start, p.end)]
    for sampling in (FixedCount(2), FixedStep(10.0), Adaptive()):
        t = motion.timeline(sampling).samples.t
        assert all(np.abs(t - time).min() < 1e-9 for time in edges), sampling


def test_nothing_moves_further_than_stated_between_adaptive_samples(ur5: RobotModel) -> None:
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        samples = first_samples(Adaptive(), motion.stage, motion.observer, motion.targets)
        states = motion.stage.states(samples)
        tracks = [transform(states.X_WF[s.part.parent], s.corners) for s in motion.observer.solids]
        tracks += [transform(states.box_poses(b), box_corners(b.size)) for t in motion.targets for b in t.boxes]
        moving = np.concatenate([track for track in tracks if len(track) > 1], axis=1)
        steps = np.linalg.norm(np.diff(moving, axis=0), axis=2).max(axis=1)
        assert steps[np.diff(samples.piece) == 0].max() <= 1.02 * MAX_MOTION


def moving_pieces(stage: Stage) -> Mask:
    """In which pieces something moves."""
    stands = [primitive.trajectory.stands for primitive in stage.motion.primitives]
    return np.array([not stands[piece.primitive] for piece in stage.pieces])


def between(motion: WatchedMotion, samples: Samples) -> NDArray[np.float64]:
    """The times between samples of one piece where something moves and must be seen."""
    piece, stage = samples.piece, motion.stage
    asked = np.array([bool(p.literals) for p in stage.pieces]) & moving_pieces(stage)
    return np.diff(samples.t)[(np.diff(piece) == 0) & asked[piece[:-1]]]


def test_no_more_than_50_ms_pass_between_adaptive_samples_where_something_moves(ur5: RobotModel) -> None:
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        samples = first_samples(Adaptive(), motion.stage, motion.observer, motion.targets)
        period = min(1 / camera.rate for camera in motion.observer.cameras)
        assert between(motion, samples).max() <= min(0.05, period) + 1e-9
        assert motion.timeline(Adaptive()).largest_gap <= min(0.05, period) + 1e-9
        standing = [number for number, moves in enumerate(moving_pieces(motion.stage)) if not moves]
        assert standing
        assert all((samples.piece == number).sum() <= 2 for number in standing)


@pytest.mark.parametrize(("rates", "longest"), [((10.0,), 0.05), ((10.0, 40.0), 0.025), ((5000.0,), 0.001), ((), 0.05)])
def test_the_fastest_camera_decides_how_much_time_may_pass(rates: tuple[float, ...], longest: float) -> None:
    assert longest_step(make_camera(rate=rate) for rate in rates) == pytest.approx(longest)


def with_formulas(motion: WatchedMotion, *formulas: GroundOperator) -> WatchedMotion:
    """The same motion, monitored otherwise."""
    spans = [(p.start, p.end) for p in motion.stage.motion.primitives]
    stage = motion.stage
    cut = Stage(stage.model, stage.motion, cut_into_pieces(spans, formulas), stage.motion.primitives[0].X_WO)
    return WatchedMotion(cut, motion.observer, motion.targets, formulas, {})


def test_where_an_object_is_attached_the_instant_is_sampled_with_and_without_it(ur5: RobotModel) -> None:
    motion = watched_motion(1, ur5)
    grasp, carry = motion.stage.motion.primitives[1:]
    timeline = with_formulas(motion, always(0.0, motion.stage.motion.time, Literal(HOLD))).timeline(Adaptive())
    at = np.flatnonzero(np.abs(timeline.samples.t - grasp.end) < 1e-9)
    assert len(at) == 2
    left, right = (timeline.planned.stage.pieces[number].primitive for number in timeline.samples.piece[at])
    assert [motion.stage.motion.primitives[index].held for index in (left, right)] == [None, "cube"]
    assert carry.start == grasp.end


def test_what_no_formula_covers_is_neither_covered_nor_counted(ur5: RobotModel) -> None:
    motion = watched_motion(6, ur5)
    time, hold = motion.stage.motion.time, Literal(HOLD)
    watched = with_formulas(motion, always(0.0, 1.0, hold), always(time - 1.0, time, hold.negated()))
    timeline = watched.timeline(FixedCount(50))
    inside = (timeline.samples.t > 1.0 + 1e-9) & (timeline.samples.t < time - 1.0 - 1e-9)
    assert pytest.approx(2.0) == timeline.planned.T
    assert not timeline.monitored[inside].any()
    assert not timeline.covered[inside].any()
    assert 0 <= timeline.qualities.q_avg <= 1


@settings(max_examples=25, deadline=None)
@given(cut=st.floats(0.05, 0.95), seed=st.integers(0, 5))
def test_an_interval_cut_in_two_that_touch_has_the_same_quality(ur5: RobotModel, cut: float, seed: int) -> None:
    motion = watched_motion(seed, ur5)
    time, hold = motion.stage.motion.time, Literal(HOLD)
    whole = with_formulas(motion, always(0.0, time, hold)).timeline(Adaptive(1e-6))
    parts = with_formulas(motion, always(0.0, cut * time, hold), always(cut * time, time, hold))
    assert parts.timeline(Adaptive(1e-6)).qualities.q_avg == pytest.approx(whole.qualities.q_avg, abs=1e-5)


SPANS = {"a1": (0.0, 1.0), "a2": (1.0, 1.5), "a3": (1.5, 4.0)}


@pytest.mark.parametrize(("text", "T", "T_eoi", "edges"), read_cases("logic.yaml")["pieces"])
def test_pieces_begin_and_end_where_the_formulas_say(text: str, T: float, T_eoi: float, edges: list[float]) -> None:
    formula = bind(parse_formula(text, Place(Path("skill.yaml"))), {}, {"p": ((),), "q": ((),)})
    formulas = ground_operators(formula, SPANS, 4.0)
    pieces = cut_into_pieces(list(SPANS.values()), formulas)
    assert monitored_times(formulas) == pytest.approx((T, T_eoi))
    assert {round(time, 9) for piece in pieces for time in (piece.start, piece.end)} == set(edges)
    for piece in pieces:
        middle = (piece.start + piece.end) / 2
        applying = [one for one in formulas if one.start - 1e-9 <= middle <= one.end + 1e-9]
        assert set(piece.literals) == {literal for operator in applying for literal in operator.literals}
        assert piece.of_interest == any(operator.operator == "eventually" for operator in applying)


@pytest.mark.parametrize("seed", range(4))
def test_a_look_sees_what_a_close_look_sees(seed: int, ur5: RobotModel) -> None:
    motion = watched_motion(seed, ur5, min_visible=1.0 if seed % 2 else 0.5)
    samples = first_samples(FixedCount(9), motion.stage, motion.observer, motion.targets)
    found = look_at(motion.observer, motion.planned, samples)
    close = look_closely(motion.observer, motion.planned, samples)
    for name in ("looked", "required", "known", "covered"):
        assert np.array_equal(getattr(found, name), getattr(close, name)), name
    assert found.covered.any()
    assert not found.covered.all()


@pytest.mark.parametrize("seed", range(3))
def test_what_neighbours_agree_on_is_kept_and_the_rest_is_looked_at(seed: int, ur5: RobotModel) -> None:
    motion = watched_motion(seed, ur5)
    samples = first_samples(FixedCount(9), motion.stage, motion.observer, motion.targets)
    seen = look_at(motion.observer, motion.planned, samples)
    rows = np.arange(len(samples) - 1)
    known = seen.agreed(rows, rows + 1)
    between = Samples(samples.piece[:-1], samples.t[:-1])  # the same instants: the answer is known
    again = look_at(motion.observer, motion.planned, between, known)
    assert np.array_equal(again.covered, seen.covered[:-1])
    assert known.known.any()
    assert not known.known.all()
    nothing = Samples(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert len(look_at(motion.observer, motion.planned, nothing).covered) == 0
