"""Expectations of listed tasks that cannot be met, whatever the motions are."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.listed_tasks import impossible_tasks

FILE = Path(__file__).parents[2] / "workspaces" / "tabletop" / "workspace.yaml"
LISTED = "  - {task: pickup green, min_q_eoi: 0.5}"


@pytest.mark.parametrize(
    ("entry", "code", "at", "says"),
    [
        (
            "winner: crate",
            "impossible-winner",
            "winner",
            "`tasks.0.winner`: no candidate of `pickup green` uses `crate`",
        ),
        ("winner: r1", "impossible-winner", "winner", "did you mean `g1`?"),
        ("feasible: false, min_q_eoi: 0.5", "contradictory-expectations", "min_q_eoi", "`min_q_eoi` expected of"),
        (
            "max_time: 3, feasible: false, winner: g1",
            "contradictory-expectations",
            "max_time",
            "`max_time`, `winner` expected of",
        ),
    ],
)
def test_an_expectation_that_cannot_be_met_is_told_where_it_stands(entry: str, code: str, at: str, says: str) -> None:
    line = f"  - {{task: pickup green, {entry}}}"
    text = FILE.read_text(encoding="utf-8").replace(LISTED, line)
    (problem,) = impossible_tasks(load_workspace(FILE, text.encode()))
    assert (problem.code, problem.severity) == (code, "warning")
    assert says in problem.message
    assert problem.mend
    number = text.splitlines().index(line) + 1
    assert str(problem.place) == f"{FILE}:{number}:{line.index(at) + 1}"


@pytest.mark.parametrize("entry", ["pickup green, feasible: false", "pickup green, winner: g2", "pickup red can"])
def test_other_expectations_are_left_alone(entry: str) -> None:
    text = FILE.read_text(encoding="utf-8").replace(LISTED, f"  - {{task: {entry}}}")
    assert list(impossible_tasks(load_workspace(FILE, text.encode()))) == []
