"""Whether candidates are worth further processes."""

from __future__ import annotations

import pytest

from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform import processes
from sqrp_cli.study.pipeline import WORTH_A_PROCESS, RankJob, assess_all
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

STATED = "approach_yaw=0 elbow=up shoulder=left wrist=no_flip via=direct"


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        ("pickup g1", True),
        (f"pickup g1 {STATED}", False),
        (f"pickup g1 {STATED} path=seen", True),
        (f"pickup g1 {STATED.replace('left', 'any')}", True),
    ],
)
def test_a_candidate_leaves_something_free_unless_all_is_stated(task, expected, tabletop):
    assert read_task(task, tabletop).candidates[0].leaves_free is expected


def test_a_few_candidates_of_one_way_each_stay_in_one_process(tabletop, monkeypatch):
    def refused(*_):
        raise AssertionError

    monkeypatch.setattr(processes, "in_processes", refused)
    cell = Cell.load(tabletop)
    assignment = RankJob(FixedCount(2), cell=cell, world=cell.initial_world)
    few = read_task(f"pickup green {STATED}", cell.workspace).candidates
    assert 4 < len(few) < 2 * WORTH_A_PROCESS
    assert len(list(assess_all(assignment, few, 2))) == len(few)
    with pytest.raises(AssertionError):
        list(assess_all(assignment, read_task("pickup green", cell.workspace).candidates, 2))
