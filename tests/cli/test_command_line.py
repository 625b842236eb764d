"""The command line as its neighbours have it: help in words, options anywhere, short flags, places in a ranking."""

from __future__ import annotations

import re
from pathlib import Path

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


def test_the_version_has_a_short_flag(sqrp):
    assert sqrp("-V").out == sqrp("--version").out != ""


def test_quiet_leaves_results_and_errors(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    file.write_text(file.read_text().replace("rate: 10 Hz", "rate: 5 kHz", 1))
    loud, quiet = sqrp("rank", own_watch, "watch green"), sqrp("rank", own_watch, "watch green", "-q")
    assert "warning" in loud.err
    assert (quiet.out, quiet.err) == (loud.out, "")
    assert "there is no skill `wach`" in sqrp("-q", "rank", own_watch, "wach green").err


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


@pytest.mark.parametrize("place", ["0", "3"])
def test_a_place_that_no_candidate_has_is_refused(sqrp, watch, place):
    outcome = sqrp("rank", watch, "watch green", "--choose", place)
    assert (outcome.code, outcome.out) == (2, "")
    assert f"there is no place {place} in a ranking of 2 candidates" in outcome.err


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


def test_a_ranking_that_waits_for_another_skill_says_how_to_find_it(sqrp, tabletop):
    hint = f"To see whether something done first helps:\nsqrp check {tabletop} 'stack g1 g2'\n"
    waiting = sqrp("rank", tabletop, "stack g1 g2")
    assert waiting.code == 1
    assert waiting.out.endswith(hint)
    assert "To see" not in sqrp("rank", tabletop, "pickup g6", "--ways", "fastest").out


def test_a_long_check_shows_the_fastest_of_each_object(sqrp, tabletop):
    task = "pickup green speed=0.5,0.6,0.7,0.8,1 lift=50mm"
    outcome = sqrp("check", tabletop, task)
    found = [one for one in sqrp("check", tabletop, task, "--json").document["candidates"] if one["feasible"]]
    rows = [line.split() for line in outcome.out.splitlines() if re.match(r"g. ", line)]
    assert [row[0] for row in rows] == ["g1", "g2", "g3", "g4", "g5"]
    assert all("speed=1" in row for row in rows)
    assert f"... and {len(found) - 5} more (--json)" in outcome.out.splitlines()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["rank", "TABLETOP"], 'TASK is missing, such as "pickup green"'),
        (["rank", "none"], "TASK is missing: A skill and what to do it with"),
        (["explain", "TABLETOP"], "so a task is missing\n  to mend it: sqrp explain TABLETOP 'pickup green'"),
        (["explain", "README"], "README is no program, so a task is missing\n  to mend it: sqrp explain README TASK"),
        (
            ["rank", "TABLETOP", "pickup", "green", "cube"],
            "found `green cube`, which is more than `sqrp rank` takes; put ",
        ),
        (
            ["rank", "TABLETOP", "pickup", "green", "cube"],
            '; put the task in quotes: `sqrp rank TABLETOP "pickup green cube"`\n',
        ),
        (["audit"], "PROGRAM is missing: A program file"),
        (["run", "pick.yaml", "--sweep"], "[STEP:]slip@PRIMITIVE is missing after --sweep: Many runs"),
    ],
)
def test_what_is_left_out_or_too_much_is_named_with_an_example_of_this_cell(
    sqrp, tabletop, tmp_path, monkeypatch, words, says
):
    monkeypatch.chdir(tmp_path)
    Path("README").write_text("Nothing of a cell.\n")
    outcome = sqrp(*(tabletop if word == "TABLETOP" else word for word in words))
    assert (outcome.code, outcome.out) == (2, "")
    assert says.replace("TABLETOP", str(tabletop)) in outcome.err


def test_a_valid_workspace_proposes_a_task_of_its_own(sqrp, tabletop, own_watch):
    (own_watch / "workspace.yaml").write_text(re.sub(r"(?ms)^tasks:.*", "", (own_watch / "workspace.yaml").read_text()))
    assert sqrp("check", tabletop).out.endswith(f"sqrp rank {tabletop} 'pickup green'\n")
    assert sqrp("check", own_watch).out.endswith(f"sqrp rank {own_watch} watch\n")
