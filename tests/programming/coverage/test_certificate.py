"""Certificates of qualities against draws of camera poses, some as far off as they may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import displacement
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, study
from sqrp_cli.programming.coverage.certificate import Certificate, certify
from sqrp_cli.programming.coverage.quality import NO_FIGURES, Qualities
from sqrp_cli.programming.coverage.sampling import Adaptive, FixedCount, Sampling
from sqrp_cli.programming.coverage.timeline import observe
from sqrp_cli.programming.ranking import may_overtake, rank
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.task import read_task

BOUNDS = PoseBounds(0.002, 0.0035)
DRAWS = 12


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


def studied(cell: Cell, sampling: Sampling, task: str = "pickup g4") -> Study:
    candidate = read_task(task, cell.workspace).candidates[0]
    found = study(cell, candidate, cell.initial_world, sampling, full=False)
    assert isinstance(found, Study)
    return found


def drawn(observer: Observer, bounds: PoseBounds, draw: int) -> Observer:
    """Every camera off by as much as it may be; in every other draw anywhere in between."""
    random = np.random.default_rng([7, draw])
    errors = random.normal(size=(len(observer.cameras), 2, 3))
    errors /= np.linalg.norm(errors, axis=2, keepdims=True)
    errors *= random.uniform(size=(len(errors), 2, 1)) ** (draw % 2)
    cameras = (
        replace(c, X_FC=c.X_FC @ displacement(bounds.position * moved, bounds.rotation * turned))
        for c, (moved, turned) in zip(observer.cameras, errors, strict=True)
    )
    return Observer(tuple(cameras), observer.solids)


@pytest.mark.parametrize("sampling", [Adaptive(), FixedCount(30)], ids=["adaptive", "fixed"])
def test_no_draw_leaves_the_proven_intervals(cell: Cell, sampling: Sampling) -> None:
    found = studied(cell, sampling)
    proven = certify(found, cell.observer, sampling, BOUNDS)
    draws = [
        Qualities.of(observe(found, drawn(cell.observer, BOUNDS, draw), sampling, full=False)) for draw in range(DRAWS)
    ]
    for name in ("q_avg", "q_eoi"):
        least, most = getattr(proven.least, name), getattr(proven.most, name)
        values = [getattr(one, name) for one in [Qualities.of(found.timeline), *draws]]
        assert least - 1e-12 <= min(values)
        assert max(values) <= most + 1e-12
        assert most - least < 0.3  # it says something


def test_times_that_one_camera_decides_are_proven_by_one_pose_of_it(cell: Cell) -> None:
    """Six changes of g5's sight depend on one camera; how they move against each other is found by moving only that."""
    found, bounds = studied(cell, Adaptive(), "pickup g5"), PoseBounds(0.002, np.radians(0.2))
    proven = certify(found, cell.observer, Adaptive(), bounds)

    def from_beside(camera: int, angle: float) -> float:
        cameras = list(cell.observer.cameras)
        off = bounds.position * np.array([np.cos(angle), np.sin(angle), 0.0])
        cameras[camera] = replace(cameras[camera], X_FC=cameras[camera].X_FC @ displacement(off, np.zeros(3)))
        seen = observe(found, Observer(tuple(cameras), cell.observer.solids), Adaptive(), full=False)
        return float(Qualities.of(seen).q_avg or 0.0)

    named = [camera.name for camera in cell.observer.cameras].index("cam2")
    values = [from_beside(named, angle) for angle in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)]
    least, most = proven.least.q_avg, proven.most.q_avg
    assert least is not None
    assert most is not None
    assert least < min(values) < max(values) < most
    by_instants = sum(time.length for time in proven.undecided) / found.T
    assert most - least < 0.75 * by_instants
    assert by_instants > 3.0 * (max(values) - min(values))  # no pose is the worst at each instant


def test_undecided_times_are_what_the_qualities_leave_open(cell: Cell) -> None:
    found = studied(cell, FixedCount(30))
    proven = certify(found, cell.observer, FixedCount(30), BOUNDS)
    length = sum(stretch.length for stretch in proven.undecided)
    assert length == pytest.approx((proven.most.q_avg - proven.least.q_avg) * found.T, abs=1e-6)
    assert length > 0


def test_what_is_seen_throughout_is_proven_to_be_exactly_all(cell: Cell) -> None:
    found = studied(cell, Adaptive(), "pickup g2")
    proven = certify(found, cell.observer, Adaptive(), BOUNDS)
    assert (proven.least.q_eoi, proven.most.q_eoi) == (1.0, 1.0)
    assert Qualities.of(found.timeline).q_eoi == 1.0


def test_undecided_times_are_not_those_that_bisection_leaves(cell: Cell) -> None:
    exactly = PoseBounds(0.0, 0.0)
    proven = certify(studied(cell, Adaptive()), cell.observer, Adaptive(), exactly)
    assert all(stretch.length > 1e-3 for stretch in proven.undecided)


def test_bounds_so_wide_that_they_prove_nothing_are_no_numerical_problem(cell: Cell) -> None:
    found = studied(cell, FixedCount(5))
    with np.errstate(all="raise", under="ignore"):
        proven = certify(found, cell.observer, FixedCount(5), PoseBounds(1.0, 1.0))
    assert (proven.least.q_avg, proven.most.q_avg) == (0.0, 1.0)


def assessed(cell: Cell, name: str, time: float, least: float, most: float) -> Assessment:
    candidate = read_task(f"pickup {name}", cell.workspace).candidates[0]
    figures = replace(NO_FIGURES, time=time, q_avg=1.0, q_eoi=0.5 * (least + most))
    proven = Certificate(Qualities(1.0, least), Qualities(1.0, most), (Stretch(0.0, 1.0),))
    return Assessment(candidate, feasible=True, certificate=proven, **vars(figures))


@pytest.mark.parametrize(
    ("first", "second", "overtakes"),
    [
        ((5.0, 0.8, 0.9), (4.0, 0.5, 0.7), False),
        ((5.0, 0.8, 0.9), (4.0, 0.5, 0.85), True),
        ((4.0, 0.9, 0.9), (5.0, 0.9, 0.9), False),
        ((4.0, 0.8, 0.9), (5.0, 0.7, 0.8), False),
        ((5.0, 0.8, 0.9), (4.0, 0.7, 0.8), True),
    ],
    ids=["apart", "overlapping", "equal and faster", "touching and faster", "touching and slower"],
)
def test_the_first_is_compared_at_its_worst_with_the_others_at_their_best(
    cell: Cell, first: tuple[float, float, float], second: tuple[float, float, float], overtakes: bool
) -> None:
    ranking = rank([assessed(cell, "g1", *first), assessed(cell, "g2", *second)], "q_eoi")
    assert bool(may_overtake(ranking, "q_eoi")) == overtakes


def test_delays_are_not_proven(cell: Cell) -> None:
    ranking = rank([assessed(cell, "g1", 4.0, 0.9, 1.0), assessed(cell, "g2", 5.0, 0.1, 0.2)], "time")
    assert not may_overtake(ranking, "time")
    assert not may_overtake(ranking, "delay")  # without faults nothing but time is left to compare
