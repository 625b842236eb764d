"""What the tool holds at the beginning: stated as a pose, or told from the facts."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from itertools import chain, permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import InputError
from tests.cells import edit, refused

Damage = Callable[[dict[str, Any]], Path]


def loaded(damaged: Damage, **replace: str) -> Workspace:
    texts = {"state": "  - hand_empty\n  - on_table(red)", "pose": "pose: {position: [0.4, 0, 2 cm]}"}
    edits = {texts[key]: value for key, value in replace.items()}
    return load_workspace(damaged({"file": "workspace.yaml", "replace": edits}))


@pytest.mark.parametrize(("pose", "center", "up"), [
        ("pose: {held: +z}", [0, 0, 0.02], [0, 0, -1]),  # by its top: upside down before the tool
        ("pose: {held: -x, depth: 1 cm}", [0, 0, 0.01], [0, 1, 0]),
        ("pose: {held: +z, yaw: 90 deg}", [0, 0, 0.02], [0, 0, -1]),
])  # fmt: skip
def test_what_is_held_lies_before_the_tool_as_its_side_says(damaged, pose, center, up):
    world = loaded(damaged, pose=pose, state="  - hold(red)").stated_world
    assert world.held == "red"
    assert world.X_TO[:3, 3] == pytest.approx(center, abs=1e-12)
    assert np.abs(world.X_TO[:3, 2]) == pytest.approx(np.abs(up), abs=1e-12)
    assert "red" not in world.X_WO


def test_a_fact_that_a_grasp_makes_true_puts_the_object_into_the_tool_with_a_warning(damaged):
    workspace = loaded(damaged, state="  - hold(red)")
    told = [warning for warning in workspace.warnings if warning.code == "held-by-the-facts"]
    assert [warning.severity for warning in told] == ["warning"]
    assert told[0].mend == "write `pose: {held: +z}`"
    world = workspace.stated_world
    assert world.held == "red"
    assert world.X_TO[:3, 3] == pytest.approx([0, 0, 0.02])


@pytest.mark.parametrize("facts", ["  - moved(red)", "  - moved(red)\n  - moved(blue)"])
def test_a_fact_of_a_skill_that_lets_go_again_says_nothing_about_the_tool(damaged, facts):
    released = "- {name: a5, joint_move: home}\n  - {name: a6, release: 1 s}"
    action = {"(hand_empty))\n  (:a": "(hand_empty) (moved ?object - movable))\n  (:a", "(and (hold ?": "(and (moved ?"}
    edits = [
        {"file": "pickup/skill.yaml", "replace": {"- {name: a5, joint_move: home}": released}},
        {"file": "pickup/pickup.pddl", "replace": action},
        {"file": "workspace.yaml", "replace": {"  - on_table(red)": facts}},
    ]
    workspace = load_workspace(damaged({"edits": edits}))
    assert workspace.stated_world.held is None
    assert workspace.objects["red"].X_WO is not None
    codes = [problem.code for problem in (*workspace.warnings, *lint(workspace))]
    assert not {"held-by-the-facts", "held-against-the-facts"} & set(codes)


HANDLED = "(hand_empty))\n  (:a", "(hand_empty) (handled ?object - movable))\n  (:a"
EFFECT = ":effect (and (hold ?object)", ":effect (and (handled ?object) (hold ?object)"


@pytest.mark.parametrize("facts", ["  - hand_empty\n  - handled(red)\n  - on_table(red)", "  - handled(red)"])
def test_only_the_literal_that_is_looked_for_in_the_tool_says_that_the_tool_holds_it(damaged, facts):
    edits = [
        {"file": "pickup/pickup.pddl", "replace": dict([HANDLED, EFFECT])},
        {"file": "workspace.yaml", "replace": {"  - hand_empty\n  - on_table(red)": facts}},
    ]
    workspace = load_workspace(damaged({"edits": edits}))
    assert workspace.stated_world.held is None
    assert workspace.objects["red"].X_WO is not None
    assert lint(workspace) == ()


def another_skill(cell: Path, name: str, predicates: str, effect: str, edits: dict[str, str]) -> None:
    """Add a skill like `pickup` with another effect on its object."""
    shutil.copytree(cell / "pickup", cell / name)
    (cell / name / "pickup.pddl").rename(cell / name / f"{name}.pddl")
    (cell / name / f"{name}.pddl").write_text(
        f"(define (domain {name}) (:requirements :strips :typing) (:types movable fixture - object)\n"
        f"  (:predicates (hold ?object - movable) (on_table ?object - movable) (hand_empty) {predicates})\n"
        f"  (:action {name} :parameters (?object - movable) :precondition (and (on_table ?object) (hold ?object))\n"
        f"   :effect {effect}))\n",
        encoding="utf-8",
    )
    edit(cell / name / "skill.yaml", *chain.from_iterable(edits.items()))
    edit(cell, "skills: [", f"skills: [{name}, ")


def pinching(cell: Path, name: str, edits: dict[str, str]) -> None:
    """Add a skill that grasps as `pickup` does, but by another word for it."""
    another_skill(cell, name, "(pinched ?object - movable)", "(pinched ?object)", edits)
    skill = cell / name / "skill.yaml"
    skill.write_text(re.sub(r"\bhold\b", "pinched", skill.read_text(encoding="utf-8")), encoding="utf-8")


def test_a_fact_that_a_skill_makes_true_of_what_is_held_contradicts_nothing(damaged):
    seen = "(hand_empty) (seen ?object - movable))\n  (:a"
    unseen = {HANDLED[0]: seen, "(and (hold ?object)": "(and (not (seen ?object)) (hold ?object)"}
    facts = {"  - hand_empty\n  - on_table(red)": "  - hold(red)\n  - seen(red)"}
    edits = [{"file": "pickup/pickup.pddl", "replace": unseen}, {"file": "workspace.yaml", "replace": facts}]
    cell = damaged({"edits": edits})
    with pytest.raises(InputError, match=r"`pickup`, which makes `hold\(red\)` true, makes `seen\(red\)` false"):
        load_workspace(cell)
    another_skill(cell, "look", "(seen ?object - movable)", "(seen ?object)", {"grasp: object, duration": "wait"})
    assert load_workspace(cell).stated_world.held == "red"


HELD_BY_ITS_SIDE = {"object: object, side: +z": "object: object, side: +x"}


@pytest.mark.parametrize("facts", ["hold(red)", "pinched(red)\n  - hold(red)"])
def test_how_an_object_is_held_is_asked_where_skills_hold_it_in_different_ways(damaged, facts):
    cell = damaged({"file": "workspace.yaml", "replace": {"hand_empty\n  - on_table(red)": facts}})
    if "pinched" in facts:
        pinching(cell, "pinch", HELD_BY_ITS_SIDE)
    else:
        another_skill(cell, "grip", "", "(hold ?object)", HELD_BY_ITS_SIDE)
    problem = refused(load_workspace, cell)
    assert problem.code == "ambiguous-hold"
    assert problem.place.line == 40
    assert facts.split()[-1] in problem.message
    assert "by its side +x" in problem.message
    assert "by its side +z" in problem.message
    assert "`pose: {held: +" in problem.mend
    edit(cell, "pose: {position: [0.4, 0, 2 cm]}", "pose: {held: +x}")
    assert load_workspace(cell).stated_world.held == "red"


def test_what_is_held_does_not_depend_on_the_order_of_facts_and_skills(damaged):
    cell = damaged(
        {"file": "workspace.yaml", "replace": {"hand_empty\n  - on_table(red)": "hold(red)\n  - pinched(red)"}}
    )
    pinching(cell, "abc", {})
    file = cell / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    found = []
    for skills, facts in product(permutations(["abc", "pickup"]), permutations(["hold(red)", "pinched(red)"])):
        own = text.replace("skills: [abc, pickup]", f"skills: [{', '.join(skills)}]")
        own = own.replace("  - hold(red)\n  - pinched(red)\n", "".join(f"  - {fact}\n" for fact in facts))
        file.write_text(own, encoding="utf-8")
        workspace = load_workspace(file)
        (told,) = (warning.message for warning in workspace.warnings if warning.code == "held-by-the-facts")
        found.append((told, workspace.stated_world.held, workspace.stated_world.X_TO.tolist()))
    assert len(found) == 4
    assert all(one == found[0] for one in found)
