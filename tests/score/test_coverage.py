"""Who sees what when, in tasks of several steps, too, against qualities of the same samples; sets of stretches."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.logic.formula_time import TimeInterval, merge
from sqrp_cli.motion.cell import Cell
from sqrp_cli.score.comparison import compare_versions
from sqrp_cli.score.compute import Means, open_computer
from sqrp_cli.score.kept import Outcome
from sqrp_cli.score.score import ScoredCell, read_cell
from sqrp_cli.study.analysis import analyse
from sqrp_cli.study.blind_spans import coverage_of, difference, intersection
from sqrp_cli.study.sampling import Adaptive, FixedCount
from sqrp_cli.task.task import read_task


def union_length(stretches):
    return sum(one.length for one in merge(stretches))


ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell.load(load_workspace(ROOT / "workspaces" / "tabletop"))


@pytest.fixture(scope="module", params=["g1", "g4"])
def found(cell, request):
    (candidate,) = read_task(f"pickup {request.param}", cell.workspace).candidates
    return analyse(cell, candidate, cell.initial_world, Adaptive(), full=True)


def test_the_time_in_which_every_literal_is_covered_is_q_avg(cell, found):
    targets = coverage_of(cell, found).targets.values()
    monitored = [stretch for target in targets for stretch in target.required]
    lost = [stretch for target in targets for stretch in difference(target.required, target.covered)]
    length = union_length(monitored)
    quality = found.timeline.qualities.q_avg
    assert 1 - union_length(lost) / length == pytest.approx(quality, abs=2 * found.timeline.transition_error + 1e-6)


def test_causes_fill_exactly_the_time_in_which_a_camera_does_not_see(cell, found):
    for target in coverage_of(cell, found).targets.values():
        for camera, spans in target.blind.items():
            blind = [stretch for stretch, _ in spans]
            assert all(a.end <= b.start + 1e-9 for a, b in pairwise(blind))
            assert not intersection(target.seen_by(camera), blind)


def test_a_damaged_record_is_refused(found):
    text = Outcome(found.result, None).to_text()
    for damaged in (text[:40], "{}", "[]", text.replace('"slip"', '"slip": 3, "x"')):
        with pytest.raises(ValueError):  # noqa: PT011 - of several readers
            Outcome.from_text(damaged, found.planned.candidate)


def test_a_coarse_sampling_counts_what_it_cannot_tell_as_not_seen(cell):
    (candidate,) = read_task("pickup g1", cell.workspace).candidates
    fine, coarse = (
        coverage_of(cell, analyse(cell, candidate, cell.initial_world, sampling, full=True))
        for sampling in (Adaptive(), FixedCount(5))
    )
    for atom, target in coarse.targets.items():
        assert union_length(target.required) == pytest.approx(union_length(fine.targets[atom].required))
        assert union_length(target.covered) <= union_length(fine.targets[atom].covered) + 0.05


stretches = st.lists(
    st.tuples(st.integers(0, 20), st.integers(1, 6)).map(lambda pair: TimeInterval(pair[0], pair[0] + pair[1])),
    max_size=6,
).map(merge)
INSTANTS = [index + 0.5 for index in range(28)]


def contains(some: tuple[TimeInterval, ...], t: float) -> bool:
    return any(stretch.start < t < stretch.end for stretch in some)


@given(stretches, stretches)
def test_a_difference_holds_what_only_the_first_holds_and_an_intersection_what_both_hold(first, second):
    for t in INSTANTS:
        assert contains(difference(first, second), t) == (contains(first, t) and not contains(second, t))
        assert contains(intersection(first, second), t) == (contains(first, t) and contains(second, t))


PEGS = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"


def narrow(degrees: int) -> ScoredCell:
    """The cell of pegs with one camera, which looks past the middle."""
    text = PEGS.read_text(encoding="utf-8").split("\n  front:")
    cameras = text[1].split("\n  left:")[1].replace("0.4, 0, 0.1]}", "0.3, 0.1, 0.1]}")
    changed = f"{text[0]}\n  left:{cameras}".replace("36 deg", f"{degrees} deg")
    return read_cell(PEGS, "peg", changed.split("  - {task: insert")[0].encode())


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    first = narrow(24).requests[0]
    with open_computer(Means(Adaptive())) as computer:
        computer.compute([first], lambda _: None)
        best = computer.outcome(first)
        way = replace(first, candidate=best.result.way, coverage=True)
        computer.compute([way], lambda _: None)
        found = computer.outcome(way)
    assert found is not None
    return found


def test_the_time_in_which_every_literal_of_every_step_is_covered_is_q_avg(outcome: Outcome) -> None:
    targets = outcome.coverage.targets.values()
    length = union_length(stretch for target in targets for stretch in target.required)
    lost = [stretch for target in targets for stretch in difference(target.required, target.covered)]
    quality = outcome.result.q_avg
    assert length == pytest.approx(outcome.result.t_total, abs=2e-3 * len(targets))
    assert 1 - union_length(lost) / length == pytest.approx(quality, abs=4e-3)
    assert max(outcome.coverage.primitives.values()) == pytest.approx(outcome.result.time, abs=1e-3)


def test_kept_results_have_the_figures_of_each_step(outcome: Outcome) -> None:
    again = Outcome.from_text(outcome.to_text(), outcome.result.candidate)
    assert again.result.faults == outcome.result.faults
    assert [step.q_avg for step in again.result.steps] == [step.q_avg for step in outcome.result.steps]
    assert [step.candidate.task for step in again.result.steps] == ["pickup peg1", "insert peg1 socket"]
    assert again.to_text() == outcome.to_text()


def test_what_a_narrower_camera_no_longer_sees_is_said_with_the_step() -> None:
    with open_computer(Means(Adaptive())) as computer:
        found = compare_versions(narrow(24), narrow(16), computer, 1.0, lambda *_: nullcontext(lambda _: None))
    (result,) = found.results
    change = next(one for one in result.baseline.ways if one.way == "peg2 then peg2 socket")
    losses = {(loss.literal, loss.camera): loss for loss in change.lost}
    assert ("2.inserted(peg2)", "left") in losses
    assert {"1.hold(peg2)", "2.hold(peg2)"} <= {literal for literal, _ in losses}
    best = change.lost[0]
    first = result.ways[change.way].steps[0].time
    assert best.start > first
