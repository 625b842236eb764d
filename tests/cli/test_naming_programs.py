"""A program is named by its file in every command; where a workspace is expected, it stands for what it leaves."""

from __future__ import annotations

import pytest


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
