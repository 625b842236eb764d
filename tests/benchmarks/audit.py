"""An audit of some 1,200 JPEG images of 640x480, as a whole command: survey of six cameras, then every prediction."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from tests.benchmarks.scene import TABLETOP
from tests.benchmarks.startup import SQRP
from tests.benchmarks.table import print_table


def audits(runs: int) -> None:
    """Wall and CPU time of `sqrp audit`, of a recording of a run in the tabletop with twice its images."""
    with tempfile.TemporaryDirectory() as folder:
        program, recording = _recorded(Path(folder))
        rows = []
        for _ in range(runs):
            before, start = _spent(), time.perf_counter()
            command = [SQRP, "audit", program, recording, "--json"]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            wall, spent = time.perf_counter() - start, _spent() - before
            found = json.loads(done.stdout)
            images = sum(camera["images"] for camera in found["cameras"].values())
            rows.append((wall, f"{images:,}", f"{wall:.1f}", f"{spent:.1f}", f"{100 * found['precision']:.1f}"))
    head = ["", "images", "wall [s]", "CPU [s]", "came true [%]"]
    print_table(f"Audits, {os.cpu_count()} cores", head, [[f"run {n}", *row[1:]] for n, row in enumerate(rows, 1)])


def _recorded(folder: Path) -> tuple[Path, Path]:
    """A program, and a recording of its run with 20 images a second of each camera."""
    cells = shutil.copytree(TABLETOP.parent, folder / "workspaces")
    shutil.copytree(TABLETOP.parents[1] / "skills", folder / "skills")
    workspace = cells / TABLETOP.name / "workspace.yaml"
    workspace.write_text(workspace.read_text(encoding="utf-8").replace("rate: 10 Hz", "rate: 20 Hz"), encoding="utf-8")
    program, recording = folder / "pick.yaml", folder / "run.mcap"
    for command in (
        ["rank", workspace.parent, "pickup g2", "--program", program],
        ["run", program, "--sim", "--record", recording],
    ):
        subprocess.run([SQRP, *command], check=True, capture_output=True)
    return program, recording


def _spent() -> float:
    """CPU time of all processes that were waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
