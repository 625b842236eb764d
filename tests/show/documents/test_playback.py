"""What a page plays holds all that `explain` finds, but says nothing twice."""

from __future__ import annotations

from dataclasses import replace

from sqrp_cli.figures import NO_FIGURES
from sqrp_cli.show.documents.explanation import (
    BoxCoverage,
    BoxVerdict,
    ExplainedCandidate,
    Formula,
    LiteralCoverage,
    Sample,
    Span,
)
from sqrp_cli.show.documents.playback import PlayedCandidate
from sqrp_cli.show.pages.assembly import tidy
from sqrp_cli.study.result import CandidateResult

SEEN = BoxVerdict(covered=True, cause=None, by=None, visible=1.0)


def sample(t: float, x: float) -> Sample:
    boxes = [BoxCoverage(corners=[[0.0] * 3] * 8, cameras={"cam": SEEN})]
    return Sample(
        t=t,
        q={},
        objects={"part": [[x]], "table": [[0.0]]},
        held=None,
        event=False,
        covered=True,
        literals={"hold": LiteralCoverage(covered=True, boxes=boxes, cameras={"cam": SEEN})},
    )


def analysis(samples: list[Sample]) -> ExplainedCandidate:
    return ExplainedCandidate(
        **vars(NO_FIGURES), parameters={}, feasible=True, rank=1, reasons=(), pareto=True, verdict="", ways=None,
        sampling=None, primitives=[], formulas=[], cameras={}, without_camera={}, recovery=None, sights={}, targets={},
        samples=samples, hidden=[], to_move=[],
    )  # fmt: skip


def test_objects_that_never_move_are_listed_once() -> None:
    found = PlayedCandidate.of_candidate(analysis([sample(0.0, 1.0), sample(1.0, 2.0)]))
    assert found.still == {"table": [[0.0]]}
    assert [one.objects for one in found.samples] == [{"part": [[1.0]]}, {"part": [[2.0]]}]


def test_corners_that_follow_from_poses_are_left_out() -> None:
    found = tidy(PlayedCandidate.of_candidate(analysis([sample(0.0, 1.0)])))
    assert [set(box) for box in found["samples"][0]["literals"]["hold"]["boxes"]] == [{"cameras"}]


def step_of(x: float, q_avg: float) -> ExplainedCandidate:
    """A step of two seconds with one primitive and one formula."""
    formula = Formula(text="", operator="always", start=0.5, end=1.0, literals=["not hold"], fault="slip")
    return replace(
        analysis([sample(0.0, x), sample(2.0, x)]),
        time=2.0,
        q_avg=q_avg,
        primitives=[Span(name="a1", start=0.0, end=2.0)],
        formulas=[formula],
    )


def test_steps_follow_each_other_under_names_with_their_numbers() -> None:
    steps = tuple(
        CandidateResult(**vars(NO_FIGURES), task=task, parameters={}, feasible=True, verdict="")
        for task in ("pick", "put")
    )
    figures = CandidateResult(
        **vars(NO_FIGURES), parameters={}, feasible=True, rank=1, reasons=(), pareto=True, verdict="", ways=None,
        steps=steps,
    )  # fmt: skip
    found = PlayedCandidate.of_steps(figures, [step_of(1.0, 0.5), step_of(2.0, 0.25)])
    assert [(one.name, one.start, one.end) for one in found.primitives] == [("1.a1", 0.0, 2.0), ("2.a1", 2.0, 4.0)]
    assert [(one.start, one.literals, one.fault) for one in found.formulas] == [
        (0.5, ["not 1.hold"], "1.slip"),
        (2.5, ["not 2.hold"], "2.slip"),
    ]
    literals = [(one.t, *one.literals) for one in found.samples]
    assert literals == [(0, "1.hold"), (2, "1.hold"), (2, "2.hold"), (4, "2.hold")]
    assert found.still == {"table": [[0.0]]}
    assert [(one.name, one.start, one.end, one.seen_worst) for one in found.played] == [
        ("1: pick", 0.0, 2.0, False),
        ("2: put", 2.0, 4.0, True),
    ]
