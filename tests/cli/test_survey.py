"""Cameras that have moved and clocks that are wrong, in recordings drawn anew with other colours and lights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sqrp_cli.ask.api.program import cameras_patch, open_program
from sqrp_cli.ask.api.results import read_result
from sqrp_cli.ask.values import silent
from sqrp_cli.field.audit.bag_footage import BagFootage
from sqrp_cli.field.audit.report import AuditDocument, AuditedPose
from sqrp_cli.field.audit.survey import survey
from sqrp_cli.files.yaml_file import parse_yaml
from sqrp_cli.geometry import inverse, pose
from tests.damage.cell import as_rosbag2
from tests.trials.recordings import CellPictures, Truth, record

pytestmark = pytest.mark.slow

TURN = pose(cv2.Rodrigues(np.radians([0.3, -0.35, 0.2]))[0])
TRUTH = Truth(moved={"cam3": TURN}, offsets={"cam5": 0.31, "cam3": -0.07}, rate=2.5)


@pytest.fixture(scope="module")
def audit(quick_cell):
    """Of two cameras, one of which was turned; both with clocks of their own."""
    opened, path = open_program(quick_cell.program), quick_cell.folder / "turned.mcap"
    program, workspace = opened.program, opened.workspace
    pictures, drawn = CellPictures(program, workspace, 5), dict[object, np.ndarray]()
    for one in (path, path.with_suffix(".bag")):
        record(one, pictures, TRUTH, drawn)
    found = survey(program, workspace, BagFootage(program, workspace, path, {}), silent)
    none: dict[str, Any] = {"images": 0, "skipped": 0, "repeated": 0}
    none |= {"prediction": [], "usual": [], "disagreements": []}
    step = program.steps[0]
    steps: dict[str, Any] = {"steps": [step.short_task], "times": [step.time], "until": [None]}
    patch = cameras_patch(workspace, found)
    return AuditDocument(workspace=workspace.name, threshold=0.97, cameras=found, patch=patch, **none, **steps)


def pose_of(audit: AuditDocument, name: str) -> AuditedPose:
    found = audit.cameras[name].pose
    assert found is not None
    return found


def test_the_camera_that_was_turned_is_named_and_no_other(audit):
    assert [name for name, one in audit.cameras.items() if one.moved] == ["cam3"]
    assert not audit.passed


def test_where_it_is_now_is_found(audit, quick_cell):
    X_FC = open_program(quick_cell.program).workspace.cameras["cam3"].X_FC
    error = inverse(X_FC @ TURN) @ np.array(pose_of(audit, "cam3").pose)
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(error[:3, :3])[0])) < 0.1
    assert np.linalg.norm(error[:3, 3]) < 2e-3


def test_the_camera_that_was_turned_is_found_with_honest_errors_and_a_patch(audit, quick_cell):
    # Its errors are as large as it says.
    cameras = open_program(quick_cell.program).workspace.cameras
    for name in audit.cameras:
        found = pose_of(audit, name)
        X = inverse(TRUTH.moved.get(name, np.eye(4))) @ inverse(cameras[name].X_FC) @ np.array(found.pose)
        error = np.concatenate([cv2.Rodrigues(X[:3, :3])[0].ravel(), X[:3, 3]])
        assert (np.abs(error) < 5 * np.array([*found.turn_error, *found.shift_error])).all(), name
    # The patch puts the camera where it is.
    added = [line[1:] for line in audit.patch.splitlines() if line.startswith("+") and not line.startswith("+++")]
    assert len(added) == 1
    entry = parse_yaml(Path("patch.yaml"), added[0].strip().encode()).data["pose"]
    np.testing.assert_allclose(entry["position"], np.array(pose_of(audit, "cam3").pose)[:3, 3], atol=1e-5)
    assert entry.keys() == {"position", "rpy"}


@pytest.mark.parametrize("name", ["cam3", "cam5"])
def test_clocks_are_compared_to_some_milliseconds(audit, name):
    clock = audit.cameras[name].clock
    assert clock.wrong
    assert clock.offset == pytest.approx(TRUTH.offsets[name], abs=5e-3)


def test_the_saved_document_prints_what_the_command_printed(audit, tmp_path):
    path = tmp_path / "audit.json"
    path.write_text(audit.to_json(), encoding="utf-8")
    assert str(read_result(path)) == str(audit)
    assert read_result(path).to_json() == audit.to_json()


def test_what_is_not_known_of_cameras_and_how_a_patch_is_had_is_said(audit, sqrp, quick_cell, monkeypatch):
    # Of a camera that was not found it is not said that it has not moved.
    lost = replace(audit, cameras={"cam3": replace(audit.cameras["cam3"], pose=None)})
    monkeypatch.setattr("sqrp_cli.cli.commands.runs.audited", lambda *_: lost)
    found = sqrp("audit", quick_cell.program, "run.mcap", "--patch", quick_cell.folder / "no.patch", columns=200)
    little = "Images of cam3 show too little of the cell to tell where it is"
    assert f"{little}, or it has moved by more than can be found out.\n" in found.out
    assert "of no camera is it known that it has moved, so" in found.err
    # How a patch is written is said until it is.
    monkeypatch.setattr("sqrp_cli.cli.commands.runs.audited", lambda *_: audit)
    patch = quick_cell.folder / "moved.patch"
    for option, said in [((), True), (("--patch", patch), False)]:
        found = sqrp("audit", quick_cell.program, "run.mcap", *option, columns=200)
        assert found.code == 1
        assert ("cam3 has moved. --patch FILE writes where it is into the workspace.\n" in found.out) is said
        assert ("cam3 has moved.\n" in found.out) is not said
    assert patch.read_text(encoding="utf-8").endswith(audit.patch)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
@pytest.mark.usefixtures("audit")
def test_every_kind_of_recording_is_read_alike(quick_cell, tmp_path, kind):
    opened = open_program(quick_cell.program)
    mcap = quick_cell.folder / "turned.mcap"
    path = mcap.with_suffix(".bag") if kind == "ros1" else as_rosbag2(mcap, tmp_path / "rosbag2")
    first, second = (BagFootage(opened.program, opened.workspace, one, {}) for one in (mcap, path))
    assert [(one.camera, one.t) for one in second.frames] == [(one.camera, one.t) for one in first.frames]
    assert second.starts == first.starts
    few = first.frames[::20]
    for (_, a), (_, b) in zip(first.images(few), second.images(second.frames[::20]), strict=True):
        np.testing.assert_array_equal(a.image, b.image)
