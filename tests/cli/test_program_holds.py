"""A program holds while nothing that matters changes in its workspace; else it says what has changed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.program.file import load_program, save_program
from tests.cells import edit


@pytest.fixture(scope="module")
def made(sqrp, watch, tmp_path_factory):
    """A folder with a copy of the cell, and a program for it."""
    folder = tmp_path_factory.mktemp("holds")
    shutil.copytree(watch, folder / "watch")
    assert sqrp("rank", folder / "watch", "watch seen", "--program", folder / "program.yaml").code == 0
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "own"))


def test_what_a_program_keeps_of_its_workspace_is_believed_only_as_it_was_written(sqrp, folder):
    edit(folder / "watch", "near: 50 cm", "near: 51 cm")
    edit(folder / "program.yaml", "near: 0.5", "near: 0.51")
    assert sqrp("program", folder / "program.yaml", "--json").document["stale"] is True


@pytest.fixture
def earlier(folder):
    """The program as versions wrote it that knew a workspace by the bytes of its files."""
    path = folder / "program.yaml"
    known = load_workspace(folder / "watch").file_digest
    save_program(load_program(path).model_copy(update={"digest": known, "made_for": {}}), path)
    assert "made_for" not in yaml.safe_load(path.read_text(encoding="utf-8"))
    return path


def test_a_program_of_an_earlier_version_holds_until_a_byte_changes(sqrp, folder, earlier):
    assert sqrp("program", earlier, "--json").document["stale"] is False
    edit(folder / "watch", "detectors:", "# what sees\ndetectors:")
    outcome = sqrp("program", earlier, "--json", columns=500)
    assert outcome.document["stale"] is True
    assert "an earlier version wrote it" in outcome.err


def test_a_program_of_an_earlier_version_can_be_continued(sqrp, folder, earlier):
    assert sqrp("rank", folder / "watch", "watch turned", "--program", earlier).code == 0
    assert load_program(earlier).made_for["camera eye"]["near"] == 0.5


def test_a_program_holds_when_the_order_of_keys_changes(sqrp, folder):
    file = folder / "watch" / "workspace.yaml"
    parts = file.read_text(encoding="utf-8").split("\n\n")
    file.write_text("\n\n".join([parts[0], *reversed(parts[1:])]), encoding="utf-8")
    outcome = sqrp("program", folder / "program.yaml", "--json")
    assert (outcome.code, outcome.err, outcome.document["stale"]) == (0, "", False)


@pytest.fixture
def program(sqrp, own_watch, tmp_path):
    """A program for the cell `watch`."""
    path = tmp_path / "watched.yaml"
    assert sqrp("rank", own_watch, "watch seen", "--program", path).code == 0
    return path


@pytest.mark.parametrize("command", [["check"], ["rank"], ["explain"], ["advise", "--want", "q_avg 1 %"]])
def test_a_program_in_place_of_a_workspace_starts_where_it_ends(sqrp, own_watch, program, command):
    name, *options = command
    told = sqrp(name, program, "watch turned", *options, "--jobs", 1, "--json")
    assert told.out == sqrp(name, own_watch, "watch turned", "--after", program, *options, "--jobs", 1, "--json").out
    assert told.code in (0, 1)
    assert told.document["task"] == "watch turned"


def test_a_shell_proposes_tasks_after_a_program(program):
    from types import SimpleNamespace

    from sqrp_cli.cli.completion import tasks

    assert "watch seen" in tasks(SimpleNamespace(params={"workspace": program}), "watch s")


@pytest.mark.parametrize("command", ["program", "run", "audit", "explain", "rank", "check", "advise"])
def test_help_calls_it_by_one_word(sqrp, command):
    text = sqrp(command, "--help").out
    assert "PROGRAM" in text
    assert "--program FILE" not in text
