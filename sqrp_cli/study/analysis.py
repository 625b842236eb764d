"""One candidate from check to quality: preconditions, motion, skill states, coverage and the final figures.

The delay of faults is by images, over all phases of the cameras, on the nominal motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import FaultMetrics, LateReason
from sqrp_cli.geometry import inverse
from sqrp_cli.logic.formula_time import GroundOperator
from sqrp_cli.logic.image_time import Onset, Window, delays
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.stop_and_return import Recovery, recovery_over
from sqrp_cli.records import dataclass
from sqrp_cli.sight.targets import Target
from sqrp_cli.skill.target_box import object_of
from sqrp_cli.study.drop_detection import onset
from sqrp_cli.study.fault_sights import all_fault_windows
from sqrp_cli.study.late_faults import why_late
from sqrp_cli.study.result import CandidateResult, PhaseSeen
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import PlannedMotion, Timeline, observe
from sqrp_cli.task import pieces
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.grounding import formulas_outside, ground_formulas, ground_targets
from sqrp_cli.task.task import Candidate

_STEP = 0.02  # between the instants at which a motion is asked whether it fulfils a fault [s]
SUMMED = ("time", "t_total", "t_eoi", "states")  # figures of a task of several steps that are the sums of its steps'


def fault_metrics(windows: Sequence[Window], onsets: Sequence[Onset], recovery: Recovery, total: float) -> FaultMetrics:
    """The metrics of a fault that may happen at any time of its intervals, on a motion of duration `total` [s].

    windows: in which images show it. onsets: of each interval. It is noticed by the first image of it, or never.
    expected_time = mean of the time at which it is noticed + stop + move back to the start + `total`. Means and shares
    are over all the time of the intervals together, the rest is the largest of any of them.
    """
    parts = [delays(windows, onset, lambda t: t + np.interp(t, *recovery) + total, recovery[0]) for onset in onsets]
    lengths = np.array([onset.x[-1] - onset.x[0] for onset in onsets])
    weights = lengths / lengths.sum() if lengths.any() else np.full(len(parts), 1.0 / len(parts))
    longest = 0.0  # stretch of an interval that no window contains
    for one in onsets:
        until, end = float(one.x[0]), float(one.x[-1])
        for window in sorted(windows):
            longest, until = max(longest, min(window.start, end) - until), max(until, window.end)
        longest = max(longest, end - until)
    noticed, unseen = weights * [part.noticed for part in parts], float(weights @ [part.unseen for part in parts])
    return FaultMetrics(
        delay_mean=float(noticed @ [part.mean or 0.0 for part in parts] / noticed.sum()) if noticed.any() else None,
        delay_worst=None if unseen else max(part.worst or 0.0 for part in parts),
        blind_longest=longest,
        unseen=unseen,
        expected_time=None if unseen else float(weights @ [part.cost or 0.0 for part in parts]),
    )


def without_delays(seen: Timeline) -> CandidateResult:
    """The figures of what is seen of a motion, without faults."""
    return CandidateResult(
        candidate=seen.planned.candidate,
        feasible=True,
        time=seen.planned.motion.time,
        q_avg=seen.qualities.q_avg,
        q_eoi=seen.qualities.q_eoi,
        t_total=seen.planned.T,
        t_eoi=seen.planned.T_eoi,
        faults={},
        states=int(seen.monitored.sum()),
    )


@dataclass(frozen=True, eq=False)
class Analysis:
    """A feasible candidate with all data behind its figures."""

    timeline: Timeline
    recovery: Recovery
    windows: Mapping[str, Sequence[Window]]  # In which images show each fault, by its name
    onsets: Mapping[str, tuple[Onset, ...]]
    """From when on images show each fault, for each interval in which it may happen, by its name."""
    why: Mapping[str, LateReason]  # What takes longest until each fault is noticed, by its name

    @property
    def planned(self) -> PlannedMotion:
        """The motion, and what must be seen during it."""
        return self.timeline.planned

    @property
    def result(self) -> CandidateResult:
        """The figures of the candidate, without a verdict."""
        timeline, candidate, motion = self.timeline, self.planned.candidate, self.planned.motion
        faults = {
            fault: replace(
                fault_metrics(windows, self.onsets[fault], self.recovery, motion.time), why=self.why.get(fault)
            )
            for fault, windows in self.windows.items()
        }
        return replace(
            without_delays(timeline),
            faults=faults,
            error=timeline.transition_error,
            largest_gap=timeline.largest_gap,
            remarks=motion.remarks,
            outside=formulas_outside(candidate, motion),
            retried=tuple(name for name in faults if name in candidate.skill.retried_faults),
            phases=() if candidate.skill.recorded is None else tuple(_phases(timeline, motion)),
        )


def _phases(timeline: Timeline, motion: Motion) -> Iterator[PhaseSeen]:
    """The phases of a recorded motion, with the share of each in which neighbouring samples are covered."""
    gaps, pieces = timeline.samples.gaps, timeline.planned.stage.pieces
    phase = np.array([piece.primitive for piece in pieces])[timeline.samples.piece[:-1]]
    monitored, covered = timeline.monitored, timeline.covered
    for number, one in enumerate(motion.primitives):
        own = np.where(phase == number, gaps, 0.0)
        asked = own[monitored[:-1] & monitored[1:]].sum()
        seen = float(own[covered[:-1] & covered[1:]].sum() / asked) if asked else None
        yield PhaseSeen(name=one.name, start=one.start, end=one.end, seen=seen)


def analyse(cell: Cell, candidate: Candidate, world: World, sampling: Sampling, *, full: bool) -> Analysis | Infeasible:
    """Check, move and observe one candidate that starts in `world`.

    full: with the verdicts of every camera and their causes. Raises InputError for a sampling with too many samples.
    """
    motion = feasible_motion(cell, candidate, world)
    if isinstance(motion, Infeasible):
        return motion
    return analysed(cell, planned_motion(cell, candidate, world, motion), sampling, full=full)


def planned_motion(cell: Cell, candidate: Candidate, world: World, motion: Motion) -> PlannedMotion:
    """A candidate with its motion from `world`, or from its own, and what must be seen when."""
    world = motion.initial or world
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in motion.primitives}
    formulas = ground_formulas(candidate, motion)
    targets = ground_targets(cell, candidate, world, motion, formulas)
    stage = Stage(cell.model, motion, pieces.cut_into_pieces(list(spans.values()), formulas), world.X_WO)
    told = _from_when_told(formulas, candidate, stage, targets)
    since = {one.fault: one.start for one, later in zip(formulas, told, strict=True) if one.fault and one != later}
    if since:
        formulas = told
        stage = Stage(cell.model, motion, pieces.cut_into_pieces(list(spans.values()), formulas), world.X_WO)
    column = {target.atom: number for number, target in enumerate(targets)}
    faults, (T, T_eoi) = pieces.fault_literals(formulas).items(), pieces.monitored_times(formulas)
    return PlannedMotion(
        candidate=candidate,
        world=world,
        motion=motion,
        formulas=formulas,
        since=since,
        targets=targets,
        stage=stage,
        faults={name: tuple(dict.fromkeys(column[one.atom] for one in literals)) for name, literals in faults},
        T=T,
        T_eoi=T_eoi,
    )


def _from_when_told(
    formulas: tuple[GroundOperator, ...], candidate: Candidate, stage: Stage, targets: Sequence[Target]
) -> tuple[GroundOperator, ...]:
    """The formulas, a fault that the motion itself fulfils at first counting from when it no longer does, and settled.

    So a part that is being lifted is still where it stood until it is lifted by half its height: only then images tell
    one that has slipped from it. This is of an `eventually` whose literals all say that objects are in boxes that the
    robot does not move.
    """
    by_atom, found = {target.atom: target for target in targets}, list[GroundOperator]()
    for one in formulas:
        boxes = [(literal, box) for literal in one.literals for box in by_atom[literal.atom].boxes]
        named = [object_of(str(literal.atom), box, stage.X_WO) for literal, box in boxes if literal.positive]
        still = not any(box.frame in stage.model.links for _, box in boxes)
        if one.fault is not None and one.operator == "eventually" and still and len(named) == len(boxes) and all(named):
            t = np.append(np.arange(one.start, one.end, _STEP), one.end)
            states, inside = stage.states(stage.samples_at(t)), np.ones(len(t), dtype=bool)
            for (_, box), name in zip(boxes, named, strict=True):
                X_BO = inverse(states.box_poses(box)) @ states.X_WF[name or ""]
                inside &= (np.abs(X_BO[:, :3, 3]) <= 0.5 * np.array(box.size)).all(axis=1)
            if inside[0] and not inside.all():
                settle = candidate.skill.of_fault(one.fault).stated.settle
                one = replace(one, start=min(float(t[inside.argmin()]) + settle, one.end))
        found.append(one)
    return tuple(found)


def analysed(cell: Cell, planned: PlannedMotion, sampling: Sampling, *, full: bool) -> Analysis:
    """What the cameras of a cell see of a motion, whatever others see of it; see `analyse`."""
    return with_delays(cell, observe(planned, cell.observer, sampling, full=full), sampling)


def with_delays(cell: Cell, timeline: Timeline, sampling: Sampling) -> Analysis:
    """What is seen of a motion with how late faults are noticed."""
    planned, observer = timeline.planned, cell.observer
    formulas, literals = planned.formulas, pieces.fault_literals(planned.formulas)
    intervals = {fault: pieces.fault_intervals(formulas, fault) for fault in literals}
    first = min((spans[0].start for spans in intervals.values()), default=planned.motion.time)
    onsets = {
        fault: tuple(onset(planned, observer, literals[fault], span) for span in spans)
        for fault, spans in intervals.items()
    }
    for fault, start in planned.since.items():  # what happens before images can tell it is shown once they can
        told, *others = onsets[fault]
        usual = None if told.usual is None else np.insert(told.usual, 0, told.usual[0])
        shown = np.insert(told.shown, 0, told.shown[0])
        onsets[fault] = (replace(told, x=np.insert(told.x, 0, start), shown=shown, usual=usual), *others)
    windows = all_fault_windows(timeline, observer, sampling)
    recovery = recovery_over(planned.motion, cell.model, first)
    why = {fault: why_late(cell, planned, fault, windows[fault], onsets[fault]) for fault in onsets}
    return Analysis(timeline, recovery, windows, onsets, why)
