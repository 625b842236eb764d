"""The facts that follow from a cell, so that its state need not say them."""

from __future__ import annotations

import re

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.task.feasibility import unmet_preconditions
from sqrp_cli.task.task import read_task
from tests.cells import ROOT, refused

TOWER = ROOT / "workspaces" / "tower"


def tower(*, state: str = "", **edits: str) -> Workspace:
    """The tower's cell with another state, and other text about its objects."""
    text = (TOWER / "workspace.yaml").read_text(encoding="utf-8")
    text = re.sub(r"state:\n(  - .*\n)+", f"state: [{state}]\n", text)
    for name, entry in edits.items():
        text, changed = re.subn(rf"(  {name}: .*?)(pose: .*)", rf"\1{entry}", text)
        assert changed == 1
    return load_workspace(TOWER, text.encode())


@pytest.mark.parametrize("cell", ["tabletop", "screws", "tower"])
def test_the_stated_facts_of_the_shipped_cells_follow_from_the_cells_alone(cell):
    path = ROOT / "workspaces" / cell
    text = (path / "workspace.yaml").read_text(encoding="utf-8")
    without, count = re.subn(r"\nstate:.*\n(  - .*\n)+", "\n", text)
    assert count == 1
    stated, found = load_workspace(path), load_workspace(path, without.encode())
    assert found.state == stated.state == found.derived.keys()
    assert not stated.derived
    assert found.digest == stated.digest


def test_what_stands_on_something_movable_is_not_on_a_fixture():
    found = {
        str(fact): why for fact, why in tower(blue="pose: {position: [0.45, 0.1, 0.07]}, on: green}").derived.items()
    }
    assert found == {
        "hold(red)": "`held: +z`", "obj_on_table(green)": "`on: table`", "on(blue, green)": "`on: green`",
    }  # fmt: skip


@pytest.mark.parametrize(("state", "green"), [
        ("not obj_on_table(green)", set()),
        ('"on(green, blue)"', {"on(green, blue)"}),  # the state says where it stands
        ("", {"obj_on_table(green)"}),
])  # fmt: skip
def test_the_state_goes_before_what_follows(state, green):
    assert {str(fact) for fact in tower(state=state).state if "green" in fact.arguments} == green


@pytest.mark.parametrize("fact", ["hand_empty", "obj_on_table(red)", '"on(red, blue)"'])
def test_a_fact_that_contradicts_what_is_held_is_refused_where_it_stands(fact):
    problem = refused(tower, state=fact)
    fact = fact.strip('"')
    assert problem.code == "contradictory-facts"
    assert problem.message == f"`state.0`: the state has `{fact}`, but `red` is in the tool"
    assert problem.mend == f"remove `{fact}` from the state, or state where `red` stands instead of `held`"
    assert problem.place.line == 48


def test_a_fact_and_its_negation_are_refused():
    assert refused(tower, state="obj_on_table(green), not obj_on_table(green)").code == "contradictory-facts"


def test_a_missing_fact_says_what_to_write():
    cell = Cell.load(tower(green="pose: {position: [0.45, 0.1, 0.025]}}"))
    (candidate, *_) = read_task("pickup green", cell.workspace).candidates
    assert unmet_preconditions(cell, candidate, cell.initial_world) == (
        "`pickup` needs `obj_on_table(green)`: add `obj_on_table(green)` under `state:`, or `on: table` to `green`",
        "`pickup` needs `hand_empty`, which does not hold",  # red has to be put down
    )


def test_show_tells_what_follows_from_what():
    document = ShowDocument.of(Cell.load(tower(state="obj_on_table(blue)")))
    assert document.derived == {"hold(red)": "`held: +z`", "obj_on_table(green)": "`on: table`"}
    assert document.state == ["hold(red)", "obj_on_table(blue)", "obj_on_table(green)"]
