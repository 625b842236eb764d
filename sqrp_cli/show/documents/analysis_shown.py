"""Makes the document of `explain`: every sample with all verdicts, and what a candidate asks for over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from sqrp_cli.camera.detector import COEFFICIENTS
from sqrp_cli.checks.lint import assumptions
from sqrp_cli.files.entries import from_fields
from sqrp_cli.geometry import Array, box_corners, finite_or_none, transform
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.motion.cell import Cell
from sqrp_cli.show.documents.explanation import (
    BoxCoverage,
    BoxSight,
    BoxVerdict,
    CameraTiming,
    ExplainedBox,
    ExplainedCandidate,
    FaultSight,
    Formula,
    LiteralCoverage,
    RecoveryTimes,
    Sample,
    SightOnset,
    Span,
    TargetBoxes,
    Verdict,
)
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer, first_failing
from sqrp_cli.skill.target_box import fact_words
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.blind_spans import cause_totals, coverage_by_phase, free_views
from sqrp_cli.study.in_the_way import HiddenViews, hidden_views, in_the_way, to_move
from sqrp_cli.study.pipeline import sampling_done
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.robustness import Expectation, expectation, without_each_camera
from sqrp_cli.study.sampling import Sampling


def analysis_shown(
    cell: Cell,
    analysis: Analysis | None,
    found: CandidateResult,
    sampling: Sampling,
    needed: float | None = None,
    *,
    brief: bool = False,
) -> ExplainedCandidate:
    """A candidate with everything computed about it; analysis: None if it is infeasible.

    needed: how long a camera needs a free view, if that is asked for [s]. brief: without who is in the
    way and the verdicts of single boxes, which take most of the time.
    """
    if analysis is None:
        return ExplainedCandidate(**vars(found))
    planned = analysis.planned
    views = None if brief else hidden_views(cell, analysis)
    literals = dict.fromkeys(literal for formula in planned.formulas for literal in formula.literals)
    targets = {}
    for target in planned.targets:
        boxes = [
            from_fields(ExplainedBox, box, min_visible=box.limits.min_visible, pose=box.X_FB.tolist())
            for box in target.boxes
        ]
        says = fact_words(str(target.atom), target.boxes, cell.workspace.objects)
        targets[target.atom] = TargetBoxes(k=target.cameras, says=says, boxes=boxes)
    free, of_all = (None, None) if needed is None else free_views(cell, analysis, needed)
    coverage, causes = coverage_by_phase(cell, analysis) if found.phases else (None, ())
    does = {primitive.name: primitive.words for primitive in planned.candidate.skill.primitives}
    sights = {}
    for fault, windows in analysis.windows.items():
        onsets = (
            SightOnset(x=one.x.tolist(), shown=one.shown.tolist(), usual=one.as_usual.shown.tolist())
            for one in analysis.onsets[fault]
        )
        sights[fault] = FaultSight(windows=list(windows), onsets=list(onsets))
    return ExplainedCandidate(
        **vars(found),
        sampling=sampling_done(sampling, [found]),
        primitives=[
            from_fields(Span, timed, does=does.get(timed.name, timed.name)) for timed in planned.motion.primitives
        ],
        formulas=[
            from_fields(Formula, one, literals=[str(literal) for literal in one.literals]) for one in planned.formulas
        ],
        cameras={one.name: CameraTiming.of(one) for one in cell.observer.cameras},
        without_camera=without_each_camera(cell, analysis),
        recovery=RecoveryTimes(t=analysis.recovery[0].tolist(), duration=analysis.recovery[1].tolist()),
        sights=sights,
        targets={str(literal): targets[literal.atom] for literal in literals},
        samples=_samples(cell, analysis, views),
        unseen_times=cause_totals(cell, analysis),
        coverage=coverage,
        windows=free,
        free_views=of_all,
        coverage_causes=causes,
        hidden=() if views is None else in_the_way(cell, analysis, views),
        to_move=() if views is None else to_move(cell, analysis, views),
        assumed=assumptions(cell.workspace, planned.candidate.binding.values(), cell.observer.cameras),
    )


def _samples(cell: Cell, analysis: Analysis, views: HiddenViews | None) -> list[Sample]:
    """Every sample with all verdicts; views: None to leave out those of single boxes."""
    timeline, samples = analysis.timeline, analysis.timeline.samples
    stage, targets = analysis.planned.stage, analysis.planned.targets
    states, q, held = stage.states(samples), stage.positions(samples), stage.held(samples)
    objects = {name: states.X_WF[name] for name in cell.workspace.objects if name in states.X_WF}
    expected = expectation(cell, analysis)
    column = {target.atom: index for index, target in enumerate(targets)}
    seen = [_coverage(cell, analysis, index, states.X_WF, views, expected) for index in range(len(targets))]
    return [
        Sample(
            t=float(samples.t[row]),
            q=cell.model.joint_values(q[row]),
            objects={name: X[row if len(X) > 1 else 0].tolist() for name, X in objects.items()},
            held=held[row],
            covered=bool(timeline.covered[row]) if timeline.monitored[row] else None,
            event=bool(timeline.of_interest[row]),
            literals={
                str(literal): seen[column[literal.atom]][row]
                for literal in stage.pieces[int(samples.piece[row])].literals
            },
            expected=finite_or_none(expected.states[row]) if expected is not None else None,
        )
        for row in range(len(samples))
    ]


def _coverage(
    cell: Cell,
    analysis: Analysis,
    column: int,
    X_WF: Mapping[str, Array],
    views: HiddenViews | None,
    expected: Expectation | None,
) -> list[LiteralCoverage]:
    """The verdicts on the boxes of a target and on its cameras, per sample. column: index of the target."""
    target, observation = analysis.planned.targets[column], analysis.timeline.observation
    matrix, names = observation.full_matrix[column], [camera.name for camera in cell.observer.cameras]
    corners = [transform(X_WF[box.frame] @ box.X_FB, box_corners(box.size)) for box in target.boxes]
    covered = observation.covered[:, column].tolist()
    first, box_of = first_failing(matrix, np.arange(len(covered)))
    called = [box.name if len(target.boxes) > 1 else None for box in target.boxes]

    def verdict(number: int, row: int, camera: int) -> BoxVerdict:
        """Of a camera on a box: why not, and what the curve of the box's detector says, where it has one."""
        found, sight = None if expected is None else expected.boxes[column][number], None
        if found is not None and found.sights is not None:
            values = dict(zip(COEFFICIENTS, map(finite_or_none, found.sights[:, row, camera]), strict=True))
            sight = BoxSight(probability=float(found.probability[row, camera]), **values)
        return BoxVerdict(
            **vars(verdict_shown(cell.observer, matrix[number], row, camera)),
            visible=finite_or_none(float(matrix[number].visible[row, camera])),
            hidden_by=None if views is None else views.get((column, number, row, camera)),
            sight=sight,
        )

    def boxes(row: int) -> Iterator[BoxCoverage]:
        for number, points in enumerate(corners):
            cameras = {name: verdict(number, row, index) for index, name in enumerate(names)}
            yield BoxCoverage(corners=points[row if len(points) > 1 else 0].tolist(), cameras=cameras)

    return [
        LiteralCoverage(
            covered=is_covered,
            boxes=[] if views is None else list(boxes(row)),
            cameras={
                name: verdict_shown(cell.observer, first, row, index, called[box_of[row, index]])
                for index, name in enumerate(names)
            },
            expected=None if expected is None else float(expected.targets[row, column]),
        )
        for row, is_covered in enumerate(covered)
    ]


def verdict_shown(observer: Observer, found: BoxVerdicts, row: int, camera: int, box: str | None = None) -> Verdict:
    """The verdict of a camera in one row of those on a box. box: its name, if it is one of several of a target."""
    cause = Cause(int(found.cause[row, camera]))
    if cause is Cause.NONE:
        return Verdict(covered=True, cause=None, by=None)
    return Verdict(covered=False, cause=cause.label, by=observer.by_name(cause, int(found.by[row, camera])), box=box)
