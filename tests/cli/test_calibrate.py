"""`sqrp calibrate`: labelled frames in, curves and how good they are out."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import asdict

import jsonschema
import pytest

from sqrp_cli.camera.detector import Curve
from sqrp_cli.cell.edits import with_curve
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.show.documents.schemas import schema_of
from tests.trials.detectors import shots, write_frames, write_workspace

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cell, and frames of a marker in it."""
    base = tmp_path_factory.mktemp("calibrate")
    workspace = write_workspace(base / "cell")
    write_frames(workspace, base / "frames", shots(workspace, "plate", 60, 3), 3, "aruco")
    return base


@pytest.fixture(scope="module")
def outcome(sqrp, folder):
    """Of the command with a patch."""
    more = ("--patch", folder / "curves.patch", "--json")
    found = sqrp("calibrate", folder / "frames", "--workspace", folder / "cell", *more)
    assert found.code == 0
    return found


def test_frames_with_labels_give_a_curve_and_a_patch_that_gives_it_to_the_workspace(outcome, folder, tmp_path):
    # Frames with labels give a curve and say how good it is.
    jsonschema.validate(outcome.document, schema_of("calibrate"), cls=jsonschema.Draft202012Validator)
    found = outcome.document["detectors"]["aruco"]
    assert outcome.document["images"] == 60
    assert found["held_out"]["brier"] < found["limits"]["brier"]
    bins = found["held_out"]["bins"]
    assert sum(one["looks"] for one in bins) == found["looks"]
    error = sum(one["looks"] * abs(one["told"] - one["seen"]) for one in bins) / found["looks"]
    assert found["held_out"]["calibration_error"] == pytest.approx(error)
    assert found["seen"] == pytest.approx(sum(one["looks"] * one["seen"] for one in bins) / found["looks"])
    assert found["curve"]["pixels"] > 0
    # The patch gives the workspace the curve.
    patch = (folder / "curves.patch").read_text()
    assert patch.endswith(outcome.document["patch"])
    (added,) = [line[1:] for line in patch.splitlines() if line.startswith("+ ")]
    content = (folder / "cell/workspace.yaml").read_text()
    before = "    min_pixels: 24\n"
    learned = load_workspace(folder / "cell", content.replace(before, f"{before}{added}\n").encode())
    stated = outcome.document["detectors"]["aruco"]["curve"]
    assert asdict(learned.detectors["aruco"].curve) == stated
    # The patch is applied as the command says wherever the workspace is.
    (said,) = [line for line in " ".join(outcome.err.split()).split("to have the curves: ") if "patch -p0" in line]
    assert said.startswith(f"patch -p0 -d {folder / 'cell'} < ")
    patch = (folder / "curves.patch").read_text()
    assert "\n--- workspace.yaml\n+++ workspace.yaml\n" in patch
    if (program := shutil.which("patch")) is None:
        pytest.skip("there is no patch(1)")
    own = shutil.copytree(folder / "cell", tmp_path / "cell")
    subprocess.run([program, "-p0", "-d", own], input=patch, text=True, check=True, capture_output=True)
    assert load_workspace(own).detectors["aruco"].curve is not None


def test_a_curve_that_is_there_is_replaced_and_the_table_compares_limits_and_curve(folder, sqrp):
    # A curve that is there is replaced.
    document = read_workspace_document(folder / "cell/workspace.yaml")
    for bias in (-3.0, -5.0):
        content = with_curve(document, "aruco", Curve(bias=bias, pixels=1.0))
        document = read_workspace_document(document.path, content)
    assert content.decode().count("curve:") == 1
    assert load_workspace(folder / "cell", content).detectors["aruco"].curve == Curve(bias=-5.0, pixels=1.0)
    # The table compares limits and curve.
    outcome = sqrp("calibrate", folder / "frames", "--workspace", folder / "cell")
    assert outcome.out.startswith("Detectors of cell in 60 images")
    assert "curve, poses held out" in outcome.out
    assert all(len(line) <= 80 for line in outcome.out.splitlines())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["frames"], "labels.csv does not say which cell it is about"),
        (["nowhere"], "no such file or folder"),
        (["cell"], "neither a labels.csv in this folder nor a program.yaml"),
        (["cell", "--workspace", "cell"], "--workspace goes with frames that have a labels.csv"),
        (["few", "--workspace", "cell"], "expected 10 or more"),
        (["away", "--workspace", "cell"], "it looked at 0 boxes in range and in the image, expected 10 or more"),
    ],
)
def test_what_cannot_be_used_is_told(sqrp, folder, monkeypatch, arguments, says):
    heading, *lines = (folder / "frames/labels.csv").read_text().splitlines()
    for name, kept in (("few", lines[:6]), ("away", [lines[1].replace("screen,,", "plate,aruco,yes")])):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "labels.csv").write_text("\n".join([heading, *kept]) + "\n")
        for image in sorted((folder / "frames").glob("*.png"))[:3]:
            shutil.copy(image, folder / name)
    monkeypatch.chdir(folder)
    outcome = sqrp("calibrate", *arguments)
    assert outcome.code == 2
    assert says in " ".join(outcome.err.split())


def test_images_of_a_grasp_do_not_count_against_the_detector(asked, slip_run):
    cell = slip_run.cell
    found = asked("calibrate", cell.folder / "frames", "--program", cell.program, "--json").document["detectors"]
    assert {detector: found[detector]["seen"] for detector in found} == {"color": 1.0}
