"""`explain`: a candidate with all data from which its figures can be recomputed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sqrp_cli.camera.camera import assumed_latency
from sqrp_cli.document import LEFT_OUT, Pose, Record, TaskDocument, how_many, live
from sqrp_cli.figures import Qualities
from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents import requirements
from sqrp_cli.sight.limits import Cause, CauseLabel
from sqrp_cli.sight.observer import HidingPart
from sqrp_cli.study.assessment import Study
from sqrp_cli.study.blind_spans import UnseenTime, by_name, cause_totals
from sqrp_cli.study.in_the_way import (
    HiddenTarget,
    HiddenView,
    HiddenViews,
    ObjectToMove,
    hidden_views,
    in_the_way,
    to_move,
)
from sqrp_cli.study.pipeline import sampling_done
from sqrp_cli.study.result import CandidateResult, SamplingDone
from sqrp_cli.study.robustness import Expectation, expectation, without_each_camera
from sqrp_cli.study.sampling import Sampling

if TYPE_CHECKING:
    from sqrp_cli.study.pipeline import Explained
else:  # no file has it
    Explained = Any


@dataclass(frozen=True, kw_only=True)
class Verdict(Record):
    """Whether a camera covers all boxes of a target."""

    covered: bool
    """Whether no limit fails."""
    cause: CauseLabel | None
    """The first limit that fails."""
    by: str | None
    """What hides it or has its colour behind it, or the side on which it is out of the image."""
    box: str | None = field(default=None, metadata=LEFT_OUT)
    """Of a target with several boxes: the first that fails, in their order."""


@dataclass(frozen=True, kw_only=True)
class BoxSight(Record):
    """What the curve of a detector says of a box in an image, and what from."""

    probability: float
    """That the detector sees it, in 0..1; 0 where it fails a limit that the curve does not replace."""
    pixels: float | None
    """Its size in the image: square root of its area [pixels]; null where the probability is 0 by such a limit."""
    incidence: float | None
    """Angle between its normal and the direction to the camera [rad]; 0 without a normal."""
    distance: float | None
    """From the camera to its centre [m]."""
    visible: float | None
    """Share of its silhouette that nothing hides, in 0..1."""
    blur: float | None
    """How far its centre moves in the image while the shutter is open [pixels]."""


@dataclass(frozen=True, kw_only=True)
class BoxVerdict(Verdict):
    """Whether a camera covers a box."""

    visible: float | None
    """Visible share of the box's silhouette; null if an earlier limit failed."""
    hidden_by: Sequence[HidingPart] | None = field(default=None, metadata=LEFT_OUT)
    """Of a hidden box: what every part hides, the largest share first. The shares add up to 1 - `visible`."""
    sight: BoxSight | None = field(default=None, metadata=LEFT_OUT)
    """How likely its detector sees it; left out where the detector has no curve."""


@dataclass(frozen=True, kw_only=True)
class BoxCoverage(Record):
    """A box at an instant."""

    corners: list[list[float]] | None = field(default=None, metadata=LEFT_OUT)
    """The 8 corners in the world [m], x slowest, z fastest."""
    cameras: Mapping[str, BoxVerdict]
    """The verdict of each camera, by its name."""


@dataclass(frozen=True, kw_only=True)
class LiteralCoverage(Record):
    """A literal at an instant."""

    covered: bool
    """Whether enough cameras cover all its boxes."""
    boxes: list[BoxCoverage]
    """In the order of `targets[LITERAL].boxes`."""
    cameras: Mapping[str, Verdict]
    """The verdict of each camera on all boxes, by its name: that on the first box it does not cover."""
    expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show it; left out where no detector has a curve."""


@dataclass(frozen=True, kw_only=True)
class Sample(Record):
    """An instant. At a change there are two samples of equal t, before and after it."""

    t: float
    """From the start of the motion [s]; twice where literals, the held object or the motion law change."""
    q: Mapping[str, float]
    """Position of every movable joint [rad or m]."""
    objects: Mapping[str, Pose]
    """In the world."""
    held: str | None
    """The object in the tool; null if there is none."""
    covered: bool | None
    """Null where no formula requires anything."""
    event: bool
    """Whether it lies in an event of interest."""
    literals: Mapping[str, LiteralCoverage]
    """What formulas require to be seen at this instant, by literal."""
    expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show all of them; left out where none is required, or no detector has a curve."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CandidateStudy(CandidateResult):
    """A candidate over time; of an infeasible one the lists are empty."""

    sampling: SamplingDone | None = None
    """How the motion was sampled; null if the candidate is infeasible."""
    primitives: Sequence[requirements.Span] = ()
    """In the order in which they are done."""
    formulas: Sequence[requirements.Formula] = ()
    """One entry for each temporal operator of the skill's formulas."""
    cameras: Mapping[str, requirements.CameraTiming] = field(default_factory=dict)
    """By the camera's name."""
    without_camera: Mapping[str, Qualities] = field(default_factory=dict)
    """The qualities if this camera fails."""
    recovery: requirements.RecoveryTimes | None = None
    """How long a stop and the way back take; null if the candidate is infeasible."""
    sights: Mapping[str, requirements.FaultSight] = field(default_factory=dict)
    """When images show each fault, by its name."""
    targets: Mapping[str, requirements.TargetBoxes] = field(default_factory=dict)
    """By literal, for every literal of `formulas`."""
    samples: Sequence[Sample] = ()
    """The sampled instants in the order of time."""
    unseen_times: Sequence[UnseenTime] = ()
    """Why each camera does not see each literal, the longest time first within each literal."""
    hidden: Sequence[HiddenTarget] = ()
    """Who is in the way: of each literal, from each camera that it is hidden from."""
    to_move: Sequence[ObjectToMove] = ()
    """Objects in the way, the largest `alone` first: the one to move first. Empty if only the robot is in the way."""
    assumed: str = ""
    """What delays assume of the cameras, in words; empty where all state their latency."""

    @classmethod
    def of_study(
        cls, cell: Cell, study: Study | None, found: CandidateResult, sampling: Sampling, *, brief: bool = False
    ) -> CandidateStudy:
        """A candidate with everything computed about it; study: None if it is infeasible.

        brief: without who is in the way and the verdicts of single boxes, which take most of the time.
        """
        if study is None:
            return cls(**vars(found))
        views = None if brief else hidden_views(cell, study)
        return cls(
            **vars(found),
            sampling=sampling_done(sampling, [found]),
            primitives=[
                requirements.Span(name=timed.name, start=timed.start, end=timed.end, does=stated.words)
                for timed, stated in zip(study.motion.primitives, study.candidate.skill.primitives, strict=True)
            ],
            formulas=[requirements.Formula.of(formula) for formula in study.formulas],
            cameras={camera.name: requirements.CameraTiming.of(camera) for camera in cell.observer.cameras},
            without_camera=without_each_camera(cell, study),
            recovery=requirements.RecoveryTimes(t=study.recovery.t.tolist(), duration=study.recovery.duration.tolist()),
            sights={fault: requirements.FaultSight.of(study, fault) for fault in study.windows},
            targets=requirements.targets_of(study),
            samples=_samples(cell, study, views),
            unseen_times=cause_totals(cell, study),
            hidden=() if views is None else in_the_way(cell, study, views),
            to_move=() if views is None else to_move(cell, study, views),
            assumed=assumed_latency(cell.observer.cameras),
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class Explanation(CandidateStudy, TaskDocument):
    """What `sqrp explain` finds about one candidate.

    Of a task of several steps it is about one step; `rank` and `pareto` are those of all steps together.
    """

    VIEW = "sqrp_cli.show.terminal.timeline_chart:print_study"

    document: Literal["explain"] = "explain"
    task: str
    """As it was asked for."""
    step: int | None = field(default=None, metadata=LEFT_OUT)
    """Which step, from 1: of a task of several, or of a program."""
    of_steps: int | None = field(default=None, metadata=LEFT_OUT)
    """How many steps there are."""
    whole: str | None = field(default=None, metadata=LEFT_OUT)
    """The name of the candidate of all steps; left out in a program, which has no ranking."""

    explained: Explained | None = live()
    """With the study behind it."""
    ranking: Sequence[CandidateResult] = live(())
    """All candidates of the task, best first."""

    __repr__ = TaskDocument.__repr__

    @property
    def candidates(self) -> tuple[Explanation]:
        """The only one, as `ExplainedAll` has several."""
        return (self,)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.task} in {self.workspace}: {super().brief}"


@dataclass(frozen=True, kw_only=True, repr=False)
class ExplainedAll(TaskDocument):
    """What `sqrp explain --all` finds."""

    VIEW = "sqrp_cli.show.terminal.timeline_chart:print_comparison"

    document: Literal["explain --all"] = "explain --all"
    candidates: list[CandidateStudy]
    """The requested candidates, best first, infeasible ones last."""

    explained: Sequence[Explained] = live(())
    """With the studies behind them."""
    ranking: Sequence[CandidateResult] = live(())
    """All candidates of the task, best first."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.task} in {self.workspace}: {how_many(self.candidates, 'candidate')}"


def _samples(cell: Cell, study: Study, views: HiddenViews | None) -> list[Sample]:
    """Every sample with all verdicts; views: None to leave out those of single boxes."""
    timeline, samples = study.timeline, study.timeline.samples
    states, q, held = study.stage.states(samples), study.stage.positions(samples), study.stage.held(samples)
    objects = [name for name in cell.workspace.objects if name in states.X_WF]
    expected = expectation(cell, study)
    column = {target.atom: index for index, target in enumerate(study.targets)}
    seen = [_coverage(cell, study, index, states.X_WF, views, expected) for index in range(len(study.targets))]
    return [
        Sample(
            t=float(samples.t[row]),
            q=cell.model.joint_values(q[row]),
            objects={name: _at(states.X_WF[name], row).tolist() for name in objects},
            held=held[row],
            covered=bool(timeline.covered[row]) if timeline.monitored[row] else None,
            event=bool(timeline.interesting[row]),
            literals={
                str(literal): seen[column[literal.atom]][row]
                for literal in timeline.pieces[int(samples.piece[row])].literals
            },
            expected=_known(expected.states[row]) if expected is not None else None,
        )
        for row in range(len(samples))
    ]


def _coverage(
    cell: Cell,
    study: Study,
    column: int,
    X_WF: Mapping[str, Array],
    views: HiddenViews | None,
    expected: Expectation | None,
) -> list[LiteralCoverage]:
    """The verdicts on the boxes of a target and on its cameras, per sample. column: index of the target."""
    target, observation = study.targets[column], study.timeline.observation
    matrix, names = observation.full_matrix[column], [camera.name for camera in cell.observer.cameras]
    corners = [transform(X_WF[box.frame] @ box.X_FB, box_corners(box.size)) for box in target.boxes]

    def verdict(number: int, row: int, camera: int) -> BoxVerdict:
        """Of a camera on a box: why not, and what the curve of the box's detector says, where it has one."""
        boxes, view = matrix[number], HiddenView(column, number, row, camera)
        cause, visible = Cause(int(boxes.cause[row, camera])), float(boxes.visible[row, camera])
        found = None if expected is None else expected.boxes[column][number]
        sight = None
        if found is not None and found.sights is not None:
            values = {name: _known(values[row, camera]) for name, values in found.sights._asdict().items()}
            sight = BoxSight(probability=float(found.probability[row, camera]), **values)
        parts = None if views is None else views.get(view)
        return BoxVerdict(
            covered=cause is Cause.NONE,
            cause=cause.label,
            by=by_name(cell, cause, int(boxes.by[row, camera])),
            visible=_known(visible),
            hidden_by=parts,
            sight=sight,
        )

    def first_failure(verdicts: Sequence[BoxVerdict]) -> Verdict:
        number = next((number for number, one in enumerate(verdicts) if not one.covered), None)
        if number is None:
            return Verdict(covered=True, cause=None, by=None)
        box = target.boxes[number].name if len(verdicts) > 1 else None
        return Verdict(covered=False, cause=verdicts[number].cause, by=verdicts[number].by, box=box)

    found = []
    for row, covered in enumerate(observation.covered[:, column].tolist()):
        of_boxes = [
            {name: verdict(number, row, index) for index, name in enumerate(names)} for number in range(len(matrix))
        ]
        found.append(
            LiteralCoverage(
                covered=covered,
                boxes=[
                    BoxCoverage(corners=_at(points, row).tolist(), cameras=cameras)
                    for points, cameras in zip(corners, of_boxes, strict=True)
                    if views is not None
                ],
                cameras={name: first_failure([cameras[name] for cameras in of_boxes]) for name in names},
                expected=None if expected is None else float(expected.targets[row, column]),
            )
        )
    return found


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _at(X: Array, row: int) -> Array:
    """Entry of an array with leading dimension m or 1."""
    entry: Array = X[row if len(X) > 1 else 0]
    return entry
