from __future__ import annotations

import re

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.search.suggestion import Suggester, best_suggestion, check_candidate
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.program_update import world_after
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.task.task import Candidate, read_task
from tests.conftest import TABLETOP

DROP_PDDL = """
(define (domain drop)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates (hold ?object - movable) (obj_on_table ?object - movable) (hand_empty))
  (:action drop
    :parameters (?object - movable)
    :precondition (hold ?object)
    :effect (and (hand_empty) (not (hold ?object)))))
"""
DROP_YAML = """
primitives:
  - {name: d1, joint_move: home}
  - {name: d2, release: 0.5 s}
formulas:
  - always[d1.start, d1.end] hold
targets:
  hold:
    boxes: [{name: at_cup, frame: tool, size: [4 cm, 4 cm, 4 cm], detector: color, encloses: [object, tool]}]
"""


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """The tabletop with a second skill, which drops what is held."""
    folder = tmp_path_factory.mktemp("cell")
    (folder / "drop").mkdir()
    (folder / "drop" / "drop.pddl").write_text(DROP_PDDL)
    (folder / "drop" / "skill.yaml").write_text(DROP_YAML)
    text = (TABLETOP / "workspace.yaml").read_text()
    text = text.replace("../robots/", f"{TABLETOP.parent}/robots/")
    text = re.sub(r"skills: \[.*\]", f"skills: [{TABLETOP.parents[1]}/skills/pickup, drop]", text)
    (folder / "workspace.yaml").write_text(text)
    return Cell.load(load_workspace(folder))


def candidate(cell: Cell, task: str) -> Candidate:
    return read_task(task, cell.workspace).candidates[0]


@pytest.fixture(scope="module")
def holding(cell: Cell) -> World:
    """The world after g2 was picked up."""
    found = analyse(cell, candidate(cell, "pickup g2"), cell.initial_world, Adaptive(), full=False)
    assert isinstance(found, Analysis)
    return world_after(found.planned.candidate, found.planned.motion, found.planned.world)


def test_a_precondition_that_holds_needs_no_plan(cell: Cell) -> None:
    suggestion = Suggester(cell, cell.initial_world).suggest(candidate(cell, "pickup g2"))
    assert (suggestion.planning, suggestion.plan, suggestion.explanation) == ("satisfied", None, "")


def test_a_full_hand_is_emptied_first_and_the_step_is_scored(cell: Cell, holding: World) -> None:
    suggestion = Suggester(cell, holding).suggest(candidate(cell, "pickup g3"))
    assert suggestion.planning == "plan"
    assert suggestion.plan is not None
    (step,) = suggestion.plan
    assert (step.action, step.feasible, step.reasons) == ("drop(g2)", True, [])
    assert step.result.q_eoi is None, "drop has no event of interest"
    assert suggestion.explanation == "first do drop(g2)"


def test_of_many_candidates_it_is_asked_whether_they_can_be_done_and_the_best_has_figures(tabletop: Workspace) -> None:
    cell = Cell.load(tabletop)
    suggester = Suggester(cell, cell.initial_world, candidates=21)
    some = read_task("place g2 crate", tabletop).candidates[:3]
    checked = [check_candidate(one, suggester) for one in some]
    found = [one for one in checked if one.last and one.last.feasible]
    assert found
    assert all(one.last and one.last.result and one.last.result.q_eoi is None for one in found)
    *_, best = best_suggestion(checked, suggester)
    alone = Suggester(cell, cell.initial_world).suggest(best.result.candidate).last
    assert best.result.q_eoi == alone.result.q_eoi is not None


def test_what_no_skill_can_establish_is_said_to_be_impossible(cell: Cell, holding: World) -> None:
    suggestion = Suggester(cell, holding).suggest(candidate(cell, "pickup g2"))
    assert suggestion.planning == "impossible"
    assert "`obj_on_table(g2)`" in suggestion.explanation
    assert "hand_empty" not in suggestion.explanation


def test_a_step_that_cannot_be_done_says_why(cell: Cell, holding: World) -> None:
    facts = (holding.facts - {Atom("hold", ("g2",))}) | {Atom("hold", ("g1",))}
    confused = World(facts, cell.initial_world.X_WO, None, None, holding.joints)
    suggestion = Suggester(cell, confused).suggest(candidate(cell, "pickup g3"))
    assert suggestion.plan is not None
    (step,) = suggestion.plan
    assert not step.feasible
    assert "the tool holds nothing that `d2` could release" in step.reasons
