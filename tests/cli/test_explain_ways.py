"""`explain --ways` with and without a value, and the command that it names for a remedy."""

from __future__ import annotations

import shlex

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
    assert words[3:] == ["pickup green", *CHOSEN, "--ways", "fastest"]  # it misses what the workspace states
    advice = sqrp(*words[1:], "--kinds", "way", "--json").document
    assert (advice["candidate"], advice["before"]["q_eoi"]) == ("g1", 0.0)
    for task in ("pickup g1", "pickup object=g1,g6"):  # of the best way the workspace asks no more
        assert "--want 'q_avg 100 %'" in sqrp("explain", tabletop, task, *CHOSEN).out
