"""Many motions looked at together have the coverage that each has by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import displacement, pose
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.coverage import observation
from sqrp_cli.programming.coverage.observation import Look, look_at
from sqrp_cli.programming.coverage.sampling import Adaptive, FixedCount, first_samples
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.coverage.timeline import observe_all
from sqrp_cli.programming.pieces import cut_into_pieces
from tests.programming.studies import WatchedMotion, make_motion, watched_motion
from tests.programming.timelines import fault_response

COUNT = FixedCount(9)


def _variant(watched: WatchedMotion, model: RobotModel, rng: np.random.Generator, *, same_place: bool) -> WatchedMotion:
    """Another motion in the same cell: another path, another grasp, and boxes elsewhere in their frames."""
    middle = model.home + rng.uniform(-0.8, 0.8, 6)
    waypoints = np.stack([middle + rng.uniform(-1, 1, 6), middle, middle + rng.uniform(-1, 1, 6)])
    X_TO = pose(position=(0.0, 0.0, 0.025)) @ displacement(rng.normal(0, 0.01, 3), rng.normal(0, 0.2, 3))
    motion = make_motion(model, waypoints, float(rng.uniform(0.2, 1.0)), X_TO)
    spans = [(primitive.start, primitive.end) for primitive in motion.primitives]
    X_start = watched.stage.X_WO["cube"] if same_place else motion.primitives[0].X_WO["cube"]
    hold, placed = watched.targets
    (box,) = hold.boxes
    moved = replace(box, X_FB=displacement(rng.normal(0, 0.01, 3), rng.normal(0, 0.3, 3)))
    return replace(
        watched,
        stage=Stage(model, motion, cut_into_pieces(spans, watched.formulas), {"cube": X_start}),
        targets=(replace(hold, boxes=(moved,)), placed),
    )


def _look(watched: WatchedMotion) -> Look:
    samples = first_samples(COUNT, watched.stage, watched.observer, watched.targets)
    return Look(watched.stage, watched.targets, samples, watched.faults)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("same_place", [True, False])
@pytest.mark.parametrize("together", [10, 4000])
def test_a_look_at_many_motions_sees_what_a_look_at_each_sees(
    seed: int, same_place: bool, together: int, ur5: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observation, "_STATES_TOGETHER", together)
    rng = np.random.default_rng(seed)
    first = watched_motion(seed, ur5, min_visible=1.0 if seed % 2 else 0.5)
    motions = [first, *(_variant(first, ur5, rng, same_place=same_place) for _ in range(5))]
    found = look_at(first.observer, list(map(_look, motions)))
    seen = 0
    for motion, looked in zip(motions, found, strict=True):
        alone = motion.timeline(COUNT)
        assert np.array_equal(looked.required, alone.observation.required)
        assert np.array_equal(looked.states_covered, alone.covered)
        looked_at = replace(alone, observation=looked)
        assert np.array_equal(fault_response(looked_at, "slip"), fault_response(alone, "slip"), equal_nan=True)
        seen += int(alone.covered.sum())
    assert seen > 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("full", [False, True])
def test_motions_observed_together_have_the_timelines_that_each_has_alone(
    seed: int, full: bool, ur5: RobotModel
) -> None:
    rng = np.random.default_rng(seed)
    first = watched_motion(seed, ur5, min_visible=0.5 if seed % 2 else 1.0)
    motions = [first, *(_variant(first, ur5, rng, same_place=False) for _ in range(3))]
    together = observe_all([motion.watch for motion in motions], first.observer, Adaptive(), full=full)
    for motion, timeline in zip(motions, together, strict=True):
        alone = motion.timeline(Adaptive(), full=full)
        assert np.array_equal(timeline.samples.t, alone.samples.t)
        for name in ("looked", "required", "known", "covered"):
            assert np.array_equal(getattr(timeline.observation, name), getattr(alone.observation, name)), name
        assert np.array_equal(timeline.observation.response, alone.observation.response, equal_nan=True)
        assert timeline.largest_gap == alone.largest_gap
    assert observe_all([], first.observer, Adaptive(), full=full) == []


def test_a_target_that_decides_nothing_more_is_left_out_without_its_fault(ur5: RobotModel) -> None:
    watched = watched_motion(1, ur5)
    complete = look_at(watched.observer, [_look(watched)])[0]
    quick = look_at(watched.observer, [replace(_look(watched), faults={})])[0]
    assert np.array_equal(quick.states_covered, complete.states_covered)
    assert quick.known.sum() <= complete.known.sum()


def test_no_motions_and_motions_without_samples_have_no_coverage(ur5: RobotModel) -> None:
    watched = watched_motion(0, ur5)
    nothing = Samples(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert look_at(watched.observer, []) == ()
    (alone,) = look_at(watched.observer, [replace(_look(watched), samples=nothing)])
    assert len(alone.covered) == 0
    empty, some = look_at(watched.observer, [replace(_look(watched), samples=nothing), _look(watched)])
    assert len(empty.covered) == 0
    assert np.array_equal(some.states_covered, watched.timeline(COUNT).covered)
