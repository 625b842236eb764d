"""The command line as its neighbours have it: help in words, options anywhere, short flags, places in a ranking."""

from __future__ import annotations

import re

import pytest

from sqrp_cli.cli.app import app
from tests.cells import shipped_cell, write_cell

NAMES = [one.name for one in app.registered_commands]


@pytest.mark.parametrize("command", ["", *NAMES])
def test_help_fits_eighty_columns_and_speaks_in_words(sqrp, command):
    out = sqrp(*filter(None, [command]), "--help", columns=80).out
    assert all(len(line) <= 80 for line in out.splitlines())
    assert not re.search(r"<\w|list\[|[{}]", out)


@pytest.mark.parametrize(
    ("command", "usage"),
    [
        ("rank", "WORKSPACE TASK"),
        ("explain", "WORKSPACE [TASK]"),
        ("place", "WORKSPACE [TASK...]"),
        ("score", "PATH..."),
        ("program", "PROGRAM|new [WORKSPACE]"),
        ("run", "[PROGRAM]"),
    ],
)
def test_usage_names_what_may_be_left_out_and_what_may_be_repeated(sqrp, command, usage):
    assert sqrp(command, "-h").out.splitlines()[0] == f"Usage: sqrp {command} [OPTIONS] {usage}"


def test_verbose_says_how_long_each_step_took(sqrp, watch):
    plain, verbose = sqrp("rank", watch, "watch green"), sqrp("rank", watch, "watch green", "--verbose")
    assert (plain.out, plain.err) == (verbose.out, "")
    assert verbose.err.startswith("Assessing watch green: ")
    assert verbose.err.endswith(" s\n")


def test_a_candidate_is_chosen_by_its_place(sqrp, watch, tmp_path):
    file = tmp_path / "program.yaml"
    outcome = sqrp("rank", watch, "watch green", "--choose", "2", "--program", file)
    assert outcome.code == 0
    assert sqrp("program", file, "--json").document["steps"][0]["parameters"]["object"] == "turned"
    assert sqrp("explain", watch, "watch green", "--choose", "2").out.startswith("turned: rank 2")


def test_a_long_ranking_shows_the_best_of_each_object_and_those_that_are_named_unless_all_are_asked_for(sqrp, tabletop):
    task = "pickup g2 speed=0.5,0.6,0.7,0.8,0.9,1 lift=50mm,60mm,70mm,80mm"
    short = sqrp("rank", tabletop, task, "--ways", "fastest").out
    whole = sqrp("rank", tabletop, task, "--ways", "fastest", "--all").out
    assert "... and 21 more (--all)" in short.splitlines()
    assert [line.split()[0] for line in whole.splitlines() if re.match(r"\d+ ", line)] == [str(n) for n in range(1, 25)]
    assert [line for line in short.splitlines() if re.match(r"\d+ ", line)] == [
        line for line in whole.splitlines() if re.match(r"(1|2|24) ", line)
    ]


def test_a_reason_that_many_share_is_said_once(sqrp, tmp_path):
    """g6 and b1 are out of reach, each in a way of its own."""
    cell, folder = shipped_cell("tabletop"), tmp_path / "tabletop"
    for can in ("r1", "r2"):
        del cell["objects"][can]
        cell["state"].remove(f"obj_on_table({can})")
    folder.mkdir()
    write_cell(cell, folder)
    lines = sqrp("check", folder, "stack g1").out.splitlines()
    plan = next(number for number, line in enumerate(lines) if line.startswith("It can be done in these steps"))
    reasons = [number for number, line in enumerate(lines) if line.startswith("infeasible")]
    assert lines[0] == "stack g1 in tabletop: 0 of 6 candidates can be done at once"
    assert plan < reasons[0]
    assert len(reasons) == 3
    assert any(" and 1 more: " in lines[number] for number in reasons)


def test_a_reason_that_candidates_share_names_the_object_of_none(sqrp, tmp_path):
    cell = shipped_cell("tabletop")
    cell["state"] = ["hand_empty"]
    write_cell(cell, tmp_path)
    lines = sqrp("check", tmp_path, "pickup green").out.splitlines()
    assert [line for line in lines if line.startswith("infeasible")] == [
        "infeasible g1, g2, g3 and 3 more: `pickup` needs `obj_on_table(<object>)`,"
    ]
