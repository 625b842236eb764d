"""The best way, against all ways of a candidate given one by one, as a person would."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli import new_cell, open_cell
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.errors import InputError
from sqrp_cli.program.file import load_program
from sqrp_cli.study.program_update import replanned
from sqrp_cli.study.result import CandidateResult
from tests.conftest import TABLETOP
from tests.trials.ways import SLOW_LIFT, YAWS, compared, stated, undominated


@pytest.fixture(scope="module")
def cell() -> OpenCell:
    return open_cell(TABLETOP)


def only(cell: OpenCell, task: str, **options: str) -> CandidateResult:
    (found,) = cell.rank(task, **options).candidates  # type: ignore[arg-type]
    return found


@pytest.fixture(
    scope="module", params=["g4", *(pytest.param(name, marks=pytest.mark.trial) for name in ("g1", "g2", "g3", "g5"))]
)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def one_by_one(cell: OpenCell, name: str) -> list[CandidateResult]:
    """Every way that can be done, with all settings stated in the task."""
    return stated(cell, f"pickup {name} via=direct", YAWS)


def test_the_best_way_is_the_best_of_all_by_hand(cell: OpenCell, name: str, one_by_one: list[CandidateResult]) -> None:
    best = only(cell, f"pickup {name}")
    assert best.ways is not None
    assert (best.ways.tried, best.ways.feasible) == (32, len(one_by_one))
    figures = sorted(map(compared, one_by_one))
    assert compared(best) == figures[0]
    assert sorted(map(compared, best.ways.pareto)) == undominated(figures)
    by_hand = {tuple(sorted(way.parameters.items())): way for way in one_by_one}
    for way in best.ways.pareto:
        same = by_hand[tuple(sorted(way.parameters.items()))]
        assert (way.q_eoi, way.q_avg, way.time) == pytest.approx((same.q_eoi, same.q_avg, same.time), abs=1e-9)


@pytest.fixture(scope="module")
def slow_lift() -> OpenCell:
    """A cell in which cameras see part of a lift only, more of it at a yaw of 180 degrees than at 0."""
    return open_cell(SLOW_LIFT)


def test_a_way_that_is_seen_for_a_moment_is_the_best_where_the_others_are_seen_for_less(slow_lift: OpenCell) -> None:
    by_hand = {yaw: only(slow_lift, f"pick part approach_yaw={yaw}deg") for yaw in (180, 0)}
    assert by_hand[180].q_eoi > 3 * by_hand[0].q_eoi > 0.0
    best = only(slow_lift, "pick part")
    assert best.ways is not None
    assert compared(best) == compared(by_hand[180])
    assert [compared(way) for way in best.ways.pareto] == [compared(by_hand[yaw]) for yaw in (180, 0)]


def test_advice_finds_the_only_way_that_meets_a_wish(slow_lift: OpenCell) -> None:
    (found,) = slow_lift.advise("pick part", want="q_eoi 15 %", kinds=["way"]).advice
    by_hand = [only(slow_lift, f"pick part approach_yaw={yaw}deg").q_eoi for yaw in (180, 0)]
    assert by_hand[1] < 0.15 < by_hand[0]
    assert (found.kind, found.q_eoi) == ("way", pytest.approx(by_hand[0], abs=1e-3))


def test_by_time_the_fastest_way_is_the_best_and_a_limit_leaves_the_best_of_the_ways_that_keep_it(
    cell: OpenCell, name: str, one_by_one: list[CandidateResult]
) -> None:
    fastest = min(way.time for way in one_by_one)
    assert only(cell, f"pickup {name}", by="time").time == pytest.approx(fastest, abs=1e-6)
    kept = [way for way in one_by_one if way.time <= 1.25 * fastest]
    found = only(cell, f"pickup {name}", max_time="1.25x")
    assert found.ways is not None
    assert (found.ways.feasible, compared(found)) == (len(kept), min(map(compared, kept)))


def test_a_limit_that_no_way_keeps_makes_a_candidate_infeasible_with_the_excess(cell: OpenCell) -> None:
    found, least = only(cell, "pickup g2", max_time="9 s"), only(cell, "pickup g2", by="time").time
    reason = f"its fastest way takes {least:.2f} s, {least - 9:.2f} s more than allowed"
    assert (found.feasible, found.reasons) == (False, (reason,))
    assert found.ways is not None
    assert (found.ways.tried, found.ways.feasible, found.ways.pareto) == (32, 0, ())
    # With `--ways first` one way is looked at, and other ways are not meant.
    fastest = only(cell, "pickup g3", ways="first")
    assert fastest.ways is not None
    assert (fastest.ways.tried, fastest.ways.feasible, fastest.parameters["approach_yaw"]) == (1, 1, 0.0)
    (reason,) = only(cell, "pickup g3", max_time="10 s", ways="first").reasons
    assert reason.startswith(f"its way with `--ways first` takes {fastest.time:.2f} s, {fastest.time - 10:.2f} s more")
    assert only(cell, "pickup g3", max_time="10 s").feasible


@pytest.mark.parametrize("limit", ["0.5x", "fast", "0 s", "10 m", "nanx", "infx"])
def test_a_limit_that_means_nothing_is_refused(cell: OpenCell, limit: str) -> None:
    with pytest.raises(InputError, match="expected a time"):
        cell.rank("pickup g2", max_time=limit)


def test_a_program_has_every_setting_of_the_chosen_way_and_its_figures(cell: OpenCell, tmp_path: Path) -> None:
    ranking = cell.rank("pickup g2")
    best = ranking.best
    assert best is not None
    assert best.ways is not None
    ranking.write(tmp_path / "pick.yaml")
    (step,) = load_program(tmp_path / "pick.yaml").steps
    assert step.parameters == best.ways.pareto[0].parameters
    assert "any" not in step.parameters.values()
    assert (step.q_eoi, step.q_avg, step.time) == pytest.approx((best.q_eoi, best.q_avg, best.time), abs=1e-9)


BRANCH = "elbow=up shoulder=left wrist=flip"


@pytest.mark.parametrize(
    ("settings", "tried"),
    [(f"approach_yaw=90deg {BRANCH}", 1), (f"approach_yaw=90deg {BRANCH.replace(' wrist=flip', '')}", 2),
     ("approach_yaw=90deg elbow=fastest shoulder=fastest wrist=fastest", 1), ("approach_yaw=90deg", 8), (BRANCH, 4)],
)  # fmt: skip
def test_what_a_task_states_is_not_tried(cell: OpenCell, settings: str, tried: int) -> None:
    assert only(cell, f"pickup g2 {settings}", ways="best").ways.tried == tried  # type: ignore[union-attr]


def test_a_retry_takes_another_branch_where_that_of_the_program_is_blocked(cell: OpenCell, tmp_path: Path) -> None:
    cell.rank("pickup g2").write(tmp_path / "pick.yaml")
    (step,) = load_program(tmp_path / "pick.yaml").steps
    below_the_table = step.model_copy(update={"parameters": {**step.parameters, "elbow": "down"}})
    again = replanned(cell.cell, below_the_table, step.before)
    assert again is not None
    assert again.primitives[-1].trajectory.path.end == pytest.approx(step.primitives[-1].trajectory.path.end)


def test_ways_without_words_are_stated_by_the_numbers_of_their_solutions(tmp_path: Path) -> None:
    """In a cell whose arm of seven axes has no words for its branches."""
    arm = "package://example-robot-data/robots/panda_description/urdf/panda.urdf"
    seven_axes = open_cell(new_cell(tmp_path / "panda", urdf=arm).path)
    best = only(seven_axes, "pickup g2")
    assert best.ways is not None
    number = best.ways.pareto[0].parameters["a1.solution"]
    stated = f"pickup g2 approach_yaw={best.ways.pareto[0].parameters['approach_yaw']} a1.solution={number:.0f}"
    for ways in ("best", "fastest"):
        same = only(seven_axes, stated, ways=ways)
        assert same.ways is not None
        assert (same.time, same.q_avg, same.ways.tried) == (best.time, best.q_avg, 1)
        wrong = only(seven_axes, "pickup g2 a1.solution=999", ways=ways)
        assert wrong.reasons == ("no way of its arm is called a1.solution=999",)
    with pytest.raises(InputError, match="expected the number of a solution"):
        seven_axes.rank("pickup g2 a1.solution=first")
