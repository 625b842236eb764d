"""Markers and their dictionaries."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from sqrp_cli.camera.camera import ImageEntry
from sqrp_cli.camera.detector import Detector, DetectorEntry
from sqrp_cli.camera.markers import DICTIONARIES, ObjectMarker, opencv_name
from sqrp_cli.cell.load import load_workspace

CELL = Path(__file__).parents[1] / "cases" / "contact" / "wipe.yaml"


@pytest.mark.parametrize("name", DICTIONARIES)
def test_sizes_and_counts_are_those_of_opencv(name):
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))
    assert DICTIONARIES[name].modules == dictionary.markerSize + 2
    assert DICTIONARIES[name].ids == len(dictionary.bytesList)


def cell_with(marker: str) -> ObjectMarker | None:
    text = CELL.read_text(encoding="utf-8").replace("type: sponge,", f"type: sponge, marker: {marker},")
    return load_workspace(CELL, text.encode()).objects["sponge"].marker


def test_a_marker_is_its_id_or_a_mapping_with_dictionary_and_side():
    assert cell_with("7") == ObjectMarker(id=7)
    assert cell_with("{id: 7, dictionary: DICT_APRILTAG_36h11, side: 3 cm}") == ObjectMarker(
        id=7, dictionary="apriltag_36h11", side=0.03
    )
    assert ObjectMarker(id=7).on((0.09, 0.2, 0.1)).side == pytest.approx(0.07)
    assert ObjectMarker(id=7, dictionary="4x4_50").on((0.08, 0.2, 0.1)).side == pytest.approx(0.06)


def test_markers_that_no_camera_can_read_have_an_empty_range():
    lens = ImageEntry(width=8, height=8, horizontal_fov=1.0).intrinsics()
    entry, marker = DetectorEntry(kind="aruco", max_incidence=0.5), ObjectMarker(id=1).on((0.1, 0.1, 0.1))
    near, far = Detector.of(entry, {"c": lens}, {"m": marker}).distance
    assert far < near
