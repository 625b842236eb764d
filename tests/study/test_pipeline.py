"""Whether candidates are worth further processes."""

from __future__ import annotations

import gc
from dataclasses import replace

import pytest

from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform import processes
from sqrp_cli.study import pipeline
from sqrp_cli.study.find import WantedWay
from sqrp_cli.study.pipeline import WORTH_A_PROCESS, RankJob, assess_all
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

STATED = "approach_yaw=0 elbow=up shoulder=left wrist=no_flip via=direct"


def test_a_candidate_leaves_something_free_unless_all_is_stated(tabletop):
    tasks = ["pickup g1", *(f"pickup g1 {s}" for s in (STATED, f"{STATED} path=seen", STATED.replace("left", "any")))]
    free = [read_task(task, tabletop).candidates[0].leaves_free for task in tasks]
    assert free == [True, False, True, True]


def test_a_few_candidates_of_one_way_each_stay_in_one_process(tabletop, monkeypatch):
    def refused(*_):
        raise AssertionError

    monkeypatch.setattr(processes, "in_processes", refused)
    cell = Cell.load(tabletop)
    job = RankJob(FixedCount(2), cell=cell, world=cell.initial_world)
    few = read_task(f"pickup green {STATED}", cell.workspace).candidates
    assert 4 < len(few) < 2 * WORTH_A_PROCESS
    assert len(list(assess_all(job, few, 2))) == len(few)
    with pytest.raises(AssertionError):
        list(assess_all(job, read_task("pickup green", cell.workspace).candidates, 2))


@pytest.mark.parametrize("task", ["pickup green", "pickup g2 then place g2 crate along=0 across=0"])
def test_a_verdict_that_was_left_out_is_that_of_the_assessment(tabletop, task):
    cell = Cell.load(tabletop)
    every = RankJob(FixedCount(5), wanted=WantedWay(fastest=True), cell=cell, world=cell.initial_world)
    without = replace(every, verdicts=False)
    candidates = read_task(task.replace("g2 then", f"g2 {STATED} then"), tabletop, cell.initial_world.facts).candidates
    told, some = (list(assess_all(one, candidates[:2], 1)) for one in (every, without))
    assert [without.add_verdict(one).verdict for one in some] == [one.verdict for one in told] != ["", ""]
    assert not any(step.verdict for one in some for step in one.steps or (one,))


def test_steps_that_are_kept_for_a_cell_go_with_it(tabletop):
    """Another cell may stand at the same address later, with other cameras."""
    cell = Cell.load(tabletop)
    world = cell.initial_world
    task = read_task(f"pickup g2 {STATED} then place g2 crate along=0 across=0", tabletop, world.facts)
    name, camera = next(iter(tabletop.cameras.items()))
    other = cell.with_cameras_of(replace(tabletop, cameras={name: camera}))
    RankJob(cell=other, world=world, sampling=FixedCount(5), wanted=WantedWay(fastest=True)).assess(task.candidates[0])
    assert other in pipeline._known[world]
    cells = len(pipeline._known[world])
    del other
    gc.collect()
    assert len(pipeline._known[world]) == cells - 1
