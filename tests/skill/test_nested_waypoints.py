"""A waypoint whose names and settings stand in an entry within it is checked like any other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import Field, Tag

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.files.entries import Entry, Name, one_of
from sqrp_cli.skill import read_skill, settings
from sqrp_cli.skill.skill import GraspWaypoint, Names, RaiseWaypoint, RetreatWaypoint, SkillFile, origins


class Mixed(Entry):
    of: Annotated[tuple[Name, ...], Names("waypoint", home=True)]
    share: settings.OffsetShare


class MixedWaypoint(Entry):
    mixed: Mixed


NestedWaypoint = Annotated[
    Annotated[GraspWaypoint, Tag("<object>")]
    | Annotated[RetreatWaypoint, Tag("<retreat>")]
    | Annotated[RaiseWaypoint, Tag("<raise>")]
    | Annotated[MixedWaypoint, Tag("<mixed>")],
    one_of("object", "retreat", "raise", "mixed"),
]


class NestedSkillFile(SkillFile):
    waypoints: dict[Name, NestedWaypoint] = Field(default={})  # type: ignore[assignment]


ABOVE = "above: {from: grasp, retreat: 2 cm}"


@pytest.fixture
def problems(
    damaged: Callable[[dict[str, Any]], Path], monkeypatch: pytest.MonkeyPatch
) -> Callable[[dict[str, str]], tuple[Problem, ...]]:
    monkeypatch.setattr(read_skill.skill, "SkillFile", NestedSkillFile)

    def found(replace: dict[str, str]) -> tuple[Problem, ...]:
        with pytest.raises(InputError) as caught:
            load_workspace(damaged({"file": "pickup/skill.yaml", "replace": replace}))
        return caught.value.problems

    return found


@pytest.mark.parametrize(("stated", "code", "said"), [
        ("{of: [grasp, homm], share: 0.5}", "unknown-waypoint", "did you mean `home`"),
        ("{of: [grasp, home], share: 1.5}", "wrong-value", "at most 1"),
        ("{of: [grasp, home], share: 5 cm}", "wrong-unit", "found a length"),
        ("{of: [grasp, home], share: $lfit}", "unknown-parameter", "`lift`"),
        ("{of: [grasp, above], share: 0.5}", "cyclic-waypoint", "above -> above"),
])  # fmt: skip
def test_a_mistake_in_a_nested_entry_is_reported(problems, stated, code, said):
    problem = problems({ABOVE: f"above: {{mixed: {stated}}}"})[0]
    assert problem.code == code
    assert said in problem.message


def test_a_circle_through_several_origins_is_reported_once(problems):
    found = problems(
        {ABOVE: "above: {mixed: {of: [grasp, home, lifted], share: 0.5}}", "from: grasp, raise": "from: above, raise"}
    )
    assert [problem.code for problem in found] == ["cyclic-waypoint"]
    assert "above -> lifted -> above" in found[0].message


def test_a_parameter_that_only_a_nested_entry_uses_counts_as_used(damaged, monkeypatch):
    monkeypatch.setattr(read_skill.skill, "SkillFile", NestedSkillFile)
    edits = {"raise: $lift": "raise: 5 cm", ABOVE: "above: {mixed: {of: [grasp, home], share: $lift}}"}
    edits |= {"lift: {from: 5 cm, to: 15 cm, count: 3}": "lift: {values: [0.5]}"}
    workspace = load_workspace(damaged({"file": "pickup/skill.yaml", "replace": edits}))
    lift = next(p for p in workspace.skills["pickup"].motion_parameters if p.name == "lift")
    assert len(lift.kinds) == 1
    assert origins(workspace.skills["pickup"].waypoints["above"]) == {"grasp": ("mixed", "of", 0)}
