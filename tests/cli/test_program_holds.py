"""A program holds while nothing that matters changes in its workspace; else it says what has changed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.program.file import load_program, save_program


@pytest.fixture(scope="module")
def made(sqrp, watch, tmp_path_factory) -> Path:
    """A folder with a copy of the cell, and a program for it."""
    folder = tmp_path_factory.mktemp("holds")
    shutil.copytree(watch, folder / "watch")
    assert sqrp("rank", folder / "watch", "watch seen", "--program", folder / "program.yaml").code == 0
    return folder


@pytest.fixture
def folder(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "own"))


def replaced(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def reordered(cell: Path) -> None:
    text = (cell / "workspace.yaml").read_text(encoding="utf-8")
    parts = text.split("\n\n")
    (cell / "workspace.yaml").write_text("\n\n".join([parts[0], *reversed(parts[1:])]), encoding="utf-8")


HARMLESS: dict[str, Callable[[Path], object]] = {
    "nothing": str,
    "a comment": lambda cell: replaced(cell / "workspace.yaml", "detectors:", "# what sees\ndetectors:"),
    "the order of keys": reordered,
    "a unit": lambda cell: replaced(cell / "workspace.yaml", "near: 50 cm", "near: 0.5"),
    "a threshold": lambda cell: replaced(cell / "workspace.yaml", "tasks:", "tasks:\n  - {task: watch turned}"),
    "the layout of the URDF": lambda cell: replaced(cell / "arm.urdf", "<link", "\n\n  <link"),
    "the folder's name": lambda cell: cell.rename(cell.with_name("renamed")),
}


@pytest.mark.parametrize("what", HARMLESS)
def test_a_program_holds_when_this_changes(sqrp, folder, what):
    HARMLESS[what](folder / "watch")
    outcome = sqrp("program", folder / "program.yaml", "--json")
    assert (outcome.code, outcome.err, outcome.document["stale"]) == (0, "", False)


def test_a_program_can_be_continued_in_a_renamed_folder_which_it_then_names(sqrp, folder):
    cell = (folder / "watch").rename(folder / "renamed")
    assert sqrp("rank", cell, "watch turned", "--program", folder / "program.yaml").code == 0
    program = load_program(folder / "program.yaml")
    assert (program.workspace, len(program.steps)) == ("renamed/workspace.yaml", 2)


def test_a_program_that_was_moved_alone_says_where_it_looks_for_its_workspace(sqrp, folder):
    (folder / "else").mkdir()
    moved = (folder / "program.yaml").rename(folder / "else" / "program.yaml")
    outcome = sqrp("run", moved, "--sim", columns=500)
    assert outcome.code == 2
    assert f"{moved}:4:12: `workspace`: there is no workspace {folder / 'else' / 'watch'}" in outcome.err
    assert "enter under `workspace` where its workspace is now" in outcome.err


def test_of_two_places_where_a_program_would_hold_none_is_guessed(sqrp, folder):
    shutil.copytree(folder / "watch", folder / "copy")
    (folder / "watch").rename(folder / "renamed")
    outcome = sqrp("program", folder / "program.yaml")
    assert "its workspace cannot be read" in " ".join(outcome.err.split())


def test_a_stale_program_says_what_has_changed_and_how_to_make_it_again(sqrp, folder):
    file = folder / "watch" / "workspace.yaml"
    replaced(file, "position: [0, 0, 1], look_at: [1, 0, 1]", "position: [0.02, 0, 1], look_at: [1.02, 0, 1]")
    replaced(folder / "watch" / "arm.urdf", 'upper="3" velocity="1"', 'upper="2.9" velocity="1"')
    outcome = sqrp("rank", folder / "watch", "watch turned", "--after", folder / "program.yaml", columns=500)
    assert outcome.code == 2
    assert "upper joint limit of turn 3 -> 2.9 rad; eye moved 2.0 cm" in outcome.err
    assert f"rm {folder}/program.yaml && sqrp rank {folder}/watch 'watch seen'" in outcome.err
    replaced(file, "size: [10 cm", "size: [9 cm")
    outcome = sqrp("program", folder / "program.yaml", columns=500)
    assert "`size` of seen [0.1, 0.1, 0.1] -> [0.09, 0.1, 0.1]; " in outcome.err
    assert "more changes" in outcome.err


def test_what_a_program_keeps_of_its_workspace_is_believed_only_as_it_was_written(sqrp, folder):
    replaced(folder / "watch" / "workspace.yaml", "near: 50 cm", "near: 51 cm")
    replaced(folder / "program.yaml", "near: 0.5", "near: 0.51")
    assert sqrp("program", folder / "program.yaml", "--json").document["stale"] is True


@pytest.fixture
def earlier(folder) -> Path:
    """The program as versions wrote it that knew a workspace by the bytes of its files."""
    path = folder / "program.yaml"
    known = load_workspace(folder / "watch").file_digest
    save_program(load_program(path).model_copy(update={"digest": known, "made_for": {}}), path)
    assert "made_for" not in yaml.safe_load(path.read_text(encoding="utf-8"))
    return path


def test_a_program_of_an_earlier_version_holds_until_a_byte_changes(sqrp, folder, earlier):
    assert sqrp("program", earlier, "--json").document["stale"] is False
    replaced(folder / "watch" / "workspace.yaml", "detectors:", "# what sees\ndetectors:")
    outcome = sqrp("program", earlier, "--json", columns=500)
    assert outcome.document["stale"] is True
    assert "an earlier version wrote it" in outcome.err


def test_a_program_of_an_earlier_version_can_be_continued(sqrp, folder, earlier):
    assert sqrp("rank", folder / "watch", "watch turned", "--program", earlier).code == 0
    assert load_program(earlier).made_for["camera eye"]["near"] == 0.5
