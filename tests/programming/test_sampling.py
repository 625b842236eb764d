"""Adaptive sampling against dense fixed sampling, and fixed sampling against its stated shortfall."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sqrp_cli.errors import Place
from sqrp_cli.geometry import box_corners, transform
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.logic.formula_time import ground_operators
from sqrp_cli.logic.literal import Literal
from sqrp_cli.logic.mtl import bind, parse_formula
from sqrp_cli.programming.assessment import Study, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.kinematics import RobotModel
from sqrp_cli.programming.pieces import GroundFormula, cut_into_pieces, interesting_time, monitored_time
from sqrp_cli.programming.quality import average_quality, interest_quality
from sqrp_cli.programming.sampling import (
    DEFAULT_TOLERANCE,
    MAX_MOTION,
    Adaptive,
    FixedCount,
    FixedStep,
    Sampling,
    first_samples,
)
from sqrp_cli.programming.stage import Stage
from sqrp_cli.programming.task import read_task
from sqrp_cli.programming.timeline import Timeline, observe
from tests.programming.studies import HOLD, WatchedMotion, always, eventually, watched_motion

DENSE = int(os.environ.get("SQRP_DENSE_SAMPLES", "2000"))
"""Samples per primitive of the reference."""

SCENES = 10


@dataclass(frozen=True)
class Difference:
    """How far an adaptive Q is from the reference, beyond what the reference itself cannot tell. In points of Q.

    missed: of this, what events shorter than the largest gap explain.
    """

    name: str
    error: float
    missed: float
    transitions: int


def changes(covered: NDArray[np.bool_]) -> int:
    return int((covered[1:] != covered[:-1]).sum())


def compare(name: str, adaptive: Timeline, dense: Timeline) -> Difference:
    """The larger of the differences of Q_avg and Q_eoi."""
    t, worst, missed = dense.samples.t, 0.0, 0.0
    edges = np.flatnonzero(np.diff(dense.covered.astype(int)) != 0)
    lengths = np.diff(t[edges + 1])
    short = float(lengths[lengths < adaptive.largest_gap].sum())
    pairs = [(average_quality, dense.T, slice(None)), (interest_quality, dense.T_eoi, dense.interesting)]
    for quality, length, rows in pairs:
        found, reference = quality(adaptive), quality(dense)
        if found is None or reference is None:
            assert found == reference
            continue
        resolution = changes(dense.covered[rows]) * float(np.nanmax(dense.steps)) / length
        error = abs(found - reference) - resolution
        if error > worst:
            worst, missed = error, short / length
    return Difference(name, 100 * worst, 100 * missed, changes(dense.covered))


def again(cell: Cell, studied: Study, sampling: Sampling) -> Timeline:
    """The time line of a candidate with another sampling."""
    times = studied.timeline.T, studied.timeline.T_eoi
    faults = studied.timeline.faults
    return observe(studied.stage, cell.observer, studied.targets, faults, sampling, times, full=False)


def report(title: str, found: list[Difference]) -> None:
    largest = max(found, key=lambda difference: difference.error)
    print(f"\n{title}: largest error of Q {largest.error:.4f} points ({largest.name}), reference of {DENSE} samples")
    for difference in found:
        print(f"  {difference.name}: {difference.error:.4f} points, {difference.transitions} transitions")


def assert_within_tolerance(found: list[Difference]) -> None:
    tolerance = 100 * DEFAULT_TOLERANCE
    assert [d for d in found if d.error > tolerance + d.missed] == []


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


@pytest.fixture(scope="module")
def studies(cell: Cell, tabletop: Workspace) -> Mapping[str, Study]:
    """The feasible candidates of the task that the tabletop is for."""
    world = tabletop.initial_world
    found = {c.name: study(cell, c, world, Adaptive(), full=False) for c in read_task("pickup green", tabletop).candidates}
    return {name: result for name, result in found.items() if isinstance(result, Study)}


def test_the_default_is_within_its_tolerance_on_every_candidate_of_the_tabletop(
    cell: Cell, studies: Mapping[str, Study]
) -> None:
    assert studies
    found = [compare(name, s.timeline, again(cell, s, FixedCount(DENSE))) for name, s in studies.items()]
    report("tabletop", found)
    assert_within_tolerance(found)


def test_the_default_is_within_its_tolerance_on_random_scenes(ur5: RobotModel) -> None:
    found = []
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        found.append(compare(f"scene {seed}", motion.timeline(Adaptive()), motion.timeline(FixedCount(DENSE))))
    report("random scenes", found)
    assert sum(difference.transitions for difference in found) > 2 * SCENES
    assert_within_tolerance(found)


def test_a_tighter_tolerance_is_kept_too(ur5: RobotModel) -> None:
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        fine, coarse = motion.timeline(Adaptive(1e-6)), motion.timeline(Adaptive(1e-2))
        assert fine.transition_error <= 1e-6
        assert coarse.transition_error <= 1e-2
        assert average_quality(coarse) == pytest.approx(average_quality(fine), abs=1e-2)


@pytest.mark.parametrize("sampling", [FixedCount(5), FixedCount(23), FixedStep(0.21), FixedStep(0.05)])
def test_the_shortfall_of_fixed_sampling_is_at_most_transitions_times_spacing(
    ur5: RobotModel, sampling: Sampling
) -> None:
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        fine, coarse = motion.timeline(Adaptive(1e-5)), motion.timeline(sampling)
        spacing = float(np.nanmax(coarse.steps))
        length = (average_quality(fine) - average_quality(coarse)) * fine.T
        assert abs(length) <= (changes(fine.covered) + 1e-3) * spacing


def test_fixed_samples_are_where_they_were_asked_for(ur5: RobotModel) -> None:
    motion = watched_motion(3, ur5)
    primitives = motion.stage.motion.primitives
    count = first_samples(FixedCount(7), motion.stage, motion.observer.solids, motion.targets)
    step = first_samples(FixedStep(0.3), motion.stage, motion.observer.solids, motion.targets)
    edges = {time for piece in motion.stage.pieces for time in (piece.start, piece.end)}
    for primitive in primitives:
        equal = np.linspace(primitive.start, primitive.end, 7)
        every = np.append(np.arange(primitive.start, primitive.end, 0.3), primitive.end)
        for samples, wanted in ((count, equal), (step, every)):
            of_primitive = [motion.stage.pieces[number].primitive for number in samples.piece]
            own = samples.t[[primitives[index] is primitive for index in of_primitive]]
            assert all(np.abs(own - time).min() < 2e-9 for time in wanted)
            assert all(np.abs(wanted - time).min() < 2e-9 or time in edges for time in own)


@pytest.mark.parametrize("sampling", [FixedCount(2), FixedStep(10.0), Adaptive()])
def test_both_ends_of_every_primitive_and_interval_are_samples_in_every_mode(
    ur5: RobotModel, sampling: Sampling
) -> None:
    motion = watched_motion(5, ur5)
    t = motion.timeline(sampling).samples.t
    edges = [time for p in motion.stage.motion.primitives for time in (p.start, p.end)]
    edges += [time for f in motion.formulas for time in (f.operator.start, f.operator.end)]
    assert all(np.abs(t - time).min() < 1e-9 for time in edges)


def test_nothing_moves_further_than_stated_between_adaptive_samples(ur5: RobotModel) -> None:
    for seed in range(SCENES):
        motion = watched_motion(seed, ur5)
        samples = first_samples(Adaptive(), motion.stage, motion.observer.solids, motion.targets)
        states = motion.stage.states(samples)
        tracks = [transform(states.X_WF[s.part.parent], s.corners) for s in motion.observer.solids]
        tracks += [transform(states.box_poses(b), box_corners(b.size)) for t in motion.targets for b in t.boxes]
        moving = np.concatenate([track for track in tracks if len(track) > 1], axis=1)
        steps = np.linalg.norm(np.diff(moving, axis=0), axis=2).max(axis=1)
        assert steps[np.diff(samples.piece) == 0].max() <= 1.02 * MAX_MOTION


def with_formulas(motion: WatchedMotion, *formulas: GroundFormula) -> WatchedMotion:
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
    left, right = (timeline.pieces[number].primitive for number in timeline.samples.piece[at])
    assert [motion.stage.motion.primitives[index].held for index in (left, right)] == [None, "cube"]
    assert carry.start == grasp.end


def test_a_formula_at_an_instant_is_sampled_there_and_has_no_quality(ur5: RobotModel) -> None:
    motion = with_formulas(watched_motion(1, ur5), eventually(0.4, 0.4, Literal(HOLD)))
    timeline = motion.timeline(Adaptive())
    assert timeline.samples.t[timeline.monitored] == pytest.approx([0.4])
    assert average_quality(timeline) is None
    assert interest_quality(timeline) is None


def test_what_no_formula_covers_is_neither_covered_nor_counted(ur5: RobotModel) -> None:
    motion = watched_motion(6, ur5)
    time, hold = motion.stage.motion.time, Literal(HOLD)
    watched = with_formulas(motion, always(0.0, 1.0, hold), always(time - 1.0, time, hold.negated()))
    timeline = watched.timeline(FixedCount(50))
    inside = (timeline.samples.t > 1.0 + 1e-9) & (timeline.samples.t < time - 1.0 - 1e-9)
    assert timeline.T == pytest.approx(2.0)
    assert not timeline.monitored[inside].any()
    assert not timeline.covered[inside].any()
    assert 0 <= average_quality(timeline) <= 1


@settings(max_examples=25, deadline=None)
@given(cut=st.floats(0.05, 0.95), seed=st.integers(0, 5))
def test_an_interval_cut_in_two_that_touch_has_the_same_quality(ur5: RobotModel, cut: float, seed: int) -> None:
    motion = watched_motion(seed, ur5)
    time, hold = motion.stage.motion.time, Literal(HOLD)
    whole = with_formulas(motion, always(0.0, time, hold)).timeline(Adaptive(1e-6))
    parts = with_formulas(motion, always(0.0, cut * time, hold), always(cut * time, time, hold))
    assert average_quality(parts.timeline(Adaptive(1e-6))) == pytest.approx(average_quality(whole), abs=1e-5)


SPANS = {"a1": (0.0, 1.0), "a2": (1.0, 1.5), "a3": (1.5, 4.0)}


@pytest.mark.parametrize(
    ("text", "T", "T_eoi", "edges"),
    [
        ("always[a1.start, a2.end] p", 1.5, 0.0, {0.0, 1.0, 1.5, 4.0}),
        ("eventually[a1.end + 0.2, a3.start + 0.5] p", 0.8, 0.8, {0.0, 1.0, 1.2, 1.5, 2.0, 4.0}),
        ("always[0, 1] p and eventually[1, 2] q", 2.0, 1.0, {0.0, 1.0, 1.5, 2.0, 4.0}),
        ("always[1, 2] eventually[0, 0.5] p", 1.5, 1.5, {0.0, 1.0, 1.5, 2.0, 2.5, 4.0}),
        ("always[1, 2] (p and eventually[2, 5] q)", 2.0, 1.0, {0.0, 1.0, 1.5, 2.0, 3.0, 4.0}),
        ("not eventually[3, 9] p", 1.0, 1.0, {0.0, 1.0, 1.5, 3.0, 4.0}),
        ("p and always[2, 2] q", 0.0, 0.0, {0.0, 1.0, 1.5, 2.0, 4.0}),
    ],
)
def test_pieces_begin_and_end_where_the_formulas_say(text: str, T: float, T_eoi: float, edges: set[float]) -> None:
    formula = bind(parse_formula(text, Place(Path("skill.yaml"))), {}, {"p": ((),), "q": ((),)})
    formulas = tuple(GroundFormula(operator, None) for operator in ground_operators(formula, SPANS, 4.0))
    pieces = cut_into_pieces(list(SPANS.values()), formulas)
    assert monitored_time(formulas) == pytest.approx(T)
    assert interesting_time(formulas) == pytest.approx(T_eoi)
    assert {round(time, 9) for piece in pieces for time in (piece.start, piece.end)} == edges
    for piece in pieces:
        middle = (piece.start + piece.end) / 2
        applying = [f.operator for f in formulas if f.operator.start - 1e-9 <= middle <= f.operator.end + 1e-9]
        assert set(piece.literals) == {literal for operator in applying for literal in operator.literals}
        assert piece.of_interest == any(operator.operator == "eventually" for operator in applying)
