"""Many candidates: how fast they are assessed, and that memory does not grow with their number."""

from __future__ import annotations

import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study, study
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.coverage.verdict import verdict
from sqrp_cli.programming.pipeline import Assignment, assess_all
from sqrp_cli.programming.task import read_task
from sqrp_cli.programming.ways.find import WantedWay
from tests.benchmarks.scene import TABLETOP
from tests.benchmarks.table import print_table
from tests.cells import write_cell

OBJECTS, YAWS, CAMERAS = 200, 8, 24

REPEATS = 8
"""How often each candidate of tabletop is timed."""


def many(wanted: int) -> None:
    """Each feasible candidate of tabletop, then about `wanted` of 1,600 in a cell with 200 objects, the fastest way."""
    _each_of_tabletop()
    with tempfile.TemporaryDirectory() as folder:
        workspace = load_workspace(_crowded(Path(folder)))
        task = read_task("pickup green", workspace)
        fastest = WantedWay(fastest=True)
        assignment = Assignment(cell=Cell.load(workspace), world=workspace.stated_world, wanted=fastest)
    starts = np.linspace(0, len(task.candidates) - YAWS, max(1, wanted // YAWS)).astype(int) // YAWS * YAWS
    chosen = [candidate for start in starts for candidate in task.candidates[start : start + YAWS]]
    rows, feasible, wanted, start = [], 0, len(chosen), time.perf_counter()
    for number, assessment in enumerate(assess_all(assignment, chosen, 1), 1):
        feasible += assessment.feasible
        if number in {round(wanted * share / 4) for share in (1, 2, 3, 4)}:
            passed = time.perf_counter() - start
            resident = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
            rows.append([f"{number} assessed", f"{feasible}", f"{passed:.1f}", f"{number / passed:.1f}",
                         f"{len(task.candidates) * passed / number:.0f}", f"{resident:.1f}"])  # fmt: skip
    print_table(
        f"{len(task.candidates):,} candidates ({OBJECTS} objects, {YAWS} approach yaws), {CAMERAS} cameras",
        ["", "feasible", "s", "per s", "s for all", "MB now"],
        rows,
    )


def _each_of_tabletop() -> None:
    workspace = load_workspace(TABLETOP)
    world = workspace.stated_world
    candidates = read_task("pickup green", workspace).candidates
    rows = []
    for candidate in candidates:
        to_figures, to_sentence, states = [], [], 0
        for _ in range(REPEATS):
            # In a cell loaded anew, with all the others done before: nothing is known of this one yet.
            cell = Cell.load(workspace)
            for other in candidates:
                if other is not candidate:
                    Assignment(cell=cell, world=world).assess(other)
            start = time.perf_counter()
            result = study(cell, candidate, world, Adaptive(), full=False)
            if isinstance(result, Study):
                states = result.assessment("").states or 0
            to_figures.append(1e3 * (time.perf_counter() - start))
            if isinstance(result, Study):
                verdict(cell, result)
            to_sentence.append(1e3 * (time.perf_counter() - start))
        rows.append([candidate.name, f"{states}", f"{min(to_figures):.1f}", f"{np.median(to_figures):.1f}",
                     f"{min(to_sentence):.1f}"])  # fmt: skip
    print_table(
        "One whole candidate of tabletop, loaded (target 30 ms)",
        ["", "states", "least ms to the figures", "median", "least with the verdict"],
        rows,
    )


def _crowded(folder: Path) -> Path:
    """A copy of tabletop with many small cubes, cameras and approach yaws."""
    shutil.copytree(TABLETOP.parents[1] / "skills", folder / "skills")
    shutil.copytree(TABLETOP.parent / "robots", folder / "workspaces" / "robots")
    skill = folder / "skills" / "pickup" / "skill.yaml"
    settings = yaml.safe_load(skill.read_text())
    settings["motion"]["approach_yaw"] = {"values": [f"{360 * i / YAWS:g} deg" for i in range(YAWS)]}
    skill.write_text(yaml.safe_dump(settings, sort_keys=False))

    cell: dict[str, Any] = yaml.safe_load((TABLETOP / "workspace.yaml").read_text())
    cell["objects"] = {"table": cell["objects"]["table"]}
    for number in range(OBJECTS):
        angle, radius = 2 * np.pi * (number % 40) / 40, 0.36 + 0.07 * (number // 40)
        place = [float(radius * np.cos(angle)), float(radius * np.sin(angle)), 0.0125]
        cell["objects"][f"g{number}"] = {
            "type": "cube", "color": "green", "size": ["25 mm"] * 3, "pose": {"position": place}, "on": "table",
        }  # fmt: skip
    camera = next(iter(cell["cameras"].values()))
    cell["cameras"] = {}
    for number in range(CAMERAS):
        angle = 2 * np.pi * number / CAMERAS
        place = [float(1.2 * np.cos(angle)), float(1.2 * np.sin(angle)), 0.7 + 0.3 * (number % 3)]
        target = [float(0.4 * np.cos(angle)), float(0.4 * np.sin(angle)), 0.05]
        cell["cameras"][f"cam{number}"] = {**camera, "pose": {"position": place, "look_at": target}}
    cell["state"] = ["hand_empty", *(f"obj_on_table(g{number})" for number in range(OBJECTS))]
    cell.pop("tasks", None)
    crowded = folder / "workspaces" / "crowded"
    crowded.mkdir(parents=True)
    return write_cell(cell, crowded)
