"""What is not a number is never within a limit, never free of what is in the way, and never gets into a record."""

from __future__ import annotations

from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest

from sqrp_cli.geometry import BOX_SIGNS, Array, look_at, pose
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.quality import NO_FIGURES, Figures, Qualities
from sqrp_cli.programming.sensing.limits import Cause, check_limits
from sqrp_cli.programming.sensing.scene_states import SceneStates, SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester, near_pairs
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.solids import Solids, load_solid
from tests.programming.sensing.views import box_part, make_box, make_camera, make_detector

NAN = float("nan")
CORNERS = 0.02 * BOX_SIGNS.T + np.array([[0.0], [0.0], [1.0]])
NO_NORMAL = np.zeros(3)
LENSES = {"none": (), "plumb_bob": (-0.1, 0, 0, 0, 0), "equidistant": (0.01, 0, 0, 0)}


def cause(projection: Projection, corners_C: Array, normal_C: Array = NO_NORMAL) -> Cause:
    zero = np.zeros(1, dtype=np.int64)
    corners_C, normal_C = corners_C[:, :, None, None], normal_C[:, None, None]
    found = check_limits([projection], [make_detector()], detector=zero, corners_C=corners_C, normal_C=normal_C)
    return Cause(int(found.cause[0, 0]))


@pytest.mark.parametrize("model", LENSES)
def test_a_box_with_a_coordinate_that_is_not_a_number_is_outside_the_limits(model: str) -> None:
    projection = Projection.of(make_camera(model=model, distortion=LENSES[model]))
    assert cause(projection, CORNERS) is Cause.NONE
    for coordinate in range(3):
        for corner in range(8):
            broken = CORNERS.copy()
            broken[coordinate, corner] = NAN
            assert cause(projection, broken) is not Cause.NONE
        broken = CORNERS.copy()
        broken[coordinate] = NAN
        assert cause(projection, broken) is not Cause.NONE


def test_a_box_with_a_normal_that_is_not_a_number_is_outside_the_limits() -> None:
    projection = Projection.of(make_camera())
    assert cause(projection, CORNERS, np.array([0.0, 0.0, -1.0])) is Cause.NONE
    for axis in range(3):
        assert cause(projection, CORNERS, np.where(np.arange(3) == axis, NAN, -1.0)) is not Cause.NONE


@pytest.mark.parametrize("model", LENSES)
def test_a_camera_or_detector_with_a_limit_that_is_not_a_number_covers_nothing(model: str) -> None:
    camera = make_camera(model=model, distortion=LENSES[model])
    for row, column in ((0, 0), (0, 2), (1, 1), (1, 2)):
        K = camera.matrix.copy()
        K[row, column] = NAN
        broken = make_camera(model=model, distortion=LENSES[model])
        object.__setattr__(broken, "matrix", K)  # past the check of the record
        assert cause(Projection.of(broken), CORNERS) is not Cause.NONE
    zero, normal = np.zeros(1, dtype=np.int64), np.array([0.0, 0.0, -1.0])[:, None, None]
    for limit in ("max_incidence", "min_pixels"):
        detector = replace(make_detector(), **{limit: NAN})
        corners_C = CORNERS[:, :, None, None]
        found = check_limits([Projection.of(camera)], [detector], detector=zero, corners_C=corners_C, normal_C=normal)
        assert found.cause[0, 0] != Cause.NONE


@pytest.mark.parametrize("model", LENSES)
def test_a_lens_shows_no_point_that_is_not_a_number(model: str) -> None:
    projection = Projection.of(make_camera(model=model, distortion=LENSES[model]))
    _, inside = projection.pixels(np.array([[0.0, 0.0, 1.0], [NAN, 0.0, 1.0], [0.0, NAN, 1.0], [0.0, 0.0, NAN]]))
    assert inside.tolist() == [True, False, False, False]


@pytest.mark.parametrize("broken", ["camera", "turn of the camera", "box"])
def test_a_sight_line_that_is_not_finite_is_near_everything_met_by_it_and_sees_nothing(broken: str) -> None:
    """The solid is far from where the line of sight would be."""
    X_WC, X_WB = look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), pose()
    solid = load_solid(box_part("aside", (0.01, 0.01, 0.01), pose(position=(5.0, 0.0, 0.0))))
    poses, one = SolidPoses(Solids((solid,)), {"world": pose()[None]}), np.zeros(1, dtype=np.int64)
    opaque = np.ones((1, 1), dtype=bool)

    def lines(X_WC: Array, X_WB: Array) -> SightLines:
        return SightLines(one, one, one, X_WC[None], X_WB[None], np.full((1, 3), 0.02), np.zeros((1, 3)))

    assert len(near_pairs(lines(X_WC, X_WB), poses, opaque)) == 0
    spoilt, at = (X_WB, (0, 3)) if broken == "box" else (X_WC, (0, 3) if broken == "camera" else (0, 0))
    spoilt[at] = NAN
    not_finite = lines(X_WC, X_WB)
    pairs = Pairs(one, one)
    if broken != "turn of the camera":
        pairs = near_pairs(not_finite, poses, opaque)
        assert len(pairs) == 1
    assert len(HullTester().met(not_finite, poses, pairs, first_only=False)) == 1
    assert visible_shares(not_finite, poses, pairs).share.tolist() == [0.0]


FIGURES = [name for name, kind in get_type_hints(Figures).items() if kind == float | None]


def _spoilt(X: Array) -> Array:
    X[1, 0] = NAN
    return X


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_camera(_spoilt(pose())),
        lambda: make_camera(2.0 * pose()),
        lambda: make_camera(np.diag([1.0, 1.0, -1.0, 1.0])),
        lambda: make_camera(focal=(NAN, 500.0)),
        lambda: make_camera(model="plumb_bob", distortion=(NAN, 0, 0, 0, 0)),
        lambda: make_box(X_FB=_spoilt(pose())),
        lambda: make_box((NAN, 0.1, 0.1)),
        lambda: make_box(normal=(0.0, NAN, 1.0)),
        lambda: box_part("part", (0.1, 0.1, 0.1), _spoilt(pose())),
        lambda: SceneStates(1, {"world": _spoilt(pose())[None]}),
        lambda: Qualities(NAN, None),
        lambda: FaultMetrics(0.1, NAN, 0.0, 0.0, 1.0),
        *(lambda name=name: replace(NO_FIGURES, **{name: NAN}) for name in FIGURES),
        *(lambda name=name: replace(Assessment.infeasible(None, ()), **{name: NAN}) for name in FIGURES),
        lambda: replace(Assessment.infeasible(None, ()), error=NAN),
        lambda: replace(Assessment.infeasible(None, ()), largest_gap=NAN),
    ],
)
def test_no_record_takes_a_pose_or_figure_that_is_not_finite(make: object) -> None:
    with pytest.raises(ValueError, match=r"is none|not finite"):
        make()
