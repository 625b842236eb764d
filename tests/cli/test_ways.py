"""`explain --ways` with and without a value, and the command that it names for a remedy."""

from __future__ import annotations

import json
import shlex
from typing import Any

import pytest

from sqrp_cli import open_cell
from sqrp_cli.show.pages.assembly import tidy
from tests.cells import made_cell, write_cell
from tests.cli.browser import detail_in

CHOSEN = ("--choose", "g1")


def test_the_best_way_alone_is_shown_and_the_fastest_is_explained(sqrp, tabletop):
    best = sqrp("explain", tabletop, "pickup g1", "--samples", 3, "--ways", "best")
    assert best.out == sqrp("explain", tabletop, "pickup g1", "--samples", 3).out
    assert "Pareto-optimal are" not in best.out
    fastest = sqrp("explain", tabletop, "pickup g1", "--ways", "fastest", "--json").document
    (ranked,) = sqrp("rank", tabletop, "pickup g1", "--ways", "fastest", "--json").document["candidates"]
    assert {name: fastest[name] for name in ("time", "q_eoi", "parameters")} == {
        name: ranked[name] for name in ("time", "q_eoi", "parameters")
    }


def test_the_command_that_says_how_much_helps_can_be_typed(sqrp, tabletop):
    """It is about the same candidate, in the same way, and about what is lost."""
    outcome = sqrp("explain", tabletop, "pickup green", *CHOSEN, "--ways", "fastest")
    words = next(shlex.split(line) for line in outcome.out.splitlines() if line.startswith("sqrp advise "))
    assert words[3:] == ["pickup green", *CHOSEN, "--ways", "first"]  # it misses what the workspace states
    advice = sqrp(*words[1:], "--kinds", "way", "--json").document
    assert (advice["candidate"], advice["before"]["q_eoi"]) == ("g1", 0.0)
    for task in ("pickup g1", "pickup object=g1,g6"):  # of the best way the workspace asks no more
        assert "--want 'q_avg 100 %'" in sqrp("explain", tabletop, task, *CHOSEN).out


@pytest.fixture
def walled(tmp_path):
    return made_cell("walled", tmp_path)


def test_the_planner_says_nothing_and_the_seed_decides(sqrp, sqrp_process, walled):
    first, second, other = (
        start("rank", walled, "pickup", "--json", "--samples", 5, "--ways", "fastest", "--seed", seed)
        for start, seed in ((sqrp_process, 0), (sqrp, 0), (sqrp, 3))
    )
    assert first.code == 0
    assert "nanobind" not in first.err
    assert "Info:" not in first.err
    assert first.out == second.out != other.out


def test_a_page_of_scores_shows_the_motions_that_were_scored(sqrp, walled, tmp_path):
    page = tmp_path / "page.html"
    options = ("--samples", 5, "--seed", 3)
    assert sqrp("score", walled, "--report", page, *options).code == 0
    assert (
        detail_in(page)["primitives"]
        == tidy(sqrp("explain", walled, "pickup", "--json", *options).document)["primitives"]
    )


GREEN = "pickup green path=seen"


def blind(candidate: dict[str, Any]) -> float:
    return candidate["t_total"] * (1.0 - candidate["q_avg"])


def test_ends_of_moves_that_no_path_can_help_are_named(tabletop):
    ranking = open_cell(tabletop).rank("pickup g5 path=seen wrist=flip approach_yaw=180deg")
    ends = json.loads(ranking.to_json())["candidates"][0]["ways"]["blind_ends"]
    assert [(end["primitive"], end["at"]) for end in ends] == [("a1", "home"), ("a5", "home")]
    seconds = sum(end["seconds"] for end in ends)
    printed = " ".join(str(ranking).split())
    assert f"No path helps at ends of moves that the cameras do not see: g5 `home` {seconds:.1f} s." in printed


def test_direct_ways_have_no_blind_ends_to_name(sqrp, tabletop):
    outcome = sqrp("rank", tabletop, "pickup g5 elbow=up shoulder=left wrist=flip", "--json")
    assert outcome.document["candidates"][0]["ways"]["blind_ends"] == []


@pytest.mark.trial
def test_within_a_quarter_more_time_the_five_cubes_are_seen_for_92_percent(sqrp, tabletop):
    limit = ("--max-time", "1.25x", "--json")
    seen, direct = (sqrp("rank", tabletop, task, *limit).document for task in (GREEN, "pickup green"))
    found, before = (
        {one["parameters"]["object"]: one for one in document["candidates"] if one["feasible"]}
        for document in (seen, direct)
    )
    assert sum(one["q_avg"] for one in found.values()) / 5 >= 0.92
    assert sum(map(blind, found.values())) <= 0.5 * sum(map(blind, before.values()))
    for name, one in found.items():
        assert (round(one["q_eoi"], 3), one["q_avg"]) >= (round(before[name]["q_eoi"], 3), before[name]["q_avg"] - 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g2", *(pytest.param(n, marks=pytest.mark.trial) for n in ("g1", "g3", "g4", "g5"))])
def test_images_show_99_percent_of_what_seen_paths_promise(sqrp, tabletop_cell, tmp_path, name):
    """Of fewer and smaller images than the cell gives: each of them is compared by itself."""
    program = tmp_path / "program.yaml"
    for camera in tabletop_cell["cameras"].values():
        camera["rate"] = "5 Hz"
        camera["image"].update(width=320, height=240)
    tabletop_cell["detectors"]["color"]["min_pixels"] = 6
    write_cell(tabletop_cell, tmp_path)
    task = f"pickup {name} path=seen"
    assert sqrp("rank", tmp_path, task, "--max-time", "1.25x", "--program", program).code == 0
    outcome = sqrp("run", program, "--sim", "--json")
    assert outcome.code == 0, outcome.err
    (step,) = json.loads(outcome.out)["prediction"]
    counts = [camera for literal in step.values() for camera in literal.values()]
    promised = sum(count["tp"] + count["fp"] for count in counts)
    assert promised > 100
    assert sum(count["tp"] for count in counts) >= 0.99 * promised


@pytest.mark.parametrize("step", ["1e9", "1", "0.3"])
def test_the_bound_holds_where_coverage_changes_at_most_once_between_samples(sqrp, watch, step):
    exact = sqrp("rank", watch, "watch turned", "--json").document["candidates"][0]
    coarse = sqrp("rank", watch, "watch turned", "--dt", step, "--json").document
    error = coarse["sampling"]["error"]
    assert abs(coarse["candidates"][0]["q_avg"] - exact["q_avg"]) <= error + 1.1e-3
