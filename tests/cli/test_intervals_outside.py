"""What is said about intervals of formulas that lie outside the motion, in a cell whose motion lasts 4 s."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Outcome

WARNING = "nothing of the interval"


def _with_formula(cell: Path, old: str, new: str) -> Path:
    path = cell / "watch" / "skill.yaml"
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return cell


@pytest.mark.parametrize("command", ["check", "rank", "explain", "score"])
def test_a_fault_after_the_end_of_the_motion_is_told_once_for_all_candidates(
    sqrp: Callable[..., Outcome], own_watch: Path, command: str
) -> None:
    _with_formula(own_watch, "[w2.start + 1, w2.end]", "[100, 200]")
    told = sqrp(command, own_watch, *([] if command == "score" else ["watch green"]))
    assert told.code == 0
    assert told.err.count(WARNING) == 1
    assert (
        f"{own_watch / 'watch' / 'skill.yaml'}:14:25: skill `watch`: {WARNING} [100, 200] of fault `moved`" in told.err
    )
    assert "never looked at: the motion lasts 4.00 s\n" in told.err
    assert "such as `[w0.start, w3.end]`" in told.err
    assert WARNING not in told.out


@pytest.mark.parametrize(
    ("interval", "told"),
    [
        ("[w1.start, 9999]", False),  # clipped
        ("[w3.end, w3.end + 5]", False),  # an instant is left
        ("[w3.end + 1, w3.end + 5]", True),
        ("[w2.start + 3.5, w3.end + 5]", True),
        ("[w0.start - 2, w0.start - 1]", True),
    ],
)
def test_only_intervals_of_which_nothing_is_left_are_told(
    sqrp: Callable[..., Outcome], own_watch: Path, interval: str, told: bool
) -> None:
    _with_formula(own_watch, "[w1.start, w1.end]", interval)
    assert (WARNING in sqrp("rank", own_watch, "watch green", "--json").err) == told


def test_those_of_which_some_candidates_leave_something_say_of_how_many_they_do_not(
    sqrp: Callable[..., Outcome], own_watch: Path
) -> None:
    _with_formula(own_watch, "wait: 2 s", "wait: $longer")
    _with_formula(own_watch, "primitives:", "motion:\n  longer: {values: [2 s, 20 s]}\n\nprimitives:")
    _with_formula(own_watch, "[w1.start, w1.end]", "[10, 11]")
    assert "the motion of 2 of 4 candidates lasts 4.00 s\n" in sqrp("rank", own_watch, "watch green").err


def test_what_check_says_is_among_the_problems_of_its_document(sqrp: Callable[..., Outcome], own_watch: Path) -> None:
    _with_formula(own_watch, "[w2.start + 1, w2.end]", "[100, 200]")
    (problem,) = [
        problem
        for problem in sqrp("check", own_watch, "watch green", "--json").document["problems"]
        if problem["code"] == "interval-outside-the-motion"
    ]
    assert (problem["severity"], problem["line"], problem["column"]) == ("warning", 14, 25)
