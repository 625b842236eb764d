"""Who sees what when, against the qualities that are computed from the same samples; sets of stretches of time."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.logic.formula_time import TimeInterval, merge
from sqrp_cli.motion.cell import Cell
from sqrp_cli.score.kept import COVERAGE, Outcome
from sqrp_cli.study.assessment import analyse
from sqrp_cli.study.blind_spans import coverage_of, difference, intersection
from sqrp_cli.study.quality import qualities_over
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
    quality = qualities_over(found.timeline).q_avg
    assert 1 - union_length(lost) / length == pytest.approx(quality, abs=2 * found.timeline.transition_error + 1e-6)


def test_causes_fill_exactly_the_time_in_which_a_camera_does_not_see(cell, found):
    for target in coverage_of(cell, found).targets.values():
        for camera, spans in target.blind.items():
            blind = [stretch for stretch, _ in spans]
            assert all(a.end <= b.start + 1e-9 for a, b in pairwise(blind))
            assert not intersection(target.seen_by(camera), blind)


def test_a_record_survives_being_written_and_read(cell, found):
    record = COVERAGE.dump_python(coverage_of(cell, found), mode="json")
    outcome = Outcome(found.assessment("a verdict"), COVERAGE.validate_python(record))
    assert COVERAGE.dump_python(outcome.coverage, mode="json") == record
    again = Outcome.from_text(outcome.to_text(), found.candidate)
    assert (again.assessment.q_avg, again.assessment.faults) == (outcome.assessment.q_avg, outcome.assessment.faults)
    assert again.to_text() == outcome.to_text()


def test_a_damaged_record_is_refused(found):
    text = Outcome(found.assessment(""), None).to_text()
    for damaged in (text[:40], "{}", "[]", text.replace('"slip"', '"slip": 3, "x"')):
        with pytest.raises(ValueError):  # noqa: PT011 - of several readers
            Outcome.from_text(damaged, found.candidate)


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
