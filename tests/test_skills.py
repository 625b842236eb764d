"""The skills that are shipped fit together: plans from one to the next, with predicates that mean the same in all."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Place
from sqrp_cli.logic.domain import Compound, Domain, Holds, merge_domains
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import find_plan
from sqrp_cli.logic.planning_task import PlanStep
from sqrp_cli.skill.read_skill import read_skill
from sqrp_cli.task.task import read_task

SKILLS = Path(__file__).parents[1] / "skills"
CUBES = ("a", "b", "c")
OBJECTS = {**{cube: frozenset({"cube", "movable"}) for cube in CUBES}, "tray": frozenset({"tray", "fixture"})}


def domain(*names: str) -> Domain:
    folders = [SKILLS / name for name in names]
    return merge_domains([read_skill(folder, Place(folder), {}).domain for folder in folders])


class Cubes:
    """What may be done with cubes, worked out by hand: where each one stands, and what is held."""

    def __init__(self, under: dict[str, str], held: str | None = None) -> None:
        self.under, self.held = under, held

    @property
    def facts(self) -> frozenset[Atom]:
        standing = [Atom("on", (c, u)) if u in CUBES else Atom("obj_on_table", (c,)) for c, u in self.under.items()]
        hand = Atom("hold", (self.held,)) if self.held else Atom("hand_empty", ())
        return frozenset([*standing, hand])

    def clear(self, cube: str) -> bool:
        return cube != self.held and cube not in self.under.values()

    def do(self, step: PlanStep) -> None:
        cube, *rest = step.arguments
        if step.action in ("pickup", "unstack"):
            below = self.under.pop(cube)
            assert self.held is None
            assert cube not in self.under.values()
            assert (below in CUBES) == (step.action == "unstack")
            assert not rest or rest == [below]
            self.held = cube
        else:
            (onto,) = rest
            assert self.held == cube
            assert step.action == ("stack" if onto in CUBES else "place")
            assert onto not in CUBES or self.clear(onto)
            self.under[cube], self.held = onto, None


def goal(*atoms: Atom) -> Compound:
    return Compound("and", tuple(Holds(atom.predicate, atom.arguments) for atom in atoms))


@pytest.mark.parametrize(("start", "wanted", "steps"), [
    (Cubes({"a": "tray", "b": "tray", "c": "tray"}), {"b": "c", "a": "b"}, 4),
    (Cubes({"b": "tray", "c": "tray"}, "a"), {"a": "b", "c": "a"}, 3),
    (Cubes({"c": "tray", "b": "c", "a": "b"}), {"b": "a", "c": "b"}, 6),  # upside down
    (Cubes({"c": "tray", "b": "c", "a": "b"}), {"c": "a"}, 6),
])  # fmt: skip
def test_towers_are_planned_with_pickup_place_stack_and_unstack(
    start: Cubes, wanted: dict[str, str], steps: int
) -> None:
    cubes = Cubes(dict(start.under), start.held)
    target = goal(*(Atom("on", pair) for pair in wanted.items()))
    plan = find_plan(domain("pickup", "place", "stack", "unstack", "inspect"), OBJECTS, cubes.facts, target, {})
    assert isinstance(plan, tuple)
    for step in plan:
        cubes.do(step)
    assert wanted.items() <= cubes.under.items()
    assert len(plan) == steps


@pytest.mark.parametrize(("begins", "wanted", "steps"), [(True, "a", ["pickup"]), (False, "b", ["place", "pickup"])])
def test_a_gripper_with_markers_is_open_again_once_it_has_placed_something(
    begins: bool, wanted: str, steps: list[str]
) -> None:
    standing = [Atom("obj_on_table", (cube,)) for cube in CUBES if begins or cube != "a"]
    facts = frozenset([*standing, Atom("open", ()) if begins else Atom("hold", ("a",))])
    found = find_plan(domain("pickup/markers", "place/markers"), OBJECTS, facts, goal(Atom("hold", (wanted,))), {})
    assert isinstance(found, tuple)
    assert [step.action for step in found] == steps
    assert found[-1].arguments[0] == wanted


def test_every_shipped_skill_is_in_the_documentation() -> None:
    page = (SKILLS.parent / "docs" / "reference" / "skills.md").read_text(encoding="utf-8")
    assert [folder.name for folder in SKILLS.iterdir() if f"`{folder.name}`" not in page] == []


SCREWS = SKILLS.parent / "workspaces" / "screws" / "workspace.yaml"


def test_pickup_is_done_with_whatever_tool_a_cell_has() -> None:
    text = re.sub(r"  markers:\n(    .*\n)+", "", SCREWS.read_text(encoding="utf-8")).replace("- open", "- hand_empty")
    cells = [
        load_workspace(SCREWS),
        load_workspace(SCREWS, text.encode()),
        load_workspace(SKILLS.parent / "workspaces" / "tabletop"),
    ]
    markers, fingers, suction = (cell.skills["pickup"] for cell in cells)
    folders = [SKILLS / "pickup" / "markers", SKILLS / "pickup" / "fingers", SKILLS / "pickup"]
    assert [markers.folder, fingers.folder, suction.folder] == folders
    assert ["open" in one.domain.predicates for one in (markers, fingers, suction)] == [True, False, False]
    assert fingers.domain.path == suction.domain.path  # one PDDL file for both


def test_what_names_the_former_skill_for_fingers_is_still_read() -> None:
    text = SCREWS.read_text(encoding="utf-8")
    former = text.replace("skills/pickup]", "skills/pickup_two_finger]")
    former = former.replace("task: pickup", "task: pickup_two_finger")
    workspace = load_workspace(SCREWS, former.encode())
    assert former != text
    assert list(workspace.skills) == ["pickup"]
    old, new = (read_task(f"{word} screw", workspace) for word in ("pickup_two_finger", "pickup"))
    assert old.candidates == new.candidates
