"""What a page plays holds all that `explain` finds, but says nothing twice."""

from __future__ import annotations

from sqrp_cli.programming.coverage.quality import NO_FIGURES
from sqrp_cli.report.documents.explanation import BoxCoverage, BoxVerdict, CandidateStudy, LiteralCoverage, Sample
from sqrp_cli.report.documents.playback import PlayedCandidate
from sqrp_cli.report.pages.page import tidy

SEEN = BoxVerdict(covered=True, cause=None, by=None, visible=1.0)


def sample(t: float, x: float) -> Sample:
    boxes = [BoxCoverage(corners=[[0.0] * 3] * 8, cameras={"cam": SEEN})]
    return Sample(
        t=t,
        q={},
        objects={"part": [[x]], "table": [[0.0]]},
        held=None,
        covered=True,
        literals={"hold": LiteralCoverage(covered=True, boxes=boxes, cameras={"cam": SEEN})},
    )


def study(samples: list[Sample]) -> CandidateStudy:
    return CandidateStudy(
        **vars(NO_FIGURES), parameters={}, feasible=True, rank=1, reasons=(), pareto=True, verdict="", ways=None,
        sampling=None, primitives=[], formulas=[], cameras={}, without_camera={}, recovery=None, targets={},
        samples=samples,
    )  # fmt: skip


def test_objects_that_never_move_are_listed_once() -> None:
    found = PlayedCandidate.of_candidate(study([sample(0.0, 1.0), sample(1.0, 2.0)]))
    assert found.still == {"table": [[0.0]]}
    assert [one.objects for one in found.samples] == [{"part": [[1.0]]}, {"part": [[2.0]]}]


def test_corners_that_follow_from_poses_are_left_out() -> None:
    found = tidy(PlayedCandidate.of_candidate(study([sample(0.0, 1.0)])))
    assert [set(box) for box in found["samples"][0]["literals"]["hold"]["boxes"]] == [{"cameras"}]
