"""Tasks of several steps are scored and compared as a whole, with what cameras no longer see in which step."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from sqrp_cli.score.comparison import compare_versions
from sqrp_cli.score.compute import Means, open_computer
from sqrp_cli.score.kept import Outcome
from sqrp_cli.score.result import Scorecard
from sqrp_cli.score.score import ScoredCell, read_cell
from sqrp_cli.study.blind_spans import difference
from sqrp_cli.study.sampling import Adaptive
from tests.score.test_coverage import union_length

CELL = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"


def narrow(degrees: int) -> ScoredCell:
    """The cell of pegs with one camera, which looks past the middle."""
    text = CELL.read_text(encoding="utf-8").split("\n  front:")
    cameras = text[1].split("\n  left:")[1].replace("0.4, 0, 0.1]}", "0.3, 0.1, 0.1]}")
    changed = f"{text[0]}\n  left:{cameras}".replace("36 deg", f"{degrees} deg")
    return read_cell(CELL, "peg", changed.split("  - {task: insert")[0].encode())


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    first = narrow(24).wanted[0]
    with open_computer(Means(Adaptive())) as computer:
        computer.compute([first], lambda _: None)
        best = computer.outcome(first)
        way = replace(first, candidate=best.assessment.way, coverage=True)
        computer.compute([way], lambda _: None)
        found = computer.outcome(way)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def compared() -> Scorecard:
    with open_computer(Means(Adaptive())) as computer:
        return compare_versions(narrow(24), narrow(16), computer, 1.0, lambda *_: nullcontext(lambda _: None))


def test_the_time_in_which_every_literal_of_every_step_is_covered_is_q_avg(outcome: Outcome) -> None:
    targets = outcome.coverage.targets.values()
    length = union_length(stretch for target in targets for stretch in target.required)
    lost = [stretch for target in targets for stretch in difference(target.required, target.covered)]
    quality = outcome.assessment.q_avg
    assert length == pytest.approx(outcome.assessment.t_total, abs=2e-3 * len(targets))
    assert 1 - union_length(lost) / length == pytest.approx(quality, abs=4e-3)
    assert max(outcome.coverage.primitives.values()) == pytest.approx(outcome.assessment.time, abs=1e-3)


def test_kept_results_have_the_figures_of_each_step(outcome: Outcome) -> None:
    again = Outcome.from_text(outcome.to_text(), outcome.assessment.candidate)
    assert [step.q_avg for step in again.assessment.steps] == [step.q_avg for step in outcome.assessment.steps]
    assert [step.candidate.task for step in again.assessment.steps] == ["pickup peg1", "insert peg1 socket"]
    assert again.to_text() == outcome.to_text()


def test_what_a_narrower_camera_no_longer_sees_is_said_with_the_step(compared: Scorecard) -> None:
    (result,) = compared.results
    change = next(one for one in result.baseline.ways if one.way == "peg2 then peg2 socket")
    losses = {(loss.literal, loss.camera): loss for loss in change.lost}
    assert ("2.inserted(peg2)", "left") in losses
    assert {"1.hold(peg2)", "2.hold(peg2)"} <= {literal for literal, _ in losses}
    best = change.lost[0]
    first = result.ways[change.way].steps[0].time
    assert best.start > first
