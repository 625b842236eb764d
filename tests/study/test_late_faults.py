"""Why faults are noticed late: without what is named, they are noticed sooner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import FaultMetrics
from sqrp_cli.logic.image_time import Window
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study import late_faults
from sqrp_cli.study.analysis import analysed
from sqrp_cli.study.drop_detection import DropOnset, ShownDrops
from sqrp_cli.study.find import WantedWay, find_way
from sqrp_cli.study.late_faults import why_late
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.timeline import PlannedMotion
from sqrp_cli.task.task import read_task
from tests.cells import shipped_cell, write_cell

BELOW = {
    "pose": {"position": [0.48, 0.28, -0.5], "look_at": [0.48, 0.28, 0.05], "up": [1, 0, 0]},
    "image": {"width": 1280, "height": 960, "horizontal_fov": "90 deg"}, "near": 0.1, "far": 5.0,
    "rate": 10, "latency": 0.05,
}  # fmt: skip


def slip(cell: Cell, planned: PlannedMotion, *, without: str = "") -> FaultMetrics:
    """The figures of a slip, without a camera."""
    cameras = tuple(one for one in cell.observer.cameras if one.name != without)
    seen = replace(cell, observer=replace(cell.observer, cameras=cameras))
    return analysed(seen, planned, Adaptive(), full=False).result.faults["slip"]


def fastest(folder: Path, task: str) -> tuple[Cell, PlannedMotion]:
    cell = Cell.load(load_workspace(folder))
    candidate = read_task(task, cell.workspace).candidates[0]
    found = find_way(cell, candidate, cell.initial_world, Adaptive(), WantedWay(fastest=True))
    assert not isinstance(found, Infeasible)
    return cell, found.analysis.planned


@pytest.mark.parametrize(
    ("windows", "lag", "cause", "says"),
    [
        ([(0.0, 4.0)], 0.0, "frame", "so long take a frame and the latency"),
        ([(0.0, 4.0)], 0.4, "line_of_sight", "camera `left` may take g1 for held until 0.40 s after, because it falls"),
        ([(0.0, 4.0)], 9.0, "line_of_sight", "camera `left` may take g1 for held to the end, because it falls"),
        ([(0.0, 1.5), (2.2, 4.0)], 0.4, "not_seen", "no camera sees it for 0.70 s"),
        ([(0.0, 2.9)], 0.0, "not_seen", "no camera sees it from 2.9"),
        ([], 0.4, "not_seen", "no camera sees it"),
    ],
)
def test_what_takes_longest_is_named(
    windows: list[tuple[float, float]], lag: float, cause: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell: Any = SimpleNamespace(observer=SimpleNamespace(cameras=[SimpleNamespace(name="left")]))
    planned: Any = SimpleNamespace(motion=SimpleNamespace(time=4.0), formulas=())
    monkeypatch.setattr(late_faults, "_unseen", lambda *given: ("not_seen", "right", f"no camera sees it{given[-1]}"))
    x = np.array([1.0, 3.0])
    causes = np.array([["line_of_sight"] * 2])
    drops = ShownDrops("g1", x, np.array([x + lag]), x, causes)
    onset = DropOnset(x, x + np.array([lag, lag if lag > 4 else 0.0]), drops=drops)
    reason = why_late(cell, planned, "slip", [Window(*ends, 0.1, 0.05) for ends in windows], [onset])
    assert reason.kind == cause
    assert reason.words.startswith(says)


def test_without_the_camera_that_is_named_a_fault_is_noticed_sooner(tmp_path: Path) -> None:
    """From below, a part falls along the line of sight, and the table hides where it would lie."""
    document = shipped_cell("tabletop")
    document["cameras"]["below"] = BELOW
    document["objects"]["table"]["fixed"] = False  # what may be moved lets cameras contradict
    write_cell(document, tmp_path)
    cell, planned = fastest(tmp_path, "pickup g2")
    known, less = (slip(cell, planned, without=name) for name in ("", "below"))
    assert known.why is not None
    assert known.why.camera == "below"
    assert known.why.kind in ("line_of_sight", "no_place")
    assert (known.delay_worst, known.why.after) == (None, None)
    assert less.delay_worst is not None
    assert less.delay_worst < 0.6
