"""`rank --json`: fields, order and the Pareto-optimal candidates, from the document alone."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any

import pytest

from tests.cells import write_cell

Document = dict[str, Any]

CRITERIA = ("q_eoi", "q_avg", "time", "delay", "expected_time")
METRICS = ("time", "q_avg", "q_eoi", "t_total", "t_eoi", "states")
FAULT_FIGURES = {"delay_mean", "delay_worst", "blind_longest", "unseen", "expected_time", "why"}


def feasible(document: Document) -> list[Document]:
    return [candidate for candidate in document["candidates"] if candidate["feasible"]]


def points(quality: float) -> int:
    """A quality as it is compared: in tenths of a point."""
    return round(quality * 1000)


def worst(candidate: Document, figure: str) -> float:
    faults = candidate["faults"].values()
    return math.inf if any(fault["unseen"] > 0.0 for fault in faults) else max(fault[figure] for fault in faults)


def order(candidate: Document, by: str) -> tuple[Any, ...]:
    """What the ranking sorts by; less is better."""
    first = {
        "q_eoi": -points(candidate["q_eoi"]),
        "q_avg": -points(candidate["q_avg"]),
        "time": candidate["time"],
        "delay": worst(candidate, "delay_mean"),
        "expected_time": worst(candidate, "expected_time"),
    }[by]
    parameters = [value if isinstance(value, str) else (value,) for value in candidate["parameters"].values()]
    return (first, -points(candidate["q_avg"]), candidate["time"], worst(candidate, "delay_worst"), parameters)


def dominates(first: Document, second: Document) -> bool:
    better = [
        points(first["q_avg"]) - points(second["q_avg"]),
        points(first["q_eoi"]) - points(second["q_eoi"]),
        second["time"] - first["time"],
    ]
    return min(better) >= 0 and max(better) > 0


@pytest.fixture(scope="module")
def watch_ranked(sqrp, watch):
    return sqrp("rank", watch, "watch cube", "--json").document


def missing_reach(candidate: Document) -> float | None:
    """By how much [m] a candidate is said to be too far, None where it is not for that."""
    figure = re.search(r"(\d+(?:\.\d+)?) m\b", candidate["reasons"][0] if candidate["reasons"] else "")
    return float(figure[1]) if figure and "out of reach" in candidate["reasons"][0] else None


def test_the_reason_of_g6_says_by_how_much_it_is_out_of_reach_and_moving_it_by_less_does_not_help(
    ranked, sqrp, tabletop_cell, tmp_path
):
    # The reason of g6 says by how much it is out of reach.
    figure = missing_reach(ranked.document["candidates"][-1])
    assert figure is not None
    assert figure > 0.0
    # Moving an object by less than it is too far does not help.
    x, y, z = tabletop_cell["objects"]["g6"]["pose"]["position"]
    away = math.hypot(x, y)
    closer = 0.9 * (figure - 0.005)  # the figure is rounded
    tabletop_cell["objects"]["g6"]["pose"]["position"] = [x - closer * x / away, y - closer * y / away, z]
    write_cell(tabletop_cell, tmp_path)
    (g6,) = sqrp("check", tmp_path, "pickup g6", "--json").document["candidates"]
    assert 0.0 <= missing_reach(g6) < figure


def test_feasible_candidates_have_every_metric_and_others_reasons(ranked, watch_ranked):
    # Feasible candidates have every metric.
    for candidate in feasible(ranked.document):
        assert candidate["reasons"] == []
        assert candidate["verdict"]
        assert type(candidate["rank"]) is int
        assert type(candidate["states"]) is int
        assert candidate["states"] > 0
        assert 0.0 <= candidate["q_avg"] <= 1.0
        assert 0.0 <= candidate["q_eoi"] <= 1.0
        assert 0.0 < candidate["t_eoi"] <= candidate["t_total"] <= candidate["time"]
        for figures in candidate["faults"].values():
            assert set(figures) == FAULT_FIGURES
            assert 0.0 <= figures["unseen"] <= 1.0
            assert 0.0 <= figures["blind_longest"] <= candidate["t_eoi"] + 1e-9
            never = figures["unseen"] > 0.0
            assert never == (figures["delay_worst"] is None) == (figures["expected_time"] is None)
            if not never:
                assert 0.0 <= figures["delay_mean"] <= figures["delay_worst"]
                assert figures["expected_time"] >= candidate["time"]
    # Infeasible candidates have reasons and no metrics.
    infeasible = [c for d in (ranked.document, watch_ranked) for c in d["candidates"] if not c["feasible"]]
    assert len(infeasible) == 2
    for candidate in infeasible:
        assert candidate["reasons"]
        assert candidate["rank"] is None
        assert candidate["pareto"] is False
        assert all(candidate[metric] is None for metric in METRICS)
        assert candidate["faults"] in ({}, None)


@pytest.mark.parametrize("by", CRITERIA)
def test_ranking_follows_the_criterion_and_its_ties(sqrp, harsh, by):
    document = sqrp("rank", harsh, "pickup green", "--json", "--samples", 10, "--by", by, "--ways", "fastest").document
    assert document["by"] == by
    candidates = feasible(document)
    assert len(candidates) > 2
    assert [candidate["rank"] for candidate in candidates] == list(range(1, len(candidates) + 1))
    assert all(order(first, by) < order(then, by) for first, then in pairwise(candidates))
    assert document["candidates"][: len(candidates)] == candidates


@pytest.mark.parametrize("by", CRITERIA)
def test_equal_candidates_are_ordered_by_their_parameters(sqrp, watch, by):
    candidates = feasible(sqrp("rank", watch, "watch cube", "--json", "--by", by).document)
    names = [candidate["parameters"]["object"] for candidate in candidates]
    assert names == ["seen", "turned", *sorted(set(names) - {"seen", "turned"})]


def test_pareto_candidates_are_those_that_no_other_dominates(ranked, watch_ranked):
    for document in (ranked.document, watch_ranked):
        candidates = feasible(document)
        for candidate in candidates:
            assert candidate["pareto"] is not any(dominates(other, candidate) for other in candidates)
        assert any(candidate["pareto"] for candidate in candidates)
