"""Detectors of installed packages: found by their entry points, asked about boxes, blamed for what they do wrong."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.camera.detector import Detector, installed_detectors
from sqrp_cli.camera.markers import ObjectMarker
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import look_at, pose
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception.detections import BelievedState, BoxQuestion
from sqrp_cli.run.perception.image_detector import DetectorPool, plugin_detections
from sqrp_cli.run.perception.projected import ExpectedView
from sqrp_cli.run.perception.vision import area_of
from sqrp_cli.run.record.report import Stopped
from tests.run.cell.scenes import ROOT, camera, cell, empty, thing
from tests.run.perception.detector_limits import Stage, sought

PACKAGES = Path(__file__).parent / "packages"
TAG = ObjectMarker(id=11, dictionary="apriltag_36h11")
THINGS = (
    thing("ground", (4.0, 0.0, -0.02), (20.0, 20.0, 0.04), color="grey", fixed=True),
    thing("plate", (4.0, 0.0, 0.01), (0.1, 0.1, 0.02), color="white", marker=TAG),
)
EYE = camera(X_FC=look_at((4.6, 0.0, 0.8), (4.0, 0.0, 0.0)))
PLACE = pose(position=(4.0, 0.0, 0.01))


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The sample package, as pip would leave it."""
    monkeypatch.syspath_prepend(str(PACKAGES))
    installed_detectors.cache_clear()
    yield
    installed_detectors.cache_clear()


def stage_with(kind: str) -> Stage:
    detector = Detector(kind=kind, distance=(0.1, 5.0), max_incidence=1.5, min_pixels=5.0)
    return Stage(replace(cell(empty(), THINGS, [EYE]), detectors={"mine": detector}))


SOUGHT = sought("plate", (0.1, 0.1, 0.02), PLACE, "mine")


BESIDE, OUTSIDE = pose(position=(4.0, 0.2, 0.01)), pose(position=(4.0, 8.0, 0.01))


@pytest.mark.parametrize(
    ("kind", "places", "says"),
    [
        ("apriltag", (PLACE, BESIDE, OUTSIDE), [Truth.TRUE, Truth.FALSE, Truth.UNKNOWN]),
        ("as_at_first", (PLACE, PLACE, BESIDE, OUTSIDE), [Truth.TRUE, Truth.TRUE, Truth.FALSE, Truth.FALSE]),
        ("aruco", (PLACE, BESIDE), [Truth.TRUE, Truth.FALSE]),
    ],
)
def test_packages_see_tags_and_that_something_has_gone_and_our_own_detector_agrees(kind, places, says) -> None:
    stage = stage_with(kind)
    found = stage.look(EYE, "plate", PLACE, *({"plate": X_WO} for X_WO in places), detector="mine")
    stage.close()
    assert [one.evidence for one in found] == says


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("fails", "the detector `fails` of the package sample-detectors failed: RuntimeError: no network loaded"),
        ("babbles", "answered 1 questions with ['yes', 'yes', 'yes']; expected one True, False or None for each"),
    ],
)
def test_what_a_package_does_wrong_is_said(kind: str, says: str) -> None:
    stage = stage_with(kind)
    with DetectorPool(stage.knowledge, processes=1) as pool:
        pool.watch(SOUGHT)
        pool.submit(stage.frame("cam", 0.0), BelievedState({}, False, {"plate": PLACE}))
        with pytest.raises(Stopped) as caught:
            pool.collect("cam")
    stage.close()
    assert says in str(caught.value)


def test_a_package_that_cannot_be_loaded_is_named_before_anything_runs() -> None:
    with pytest.raises(InputError, match="package sample-detectors cannot be loaded: AttributeError"):
        stage_with("missing")


def test_a_workspace_may_name_an_installed_kind_and_reading_it_runs_nothing_of_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "sample_detectors", raising=False)
    folder = ROOT / "tests/cases/cell"
    content = (folder / "workspace.yaml").read_text()
    known = load_workspace(folder, content.replace("kind: color", "kind: apriltag").encode())
    assert known.detectors["color"].kind == "apriltag"
    assert "sample_detectors" not in sys.modules
    with pytest.raises(InputError, match=r"did you mean `apriltag`.*entry points `sqrp.detectors`"):
        load_workspace(folder, content.replace("kind: color", "kind: apriltags").encode())


def test_a_question_says_what_the_robot_does_not_cover() -> None:
    stage = stage_with("as_at_first")
    image, believed = stage.frame("cam", 0.0).image, BelievedState({}, False, {"plate": PLACE})
    view = ExpectedView(stage.knowledge, Projection(EYE), SOUGHT, image, believed)
    stage.close()
    asked: list[BoxQuestion] = []
    plugin = SimpleNamespace(look=lambda _, questions: [asked.append(one) for one in questions])
    plugin_detections("mine", plugin, view, [("placed(plate)", SOUGHT.targets["placed(plate)"].boxes[0])])
    (found,) = asked
    assert (found.object, found.marker) == ("plate", TAG.on((0.1, 0.1, 0.02)))
    assert np.allclose(found.X_CB, np.linalg.inv(EYE.X_FC) @ PLACE)
    assert found.clear.sum() == pytest.approx(area_of(found.outline), rel=0.1)
