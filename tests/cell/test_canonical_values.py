"""A workspace is known by what it means: not by comments, layout, notation and places, but by everything else."""

from __future__ import annotations

import re
import shutil
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from sqrp_cli.cell.canonical_values import canonical_values, digest_of_values, what_changed
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.files.source import dotted
from sqrp_cli.files.yaml_edit import edited
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.geometry import look_at, matrix_to_quaternion

CELL = Path(__file__).parents[1] / "cases" / "cell"


@pytest.fixture(scope="module")
def before() -> Workspace:
    return load_workspace(CELL)


@pytest.fixture
def changed(tmp_path: Path) -> Callable[..., Workspace]:
    """The cell with a text of one of its files replaced."""

    def change(file: str, old: str, new: str) -> Workspace:
        cell = Path(shutil.copytree(CELL, tmp_path / "cell"))
        text = (cell / file).read_text(encoding="utf-8")
        assert old in text
        (cell / file).write_text(text.replace(old, new, 1), encoding="utf-8")
        return load_workspace(cell)

    return change


def sentences(before: Workspace, now: Workspace) -> tuple[str, ...]:
    found = what_changed(before.canonical_values, now.canonical_values, now.skills)
    assert bool(found) == (before.digest != now.digest)
    return found


@pytest.mark.parametrize(("name", "digest"), [
        ("tabletop", "46d1c25de0db777a2a69ae6f53b7eb1e18ef1364c656e70f6e2d0aa4972aba21"),
        ("screws", "379bc610e2dd0600aa398d6aa13033328a15af497a14084dc1d1d2f35a22976d"),
        ("tower", "749a8aa2d1027426d60d6001c66a9600052e70ae966a231589202ad343a9bbda"),
])  # fmt: skip
def test_programs_and_baselines_of_before_stay_valid_while_their_cells_do_not_change(name: str, digest: str) -> None:
    workspace = load_workspace(Path(__file__).parents[2] / "workspaces" / name)
    assert digest_of_values(canonical_values(workspace, defaultdict(str))) == digest  # whatever its meshes


AT = "position: [50 cm, 1.2, 0.3]"
SIDE = "quaternion: [0, 0, -0.7071067811865476, 0.7071067811865476]"
DOWN = matrix_to_quaternion(look_at((0.5, 0, 1.5), (0.5, 0, 0))[:3, :3]).tolist()


@pytest.mark.parametrize(("file", "old", "new"), [
        ("workspace.yaml", "# A small cell", "# The small cell"),
        ("workspace.yaml", "near: 10 cm", "near: 0.1"),
        ("workspace.yaml", "rate: 30", "rate: 30.0 Hz"),
        ("workspace.yaml", "{position: [0.5, 1.2, 0.3], rpy: [0, 0, -90 deg]}", f"{{{SIDE}, {AT}}}"),
        ("workspace.yaml", "look_at: [0.5, 0, 0]", f"quaternion: {DOWN}"),
        ("workspace.yaml", "look_at: [0.5, 0, 0]", f"quaternion: {[-part for part in DOWN]}"),
        ("workspace.yaml", "  - hand_empty\n  - on_table(red)\n", "  - on_table( red )\n  - hand_empty\n"),
        ("workspace.yaml", "min_q_eoi: 40 %, ", ""),
        ("arm.urdf", 'upper="2"', 'upper="2.000"'),
        ("arm.urdf", 'xyz="0 0 1"', 'xyz="0.0  0 1e0"'),
        ("arm.urdf", "<link", "\n<!-- why -->\n  <link"),
        ("arm.srdf", "robot>", "robot><!-- why -->"),
        ("side.yaml", "617.20", "617.2"),
        ("side.yaml", "camera_name", "camera_title"),
        ("pickup/skill.yaml", "retreat: 2 cm", "retreat: 20 mm"),
        ("pickup/pickup.pddl", "(:requirements", "; why\n (:requirements"),
])  # fmt: skip
def test_what_has_no_meaning_changes_nothing(before, changed, file, old, new):
    assert sentences(before, changed(file, old, new)) == ()


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


RED = "red moved"
FLOOR = "`shape.size` of part tray/floor"
ABOVE = "`waypoints.above.distance` of skill pickup"
PRECONDITION = "`action.precondition` of skill pickup"


@pytest.mark.parametrize(("file", "old", "new", "says"), [
        ("workspace.yaml", "position: [0.5, 1.2, 0.3]", "position: [0.5, 1.22, 0.3]", "side moved 2.0 cm"),
        ("workspace.yaml", "rpy: [0, 0, -90 deg]", "rpy: [0, 0, -87 deg]", "side turned 3 deg"),
        ("workspace.yaml", "position: [0.4, 0, 2 cm]", "position: [0.404, 0.003, 2 cm]", "red moved 5 mm"),
        ("workspace.yaml", "[0.4, 0, 2 cm]}", "[1.9, 2, 2 cm], rpy: [0.1, 0, 0]}", f"{RED} 2.5 m and turned 5.73 deg"),
        ("workspace.yaml", "base: {position: [0, 0, 0.1]}", "base: {position: [0, 0, 0.05]}", "the robot moved 5.0 cm"),
        ("workspace.yaml", "rate: 30", "rate: 15", "`rate` of side 30 -> 15"),
        ("workspace.yaml", "color: red", "color: blue", "`color` of red red -> blue"),
        ("workspace.yaml", "frame: wrist", "frame: lower", "`frame` of hand wrist -> lower"),
        ("workspace.yaml", "elbow: -20 deg", "elbow: -0.3", "home of joint elbow -0.349066 -> -0.3 rad"),
        ("workspace.yaml", "slide: 5 cm", "slide: 6 cm", "home of joint slide 0.05 -> 0.06 m"),
        ("workspace.yaml", "shoulder: 90 deg/s", "shoulder: 1", "velocity joint limit of shoulder 1.5708 -> 1 rad/s"),
        ("workspace.yaml", "padding: 5 mm", "padding: 6 mm", "`padding` of the cell 0.005 -> 0.006"),
        ("workspace.yaml", "  - on_table(blue)\n", "", "on_table(blue) no longer holds"),
        ("workspace.yaml", "floor, box: [2", "floor, box: [1", f"{FLOOR} [0.2, 0.2, 0.01] -> [0.1, 0.2, 0.01]"),
        ("side.yaml", "617.20", "617.200001", "`matrix` of side is another"),
        ("arm.urdf", 'upper="2"', 'upper="1.9"', "upper joint limit of shoulder 2 -> 1.9 rad"),
        ("cup.urdf", "0.04", "0.05", "`shape.length` of part cup 0.04 -> 0.05"),
        ("pickup/skill.yaml", "retreat: 2 cm", "retreat: 3 cm", f"{ABOVE} 0.02 -> 0.03"),
        ("pickup/pickup.pddl", "and (on_table ?object) (not", "and (not", f"{PRECONDITION} is another"),
])  # fmt: skip
def test_what_has_changed_is_said_in_the_words_of_the_cell(before, changed, file, old, new, says):
    assert sentences(before, changed(file, old, new)) == (says,)


def test_things_that_come_and_go_are_one_change_each(before, changed):
    now = changed("workspace.yaml", "  lost: {type: cube, size: [4 cm, 4 cm, 4 cm], pose: unknown, color: cyan}\n", "")
    assert sentences(before, now) == ("object lost is gone",)
    assert sentences(now, before) == ("object lost is new",)


def test_a_mesh_of_other_content_is_another_mesh(before, changed):
    now = changed("cube.stl", "vertex 0.5 0.5 0.5", "vertex 0.5 0.5 0.6")
    assert sentences(before, now) == ("the mesh of part lower is another", "the mesh of part tray/2 is another")


def test_another_skill_is_no_change_for_those_who_do_not_use_it(before, changed):
    now = changed("pickup/skill.yaml", "retreat: 2 cm", "retreat: 3 cm")
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
    text = edited(document, {dotted(tuple(path.split("."))): f"{more}{unit}"})
    assert sentences(before, load_workspace(CELL, text)) != ()


def test_the_values_are_plain_and_finite(before):
    for values in before.canonical_values.values():
        for value in values.values():
            assert isinstance(value, str | bool | int | float | tuple)
            assert np.isfinite([part for part in np.ravel(value) if isinstance(part, float)]).all()
