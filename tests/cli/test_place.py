"""`sqrp place`: its document, its patch, which `score` agrees with, and its exit codes."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
MOUNTS = """
mounts:
  ceiling: {grid: {from: [-0.9, -1, 1.4], to: [0.6, 1, 1.4], step: 1 m}}
  rail: {rail: {from: [-0.9, 1.1, 0.5], to: [1.0, 1.1, 0.5], step: 50 cm}, price: 40}
lenses:
  tele: {image: {width: 640, height: 480, horizontal_fov: 12 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, price: 100}
  wide: {catalogue: realsense-d435-color, price: 300}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two candidates of `tabletop`, with few mounts."""
    folder = tmp_path_factory.mktemp("place")
    for name in ("workspaces", "skills"):
        shutil.copytree(ROOT / name, folder / name)
    cell = folder / "workspaces" / "tabletop"
    text = (cell / "workspace.yaml").read_text()
    (cell / "workspace.yaml").write_text(text.replace("{task: pickup green,", "{task: 'pickup object=g2,g3',"))
    (cell / "place.yaml").write_text(MOUNTS)
    return folder


@pytest.fixture(scope="module")
def cell(folder) -> Path:
    return folder / "workspaces" / "tabletop"


def test_score_of_the_patched_workspace_says_the_same(sqrp, cell, tmp_path, monkeypatch):
    monkeypatch.chdir(cell)
    patch = tmp_path / "cameras.patch"
    found = sqrp("place", cell, "--cameras", "2", "--patch", patch, "--json").document
    assert found["gap"] == 0
    assert found["proven"]
    assert found["mounts"] == 10
    assert found["bound"] == pytest.approx(found["objective"])
    target = tmp_path / "patched"
    shutil.copytree(cell.parents[1], target)
    there = target / "workspaces" / "tabletop"
    subprocess.run([shutil.which("patch") or "patch", "-p0", "-i", patch], cwd=there, check=True, capture_output=True)
    ranked = sqrp("rank", there, "pickup object=g2,g3", "--json").document["candidates"]
    by_name = {one["parameters"]["object"]: one for one in ranked}
    for one in found["candidates"]:
        for figure in ("q_eoi", "q_avg", "time"):
            assert one[figure] == pytest.approx(by_name[one["candidate"]][figure], abs=1e-9)
    shown = sqrp("show", there, "--json").document["cameras"]
    assert sorted(shown) == [camera["name"] for camera in found["cameras"]]
    for camera in found["cameras"]:
        assert np.allclose(shown[camera["name"]]["pose"], camera["pose"], atol=1e-6)


def test_the_answer_does_not_depend_on_processes_and_is_kept(sqrp, cell, tmp_path):
    one = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "1").out
    kept = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "2", "--out", tmp_path).out
    files = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/*.json")}
    again = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "1", "--out", tmp_path).out
    assert one == kept == again
    assert files
    assert files == {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/*.json")}


def test_a_camera_that_stays_is_not_moved(sqrp, cell):
    found = sqrp("place", cell, "--cameras", "1", "--keep", "cam2", "--json").document
    assert found["keep"] == ["cam2"]
    assert "-  cam1:" in found["patch"]
    assert "-  cam2:" not in found["patch"]


def test_too_small_a_budget_cannot_meet_the_wish(sqrp, cell):
    poor = sqrp("place", cell, "--want", "q_eoi 100 %", "--budget", "90", "--json")
    assert poor.code == 1
    found = poor.document
    assert not found["met"]
    assert found["cameras"] == []


def test_a_wish_that_more_cameras_meet_names_their_number(sqrp, cell):
    text = cell / "narrow.yaml"
    narrow = MOUNTS.replace("12 deg", "7 deg")
    text.write_text(narrow.replace("  wide: {catalogue: realsense-d435-color, price: 300}\n", ""))
    few = sqrp("place", cell, "--cameras", "1", "--want", "q_avg 99 %", "--mounts", text, "--json")
    assert few.code == 1
    found = few.document
    assert found["fewest"] is None or found["fewest"] > 1
    assert found["fewest"] == (len(found["cameras"]) if found["fewest"] else None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mounts: {a: {points: [[0, 0, 1]], rail: {from: [0, 0, 1], to: [1, 0, 1], step: 0.1}}}", "exactly one of"),
        ("mounts: {a: {points: [[0, 0, 1]], frame: wirst}}", "a mount on a link needs `aims`"),
        ("mounts: {a: {points: [[0, 0, 1]], lenses: [wdie]}}", "wide"),
        ("mounts: {a: {grid: {from: [0, 0, 1], to: [9, 9, 9], step: 2 cm}}}", "expected at most 20,000"),
        ("mounts: {a: {points: [[0, 0, 1]], size: 3}}", "is no known key"),
    ],
)
def test_a_file_that_says_nothing_sensible_is_refused(sqrp, cell, tmp_path, text, message):
    file = tmp_path / "mounts.yaml"
    file.write_text(f"{text}\nlenses: {{wide: {{catalogue: realsense-d435-color}}}}\n")
    found = sqrp("place", cell, "--mounts", file)
    assert found.code == 2
    assert f"{file}:1" in found.err
    assert message in found.err


def test_without_mounts_the_message_says_what_to_write(sqrp):
    found = sqrp("place", ROOT / "tests" / "cases" / "cell")
    assert found.code == 2
    assert "place.yaml" in found.err
