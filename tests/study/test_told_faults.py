"""A fault that a motion itself fulfils at first counts from when images can tell it."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.study.analysis import analyse, planned_motion
from sqrp_cli.study.program_update import make_step
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task

SCREWS = Path(__file__).parents[2] / "workspaces" / "screws" / "workspace.yaml"


def test_a_slip_counts_from_when_the_lifted_part_has_left_its_place():
    """Without markers on the fingers; the part is 60 mm high, and the formula settles in 0.3 s."""
    text = re.sub(r"  markers:\n(    .*\n)+", "", SCREWS.read_text(encoding="utf-8")).replace("  - open\n", "")
    cell = Cell.load(load_workspace(SCREWS, text.encode()))
    candidate = read_task("pickup red1", cell.workspace).candidates[0]
    motion = feasible_motion(cell, candidate, cell.initial_world)
    assert isinstance(motion, Motion)
    (number,) = (n for n, one in enumerate(motion.primitives) if one.name == "a4")
    lift = motion.primitives[number]
    t = np.arange(lift.start, lift.end, 1e-3)
    heights = cell.model.tool_poses(motion.positions(number, t)[:, : len(cell.model.arm)])[:, 2, 3]
    left = float(t[np.argmax(heights - heights[0] > 0.03)])
    assert all(low <= high + 1e-9 for low, high in pairwise(heights))

    formulas = planned_motion(cell, candidate, cell.initial_world, motion).formulas
    (slip,) = (one for one in formulas if one.fault == "slip")
    assert slip.start == pytest.approx(left + 0.3, abs=0.021)
    assert slip.end == lift.end
    analysis = analyse(cell, candidate, cell.initial_world, FixedCount(5), full=True)
    # A part that slips before is noticed once images can tell it: its delay counts from the slip.
    (onset,), found = analysis.onsets["slip"], analysis.result.faults["slip"]
    assert onset.x[0] == lift.start
    assert found.delay_worst is None or found.delay_worst >= slip.start - lift.start
    step = make_step("pickup red1", analysis, analysis.result, tuple(cell.workspace.cameras))
    (told,) = (one.formula for one in step.formulas if one.fault == "slip")
    assert float(told.split("[")[1].split(",")[0]) == pytest.approx(slip.start, abs=1e-9)
