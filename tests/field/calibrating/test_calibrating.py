"""Curves fitted to what was drawn from a known curve, and files of labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.camera.detector import BoxSights, Curve, Detector
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.calibrating.fit import FOLDS, DetectorLooks, fit, held_out, judge, tell
from sqrp_cli.field.calibrating.labelled import Label, of_labels, read_labels
from sqrp_cli.geometry import Array
from tests.trials.detectors import EXPOSURE, write_workspace

TRUE = Curve(bias=-18.0, pixels=6.0, incidence=3.0, visible=5.0, blur=8.0, most=0.97)
DETECTOR = Detector(kind="aruco", distance=(0.1, 3.0), max_incidence=1.0, min_pixels=16.0)


def drawn(count: int, seed: int) -> BoxSights:
    random = np.random.default_rng(seed)
    pixels = np.exp(random.uniform(np.log(5.0), np.log(60.0), count))
    incidence, distance = random.uniform(0.0, 1.4, count), random.uniform(0.3, 2.0, count)
    visible = np.where(random.random(count) < 0.3, random.uniform(0.1, 1.0, count), 1.0)
    return np.stack([pixels, incidence, distance, visible, np.abs(random.normal(0.0, 3.0, count))])


def looks(count: int, seed: int, told: Array | None = None, poses: int | None = None) -> DetectorLooks:
    """Looks in which the true curve decides, or other probabilities."""
    sights = drawn(count, seed)
    random = np.random.default_rng([seed, 1])
    probabilities = TRUE.probability(sights) if told is None else told
    covered = (sights[0] >= 16.0) & (sights[1] <= 1.0) & (sights[3] >= 1.0)
    pose = np.arange(count) if poses is None else np.arange(count) * poses // count
    return DetectorLooks(sights=sights, seen=random.random(count) < probabilities, covered=covered, pose=pose)


def test_the_curve_that_decided_is_found_again_and_twice_as_good_as_limits_where_it_did_not_learn() -> None:
    found, others = fit(looks(3000, 0), DETECTOR), looks(3000, 1)
    told, true = (one.probability(others.sights) for one in (found, TRUE))
    assert np.abs(told - true).mean() < 0.015
    curve, limits, best = (judge(one, others.seen) for one in (told, others.covered * 1.0, true))
    assert curve.calibration_error <= 0.03
    assert curve.brier <= 0.5 * limits.brier
    assert curve.brier <= 1.05 * best.brier


def test_frames_of_chance_promise_nothing_when_they_are_held_out() -> None:
    """Forty poses of which each is seen or not, ten images of each: what is learned of one tells nothing of another."""
    random = np.random.default_rng(3)
    luck = np.repeat(random.random(40) < 0.5, 10) * 1.0
    found = looks(400, 4, luck, poses=40)
    assert judge(held_out(found, DETECTOR), found.seen).brier >= 0.23


def test_each_fifth_is_judged_by_a_curve_that_did_not_see_it() -> None:
    known = looks(600, 5, poses=60)
    told = held_out(known, DETECTOR)
    for part in range(FOLDS):
        here = known.pose % FOLDS == part
        other = fit(known.some(~here), DETECTOR)
        assert told[here] == pytest.approx(tell(other, known.some(here), DETECTOR))


def test_where_hardly_anything_is_missed_the_limits_stay() -> None:
    known = looks(200, 8, np.full(200, 0.985))
    found = fit(known, DETECTOR)
    within = known.seen[known.covered]
    assert found.terms == {}
    assert found.probability(known.sights) == pytest.approx((within.sum() + 1) / (len(within) + 2), abs=1e-3)
    assert (tell(found, known, DETECTOR)[known.sights[0] < DETECTOR.min_pixels] == 0.0).all()


def test_few_boxes_that_were_missed_give_few_terms() -> None:
    known = looks(3000, 9)
    few = known.some(known.seen | (np.cumsum(~known.seen) <= 12))
    assert len([value for value in fit(few, DETECTOR).terms.values() if value > 0]) <= 2


def test_a_limit_that_frames_exceed_is_replaced_and_one_that_they_do_not_tell_about_stays() -> None:
    sights = drawn(500, 6)
    sights[1:3] = [[0.3], [5.0]]
    seen = np.random.default_rng(7).random(500) < TRUE.probability(sights)
    found = fit(DetectorLooks(sights=sights, seen=seen, covered=seen, pose=np.arange(500)), DETECTOR)
    assert found.distance == 0.0
    assert found.incidence is None
    assert found.pixels


def test_figures_are_those_of_the_definition() -> None:
    told, seen = np.array([0.05, 0.05, 0.85, 0.85]), np.array([False, True, True, True])
    found = judge(told, seen)
    assert [(one.looks, one.told, one.seen) for one in found.bins] == [(2, 0.05, 0.5), (2, pytest.approx(0.85), 1.0)]
    assert found.calibration_error == pytest.approx(0.5 * 0.45 + 0.5 * 0.15)
    assert found.brier == pytest.approx((0.05**2 + 0.95**2 + 2 * 0.15**2) / 4)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_seeing_a_box_better_never_makes_it_less_likely(seed: int) -> None:
    random = np.random.default_rng(seed)
    found, sights = fit(looks(200, seed, random.random(200)), DETECTOR), drawn(50, seed + 1)
    better = sights * np.array([1.3, 0.7, 0.8, 1.2, 0.5])[:, None]
    better[3] = np.minimum(1.0, better[3])
    assert (found.probability(better) >= found.probability(sights) - 1e-12).all()


HEADER = "camera,file,object,detector,there,x,y,z,qx,qy,qz,qw,vx,vy,vz"
GOOD = "near,a.png,plate,aruco,yes,4,0,1,0,0,0,1,0.2,0,0"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return write_workspace(tmp_path_factory.mktemp("cell"))


def labels(workspace: Workspace, folder: Path, *lines: str) -> list[Label]:
    (folder / "a.png").touch()
    (folder / "b.png").touch()
    (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    return list(read_labels(folder, workspace))


def test_a_row_says_what_stands_where(workspace: Workspace, tmp_path: Path) -> None:
    found, other = labels(workspace, tmp_path, HEADER, GOOD, "near,a.png,screen,,,4,0,2,0,0,1,0,,,")
    assert (found.camera, found.object, found.detector, found.there) == ("near", "plate", "aruco", True)
    assert found.X_WO[:3, 3].tolist() == [4.0, 0.0, 1.0]
    assert found.velocity.tolist() == [0.2, 0.0, 0.0]
    assert (other.detector, other.there) == (None, True)
    assert np.allclose(other.X_WO[:3, 0], [-1.0, 0.0, 0.0])


def test_what_has_no_label_stands_where_the_workspace_has_it(workspace: Workspace, tmp_path: Path) -> None:
    labels(workspace, tmp_path, HEADER, GOOD, GOOD.replace("a.png", "b.png").replace("yes", "no"))
    (together,) = of_labels(workspace, tmp_path)
    first, second = together.images
    assert (first.holds, second.holds) == ({"there(plate)": True}, {"there(plate)": False})
    assert np.array_equal(first.believed.X_WO["screen"], workspace.stated_world.X_WO["screen"])
    moved = first.closes.X_WO["plate"] - first.opens.X_WO["plate"]
    assert moved[:3, 3] == pytest.approx([0.2 * EXPOSURE, 0.0, 0.0])
    assert first.pose != second.pose
    (box,) = together.sought.targets["there(plate)"].boxes
    assert box.size[0] == 0.045
    assert box.normal == (0.0, 0.0, 1.0)
