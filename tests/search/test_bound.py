"""Bounds rule out nothing that the exact timeline accepts, and kernel and observer see the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import displacement
from sqrp_cli.motion.cell import Cell
from sqrp_cli.search.bound import CameraBound
from sqrp_cli.search.goal import read_goal
from sqrp_cli.search.question import ProposedChange, analysed_again
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.stage import Samples
from sqrp_cli.study.whole_analysis import WholeAnalysis, whole_analysis
from sqrp_cli.task.task import read_task

SAMPLING = Adaptive()


@pytest.fixture(scope="module")
def cell(tabletop) -> Cell:
    return Cell.load(tabletop)


@pytest.fixture(scope="module")
def studied(cell) -> WholeAnalysis:
    found = whole_analysis(
        cell, read_task("pickup g4", cell.workspace).candidates[0], cell.initial_world, SAMPLING, full=True
    )
    assert isinstance(found, WholeAnalysis)
    return found


def moved(camera, rng, count: int) -> np.ndarray:
    """Poses near that of a camera, and some farther away."""
    sizes = rng.choice([0.01, 0.05, 0.2], count)
    return np.array([camera.X_FC @ displacement(s * rng.normal(size=3), 0.5 * s * rng.normal(size=3)) for s in sizes])


@pytest.fixture(scope="module", params=["cam2", "cam6", pytest.param("cam5", marks=pytest.mark.trial)])
def elsewhere(request, cell, studied) -> tuple[str, np.ndarray, list[CandidateResult]]:
    """A camera, other poses of it, and the exact figures of the candidate with each."""
    entry = cell.workspace.cameras[request.param]
    poses = moved(entry, np.random.default_rng(0), 30)
    changes = [
        ProposedChange(kind="position", target=entry.name, size=0.0, unit="m", camera=replace(entry, X_FC=X_FC))
        for X_FC in poses
    ]
    return entry.name, poses, [analysed_again(one.in_cell(cell), studied, SAMPLING).result for one in changes]


@pytest.mark.parametrize(
    "goal", ["q_eoi 60 %", "q_avg 80 %", "delay 1.3 s", "q_eoi 100 %", "q_eoi 60 %, q_avg 80 %, delay 2 s"]
)
def test_what_meets_a_goal_passes_the_look(cell, studied, elsewhere, goal):
    camera, poses, found = elsewhere
    wanted, index = read_goal(goal), list(cell.workspace.cameras).index(camera)
    entry = cell.workspace.cameras[camera]
    bound = CameraBound(cell, studied.steps, wanted, index)
    for figures, passes in zip(found, bound.passes([entry], poses), strict=True):
        assert passes or not wanted.met(figures)


@pytest.mark.parametrize("goal", ["q_eoi 60 %", "q_avg 80 %", "delay 1.3 s"])
def test_some_poses_pass_and_some_do_not(cell, studied, goal):
    entry = cell.workspace.cameras["cam2"]
    bound = CameraBound(cell, studied.steps, read_goal(goal), 1)
    passes = bound.passes([entry], moved(entry, np.random.default_rng(0), 100))
    assert 0 < passes.sum() < 100


def test_failures_of_the_exact_timeline_are_looked_at_next(cell, studied):
    steps = studied.steps
    whole = CameraBound(cell, steps, read_goal("q_eoi 100 %"), 1)
    (samples,) = whole.samples
    few = CameraBound(cell, steps, read_goal("q_eoi 100 %"), 1, [Samples(samples.piece[:1], samples.t[:1])])
    (sharper,) = few.sharper([step.timeline for step in steps]).samples
    assert len(sharper) > 1
    assert np.all(np.diff(sharper.piece) >= 0)


@pytest.mark.parametrize("camera", ["cam1", "cam2", "cam6"])
def test_a_moved_camera_sees_what_the_observer_sees_from_there(cell, studied, camera):
    entry, rng = cell.workspace.cameras[camera], np.random.default_rng(3)
    bound = CameraBound(cell, studied.steps, read_goal("q_avg 100 %"), 0)
    target, state = (axis.reshape(-1) for axis in np.indices((len(bound.targets), len(bound.samples[0]))))
    items, poses = (bound.targets, bound.states, state, target), moved(entry, rng, 6)
    (sees,) = cell.observer.seen_from([entry], poses, *items)
    decisive = rng.random(len(state)) < 0.05
    (given_up,) = cell.observer.seen_from([entry], poses, *items, decisive=decisive)
    missed = np.cumsum(decisive & ~sees, axis=1) - (decisive & ~sees) > 0  # a decisive item before it is not seen
    np.testing.assert_array_equal(given_up, sees & ~missed)
    observer = Observer(tuple(replace(entry, X_FC=X_FC) for X_FC in poses), cell.observer.solids)
    matrix = observer.verdicts(bound.targets, bound.states)
    expected = np.concatenate([sees_all(boxes) for boxes in matrix])
    np.testing.assert_array_equal(sees, expected.T)
