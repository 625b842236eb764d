"""A workspace is known by what it means: not by comments, layout, notation and places, but by everything else."""

from __future__ import annotations

import re
import shutil
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from sqrp_cli.cell.canonical_values import canonical_values, digest_of_values, what_changed
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.files.source import dotted
from sqrp_cli.files.yaml_edit import with_values
from sqrp_cli.files.yaml_file import read_yaml
from tests.cells import read_cases

CELL = Path(__file__).parents[1] / "cases" / "cell"


@pytest.fixture(scope="module")
def before() -> Workspace:
    return load_workspace(CELL)


def sentences(before: Workspace, now: Workspace) -> tuple[str, ...]:
    found = what_changed(before.canonical_values, now.canonical_values, now.skills)
    assert bool(found) == before.digests.isdisjoint(now.digests)
    return found


@pytest.mark.parametrize(("name", "digest"), [
        ("tabletop", "46d1c25de0db777a2a69ae6f53b7eb1e18ef1364c656e70f6e2d0aa4972aba21"),
        ("screws", "379bc610e2dd0600aa398d6aa13033328a15af497a14084dc1d1d2f35a22976d"),
        ("tower", "749a8aa2d1027426d60d6001c66a9600052e70ae966a231589202ad343a9bbda"),
])  # fmt: skip
def test_programs_and_baselines_of_before_stay_valid_while_their_cells_do_not_change(name, digest):
    workspace = load_workspace(Path(__file__).parents[2] / "workspaces" / name)
    now = canonical_values(workspace, defaultdict(str))  # whatever its meshes
    unnamed = {about: {key: one for key, one in of.items() if key[-5:] != ".does"} for about, of in now.items()}
    assert digest_of_values(unnamed if name == "screws" else now) == digest  # its skill had no words for what it does
    assert what_changed(unnamed, now, workspace.skills) == what_changed(now, unnamed, workspace.skills) == ()


@pytest.mark.parametrize("case", read_cases("cell_changes.yaml"), ids=lambda case: f"{case['file']}-{case['new'][:30]}")
def test_what_has_changed_is_said_in_the_words_of_the_cell_and_what_has_no_meaning_is_no_change(before, damaged, case):
    now = load_workspace(damaged({"file": case["file"], "replace": {case["old"]: case["new"]}}))
    assert sentences(before, now) == tuple(case["says"])
    assert len(back := sentences(now, before)) == len(case["says"])
    assert case["says"] != ["object lost is gone"] or back == ("object lost is new",)


def test_neither_do_the_order_of_keys_and_the_name_of_the_folder(before, tmp_path):
    shutil.copytree(CELL, tmp_path / "another name")
    path = tmp_path / "another name" / "workspace.yaml"
    for file in (path, path.with_name("pickup") / "skill.yaml"):
        file.write_text(yaml.safe_dump(reordered(read_yaml(file).data), sort_keys=False))
    now = load_workspace(path.parent)
    assert now.name != before.name
    assert list(now.cameras) != list(before.cameras)
    assert sentences(before, now) == ()


def reordered(value: object) -> object:
    """Every mapping in the opposite order."""
    if isinstance(value, dict):
        return {key: reordered(value[key]) for key in reversed(value)}
    return [reordered(item) for item in value] if isinstance(value, list) else value


def test_another_skill_is_no_change_for_those_who_do_not_use_it(before, damaged):
    now = load_workspace(damaged({"file": "pickup/skill.yaml", "replace": {"retreat: 2 cm": "retreat: 3 cm"}}))
    assert what_changed(before.canonical_values, now.canonical_values, ["place"]) == ()


NUMBERS = [
    path
    for path, value in read_workspace_document(CELL / "workspace.yaml").leaves.items()
    if re.match(r"-?[0-9]", str(value)) and not path.startswith("tasks.")
]
LOOKS_THE_SAME = {
    "cameras.top.pose.look_at.2",  # straight down, wherever on the line
    "cameras.hand.pose.quaternion.3",  # of any length
}


@pytest.mark.parametrize("path", sorted({*NUMBERS} - LOOKS_THE_SAME))
def test_every_number_of_the_file_counts(before, path):
    """A number that is a little greater is another cell, whatever the number says."""
    document = read_workspace_document(CELL / "workspace.yaml")
    value, unit = re.fullmatch(r"(\S+)(.*)", str(document.leaves[path])).groups()
    more = int(value) + 1 if path.endswith((".marker", "width", "height")) else float(value) + 1e-3
    text = with_values(document, {dotted(tuple(path.split("."))): f"{more}{unit}"})
    assert sentences(before, load_workspace(CELL, text)) != ()


def test_the_values_are_plain_and_finite(before):
    for value in (value for values in before.canonical_values.values() for value in values.values()):
        assert isinstance(value, str | bool | int | float | tuple)
        assert np.isfinite([part for part in np.ravel(value) if isinstance(part, float)]).all()
