"""From where on perception really sees: limits that workspaces state or leave to what markers and cameras give."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sqrp_cli.camera.detector import Curve, Detector, DetectorEntry, least_pixels, marker_range
from sqrp_cli.camera.markers import DICTIONARIES, Marker, opencv_name
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import look_at, pose, rpy_to_matrix
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception.vision import find_markers
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from tests.run.cell.scenes import ROOT, camera, thing, workspace
from tests.run.perception.detector_limits import beside, color_rates, marker_rate, staged
from tests.sight.views import make_box, make_camera
from tests.trials.detectors import Case

DETECTORS = workspace("workspaces/tabletop").detectors
MARKERS, COLORS = DETECTORS["aruco"], DETECTORS["color"]


@pytest.mark.parametrize("incidence", [0.0, 0.5, 1.0])
def test_markers_within_the_limits_are_found(incidence: float) -> None:
    """incidence: share of the largest one."""
    assert marker_rate(MARKERS.min_pixels, incidence * MARKERS.max_incidence, 40) >= 0.95


def test_smaller_or_more_oblique_markers_are_missed() -> None:
    assert marker_rate(0.4 * MARKERS.min_pixels, 0.0, 20) <= 0.3
    assert marker_rate(MARKERS.min_pixels, np.radians(80.0), 20) <= 0.8


@pytest.mark.parametrize(("size", "visible"), [(1.0, 1.0), (1.0, 0.0), (3.0, 0.0)])
def test_coloured_things_within_the_limits_are_judged_right(size: float, visible: float) -> None:
    """size: in smallest ones. visible: from the least share, 0, to all, 1."""
    share = COLORS.min_visible + visible * (1.0 - COLORS.min_visible)
    there, gone = color_rates(size * COLORS.min_pixels, share, 12)
    assert there >= 0.95
    assert gone >= 0.95


def test_what_shows_in_a_slit_is_judged_as_what_shows_beside_one_edge() -> None:
    assert color_rates(30, COLORS.min_visible, 12, slit=True) == (1.0, 1.0)


def test_what_is_mostly_hidden_or_tiny_is_not_judged() -> None:
    assert color_rates(2.0 * COLORS.min_pixels, 0.5 * COLORS.min_visible, 10) == (0.0, 0.0)
    assert max(color_rates(0.33 * COLORS.min_pixels, COLORS.min_visible, 10)) <= 0.3


def test_a_detector_that_asks_for_more_is_not_content_with_less() -> None:
    assert color_rates(30, 0.41, 10, min_visible=0.35) == (1.0, 1.0)
    assert color_rates(30, 0.41, 10, min_visible=0.5) == (0.0, 0.0)
    assert color_rates(30, 0.6, 10, min_visible=1.0) == (1.0, 1.0)


@pytest.mark.parametrize(("share", "says"), [(0.4, Truth.TRUE), (0.6, Truth.FALSE), (0.66, Truth.FALSE)])
def test_a_part_beside_its_place_is_in_it_if_its_middle_is(share: float, says: Truth) -> None:
    assert beside(share, 12) == 12 * [says]


SCREWS = ROOT / "workspaces/screws"
STATED = "kind: aruco, distance: [15 cm, 2.5 m], max_incidence: 60 deg, min_pixels: 24"


@pytest.mark.parametrize("name", DICTIONARIES)
def test_the_bits_that_may_be_wrong_are_those_that_opencv_corrects(name: str) -> None:
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))
    rate = cv2.aruco.DetectorParameters().errorCorrectionRate
    assert DICTIONARIES[name].corrected == int(rate * known.maxCorrectionBits)
    assert DICTIONARIES[name].modules == known.markerSize + 2


FACING = Case("4x4_50", 0.05, 640, 600.0, 0.0)


@pytest.mark.parametrize(
    "case", [FACING, Case("apriltag_36h11", 0.05, 640, 600.0, 0.0)], ids=lambda one: one.dictionary
)
def test_nine_of_ten_images_show_a_marker_at_the_end_of_its_range(case: Case) -> None:
    assert case.predicted == pytest.approx(case.measured(240, seed=1), rel=0.1)


@pytest.mark.parametrize(("share", "seen"), [(0.8, False), (1.02, True)])
def test_nearer_than_its_range_a_marker_does_not_fit_the_image(share: float, seen: bool) -> None:
    eye, marker = camera(X_FC=look_at((4.0, 0.0, 2.0), (4.0, 0.0, 0.0), (1.0, 0.0, 0.0))), FACING.markers[0]
    near = marker_range(eye, marker.on((0.075, 0.075, 0.002)))[0]
    with staged([thing("plate", (4, 0, 0.02), (0.075, 0.075, 0.002), color="white", marker=marker)], [eye]) as stage:
        stage.put("plate", pose(position=(4.0, 0.0, 2.0 - share * near - 0.001)))
        assert bool(find_markers(stage.frame("cam", 0.0).image, "4x4_50")) == seen


def with_detector(text: str) -> bytes:
    content = (SCREWS / "workspace.yaml").read_text()
    assert STATED in content
    return content.replace(STATED, text).encode()


def test_a_detector_that_states_no_limits_has_those_of_its_markers_and_cameras() -> None:
    workspace = load_workspace(SCREWS, with_detector("kind: aruco, max_incidence: 70 deg"))
    found = workspace.detectors["aruco"]
    # Facing the camera, the longer side of the image decides: 0.011 of 1536 pixels are more than 2.16 for each of 7
    # modules; at 70 degrees, where modules are narrower one way or another, the modules do.
    axis, k = np.linspace(0.0, np.pi, 1000, endpoint=False), np.cos(np.radians(70.0))
    narrower = np.hypot(np.cos(axis), k * np.sin(axis)) / k
    assert found.min_pixels == pytest.approx(7 * 1.59 * 5**0.19 * np.sqrt(np.mean(narrower**2) * k))
    longest = max(float(one.matrix[0, 0]) for one in workspace.cameras.values())
    assert found.distance[1] == pytest.approx(longest * 0.03 / (0.011 * 1536))
    shortest = min(float(one.matrix[1, 1]) for one in workspace.cameras.values())
    assert found.distance[0] == pytest.approx(shortest * 0.03 / 1152)
    stated = load_workspace(SCREWS, with_detector("kind: aruco, max_incidence: 60 deg, min_pixels: 30"))
    assert stated.detectors["aruco"].min_pixels == 30.0
    assert stated.detectors["aruco"].distance[1] > 2.5


def outline_is_read(side: float, turned: float, rates: tuple[float, float]) -> bool:
    """Whether OpenCV finds a marker of a side [pixels] that is turned in the image [deg], looking at such outlines."""
    family, parameters = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate, parameters.maxMarkerPerimeterRate = rates
    drawn = cv2.copyMakeBorder(
        cv2.aruco.generateImageMarker(family, 5, 600), *[200] * 4, cv2.BORDER_CONSTANT, value=255
    )
    turn = cv2.getRotationMatrix2D((499.5, 499.5), turned, side / 600.0) - [[0, 0, 180], [0, 0, 260]]
    image = cv2.warpAffine(drawn, turn, (640, 480), borderValue=255, flags=cv2.INTER_AREA)
    return cv2.aruco.ArucoDetector(family, parameters).detectMarkers(image)[1] is not None


@pytest.mark.parametrize("rates", [(0.2, 1.5), (0.1, 0.5), (0.03, 1.0)])
def test_outlines_that_a_detector_passes_over_narrow_the_range_in_which_markers_are_read(rates) -> None:
    marker, focal, angles = FACING.markers[0].on((0.075, 0.075, 0.002)), FACING.focal, (0.0, 20.0, 45.0)
    near, far = marker_range(FACING.camera, marker, 0.0, rates)
    largest, smallest = focal * marker.side / near, focal * marker.side / far
    assert all(outline_is_read(side, turned, rates) for side in (largest, smallest) for turned in angles)
    # OpenCV also takes the inside of the black edge for an outline, up to half a threshold's window of 23 further in.
    assert not any(outline_is_read(largest + 25, 0.0, rates) for turned in angles[:2])
    assert rates[0] < 0.1 or not outline_is_read(0.9 * smallest, 45.0, rates)
    entry = DetectorEntry(kind="aruco", distance=(0.05, 9.0), max_incidence=0.0175, min_pixels=4, perimeter_rate=rates)
    found = Detector.of(entry, {"cam": FACING.camera}, {"plate": marker})
    assert found.distance == (near, 9.0)
    assert found.min_pixels == pytest.approx(smallest, rel=1e-3)
    assert found.usual == found


def test_more_pixels_and_larger_markers_are_read_farther_away() -> None:
    small, large = Marker(id=1, side=0.02), Marker(id=1, side=0.04)
    wide, narrow = camera(focal=(300.0, 300.0)), camera(focal=(900.0, 900.0))
    assert marker_range(wide, large)[1] == pytest.approx(2 * marker_range(wide, small)[1])
    assert marker_range(narrow, small)[1] == pytest.approx(3 * marker_range(wide, small)[1])
    assert least_pixels(wide, small.dictionary, 1.0) > least_pixels(wide, small.dictionary)


@pytest.mark.parametrize("turned", [0.0, 0.9])
def test_what_is_usually_read_is_what_its_range_says_whatever_margin_is_stated(turned: float) -> None:
    eye, marker = camera(focal=(900.0, 900.0)), Marker(id=1, side=0.02)
    entry = DetectorEntry(kind="aruco", distance=(0.15, 1.0), max_incidence=0.8, min_pixels=60.0)
    stated = Detector.of(entry, {"cam": eye}, {"plate": marker})
    far, R = marker_range(eye, marker, turned)[1], rpy_to_matrix((turned, 0.0, 0.0))
    for share, usual in ((0.96, Cause.NONE), (1.04, Cause.TOO_SMALL)):
        X_WB, size = pose(R, (0.0, 0.0, share * far)), (marker.side, marker.side, 1e-6)
        boxes = [make_box(size, X_WB, detector=one, normal=(0.0, 0.0, -1.0)) for one in (stated, stated.usual)]
        targets = [Target(Atom("seen"), 1, (box,)) for box in boxes]
        found = Observer((make_camera(focal=(900.0, 900.0), size=(eye.width, eye.height)),), ()).verdicts(
            targets, SceneStates(1, {"world": pose()[None]})
        )
        assert found[0][0].cause[0, 0] not in (Cause.NONE, Cause.OUT_OF_IMAGE)
        assert found[1][0].cause[0, 0] == usual


def test_of_other_detectors_no_more_is_known_than_what_is_stated() -> None:
    for detector in load_workspace(SCREWS).detectors.values():
        learned = replace(detector, curve=Curve(bias=1.0, pixels=1.0))
        assert learned.usual == learned
        other = replace(detector, kind="other", dictionaries=())
        assert other.usual == other
