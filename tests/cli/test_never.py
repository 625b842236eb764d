"""A fault that no image shows is never noticed: no figure, no threshold, no goal and no run says otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.camera.camera import ImageEntry
from sqrp_cli.cell.edits import with_cameras
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from tests.cells import made_cell, shipped_cell, write_cell
from tests.cli.browser import overview_of

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("fault", "said"),
    [("slip@a4+0.5", "no image showed slip, which happened at "), ("slip@a5+0.5", "no image showed ")],
)
def test_a_run_that_misses_a_fault_says_so_even_of_a_part_for_which_no_formula_asks(sqrp, once, tmp_path, fault, said):
    def write(folder: Path) -> Path:
        program, cell = folder / "p.yaml", made_cell("quick_under_the_table", folder)
        assert sqrp("rank", cell, "pickup g2", "--ways", "fastest", "--program", program).code == 0
        return program

    program, log, page = once("quick-under-the-table", write), tmp_path / "run.jsonl", tmp_path / "run.html"
    more = ("--report", page) if "a4" in fault else ()
    run = sqrp("run", program, "--sim", "--fault", fault, "--log", log, *more, "--json")
    assert (run.code, run.document["outcome"]) == (3, "missed")
    assert run.document["reason"].startswith(said)
    assert '"missed"' in log.read_text().splitlines()[-1]
    replayed = sqrp("run", program, "--replay", log)
    assert replayed.code == 3
    assert "missed a fault" in replayed.out
    assert not more or "missed" in page.read_text()


def test_an_assumed_latency_is_said_where_delays_are_and_written_nowhere(sqrp, tmp_path):
    cell = shipped_cell("tabletop")
    for name in ("cam1", "cam4"):
        del cell["cameras"][name]["latency"]
    workspace = write_cell(cell, tmp_path).parent
    assumed = "a latency of 0 ms is assumed of cam1, cam4, as none is stated"
    checked = sqrp("check", workspace, columns=200)
    assert checked.err.count(assumed) == 1
    page = tmp_path / "page.html"
    for command, more in (("rank", ["--report", page]), ("explain", [])):
        shown = sqrp(command, workspace, "pickup g2", "--ways", "fastest", *more, columns=200)
        assert f"For these times, {assumed}." in shown.out
    assert ["delays", f"{assumed}."] in overview_of(page)["about"]
    show = sqrp("show", workspace, "--json").document["cameras"]
    assert (show["cam1"]["latency"], show["cam2"]["latency"]) == (0.0, 0.05)
    for name, is_stated in (("cam1", False), ("cam2", True)):
        camera = load_workspace(workspace).cameras[name]
        image = ImageEntry(width=640, height=480, horizontal_fov=1.0)
        new = (camera, image, None, np.array([0.0, 0.0, 1.0]))
        written = with_cameras(read_workspace_document(workspace / "workspace.yaml"), [], [new]).decode()
        assert ("latency" in written) == is_stated


def test_a_camera_on_the_robot_shows_no_drop_before_its_latency_has_passed(sqrp, tmp_path):
    """Of the cell `tabletop` with one camera, on the flange: 30 Hz, 200 ms."""
    flange = made_cell("flange", tmp_path)
    slip = sqrp("rank", flange, "pickup g2", "--ways", "fastest", "--json").document["candidates"][0]["faults"]["slip"]
    assert slip["unseen"] == 0.0
    assert 0.2 + 0.5 / 30 <= slip["delay_mean"] <= 0.25  # slips in the simulated cell take 0.23 s on average ...
    assert slip["delay_worst"] >= 0.4  # ... and up to 0.4 s at the beginning of the lift
