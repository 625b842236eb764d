"""One candidate from check to quality: preconditions, motion, skill states, coverage and the final figures.

The delay of faults is by images, over all phases of the cameras, on the nominal motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.errors import Infeasible, bad_input
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.image_time import Onset, Window, delays
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming import pieces
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.fault_sights import all_fault_windows, fault_onsets
from sqrp_cli.programming.coverage.quality import NO_FIGURES, Figures, Qualities, figures_of
from sqrp_cli.programming.coverage.sampling import MAX_SAMPLES, Sampling, sample_count
from sqrp_cli.programming.coverage.stage import Stage
from sqrp_cli.programming.coverage.timeline import Rehearsal, Timeline, observe, observe_all
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.grounding import TargetGrounder, formulas_outside, ground_formulas
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.motion.stop_and_return import Recovery, recovery_over
from sqrp_cli.programming.task import Candidate

_PROMPT = 1e-3
"""Times and shares up to this explain no delay [s, 1]."""


def fault_metrics(windows: Sequence[Window], onsets: Sequence[Onset], recovery: Recovery, total: float) -> FaultMetrics:
    """The metrics of a fault that may happen at any time of its intervals, on a motion of duration `total` [s].

    windows: in which images show it. onsets: of each interval. It is noticed by the first image of it, or never.
    expected_time = mean of the time at which it is noticed + stop + move back to the start + `total`. Means and shares
    are over all the time of the intervals together, the rest is the largest of any of them.
    """
    parts = [delays(windows, onset, lambda t: t + recovery.at(t) + total, recovery.t) for onset in onsets]
    lengths = np.array([onset.x[-1] - onset.x[0] for onset in onsets])
    weights = lengths / lengths.sum() if lengths.any() else np.full(len(parts), 1.0 / len(parts))
    noticed, unseen = weights * [part.noticed for part in parts], float(weights @ [part.unseen for part in parts])
    return FaultMetrics(
        delay_mean=float(noticed @ [part.mean or 0.0 for part in parts] / noticed.sum()) if noticed.any() else None,
        delay_worst=None if unseen else max(part.worst or 0.0 for part in parts),
        blind_longest=max(longest_gap(windows, Stretch(float(one.x[0]), float(one.x[-1]))) for one in onsets),
        unseen=unseen,
        expected_time=None if unseen else float(weights @ [part.cost or 0.0 for part in parts]),
    )


def why_late(fault: FaultMetrics, windows: Sequence[Window], onsets: Sequence[Onset]) -> str:
    """What takes so long until a fault is noticed, at worst; see `fault_metrics`."""
    if not windows:
        return "no image is sure to show it"
    if fault.unseen:
        return f"no image is sure to show it in {100 * fault.unseen:.3g} % of cases"
    if fault.blind_longest > _PROMPT:
        return f"no image shows it for up to {fault.blind_longest:.2f} s"
    parting = max(float((onset.shown - onset.x).max()) for onset in onsets)
    if parting > _PROMPT:
        return f"tool and part have to part for up to {parting:.2f} s before an image shows it"
    return "so long take a frame and the latency of the camera that sees it"


def longest_gap(windows: Sequence[Window], interval: Stretch) -> float:
    """The longest stretch of an interval that no window contains [s]."""
    found, until = 0.0, interval.start
    for window in sorted(windows):
        found = max(found, min(window.start, interval.end) - until)
        until = max(until, window.end)
    return max(found, interval.end - until)


@dataclass(frozen=True, kw_only=True)
class WayFigures:
    """One way of doing what a candidate says."""

    parameters: Mapping[str, float | str]
    """Those of the candidate, with a value for each that it leaves free."""
    vias: Mapping[str, list[list[float]]]
    """By the name of a joint move, the joint positions that it bends around, in the order of the arm's joints; direct
    moves have none [rad or m]."""
    time: float
    """Duration of the whole motion [s]."""
    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""
    delay_worst: float | None
    """The longest time that any fault may remain unnoticed [s]; null without faults, and where one may never be
    noticed."""
    unseen: float | None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""


@dataclass(frozen=True, kw_only=True)
class BlindEnd:
    """An end of a joint move at which the cameras do not cover the state, whatever the path of the move."""

    primitive: str
    """Name of the joint move."""
    at: str
    """The waypoint there."""
    seconds: float
    """How long the state is not covered between there and where the cameras see it first [s]; the whole move, named
    where it begins, if they never do."""


@dataclass(frozen=True, kw_only=True)
class WaysFound:
    """The ways of doing what a candidate says."""

    tried: int
    """How many there are, by all that the candidate leaves free."""
    feasible: int
    """How many of them can be done, within `--max-time` if that is given."""
    pareto: tuple[WayFigures, ...]
    """The way that the candidate's own figures are about, then the others that are Pareto-optimal in q_eoi, q_avg and
    time, the best first."""
    blind_ends: tuple[BlindEnd, ...] = ()
    """The ends of joint moves that no path can make seen, of the first way; empty if all paths have to be direct."""


@dataclass(frozen=True, eq=False)
class Assessment(Figures):
    """What is reported of one candidate."""

    candidate: Candidate
    feasible: bool
    reasons: tuple[str, ...] = ()
    """Why it is infeasible, most useful first."""
    error: float | None = None
    """Bound on the error of Q from bisection, in 0..1."""
    q_expected: float | None = None
    """How likely images show all that must be seen, mean over T, in 0..1; None without detectors that have curves."""
    largest_gap: float | None = None
    """Between samples, see `Timeline.largest_gap` [s]."""
    remarks: tuple[str, ...] = ()
    """Detours and speeds that are not reached, such as `a1 goes around wall` and `a4 reaches 3.4 of 5 cm/s`."""
    outside: tuple[tuple[int, int], ...] = ()
    """The temporal operators that are never checked, see `grounding.formulas_outside`."""
    verdict: str = ""
    """One or two sentences."""
    recalibrated: tuple[Qualities, ...] = ()
    """The qualities for random camera poses, if requested."""
    ways: WaysFound | None = None
    """The ways in which it can be done; None where its motion was not asked for."""
    best_way: Candidate | None = None
    """The way behind the figures, if the candidate leaves something free."""
    why_late: str = ""
    """What takes so long until the fault with the longest delay is noticed, in a few words; empty without faults."""
    steps: tuple[Assessment, ...] = ()
    """Of a task of several steps: those of the steps that were looked at."""

    @property
    def way(self) -> Candidate:
        """The way that has these figures: the candidate itself if it leaves nothing free."""
        return self.best_way or self.candidate

    @classmethod
    def infeasible(
        cls, candidate: Candidate, reasons: tuple[str, ...], verdict: str = "", ways: WaysFound | None = None
    ) -> Assessment:
        """The assessment of a candidate that cannot be done."""
        return cls(candidate, feasible=False, reasons=reasons, verdict=verdict, ways=ways, **vars(NO_FIGURES))

    @property
    def has_choice(self) -> bool:
        """Whether there is more than one way of doing it."""
        return self.ways is not None and self.ways.tried > 1


@dataclass(frozen=True, eq=False)
class Watched(Rehearsal):
    """A feasible candidate with what the cameras see of it, but not yet how late faults are noticed."""

    timeline: Timeline

    @property
    def without_delays(self) -> Assessment:
        """Its figures, without faults."""
        return Assessment(self.candidate, feasible=True, **vars(figures_of(self.timeline, self.motion.time, {})))


@dataclass(frozen=True, eq=False)
class Study(Watched):
    """A feasible candidate with all data behind its figures."""

    recovery: Recovery
    windows: Mapping[str, Sequence[Window]]
    """In which images show each fault, by its name."""
    onsets: Mapping[str, tuple[Onset, ...]]
    """From when on images show each fault, for each interval in which it may happen, by its name."""

    def assessment(self, verdict: str) -> Assessment:
        """The figures of the candidate."""
        timeline, time = self.timeline, self.motion.time
        faults = {
            fault: fault_metrics(windows, self.onsets[fault], self.recovery, time)
            for fault, windows in self.windows.items()
        }
        latest = max(faults, key=lambda fault: (faults[fault].unseen, faults[fault].delay_worst or 0.0), default=None)
        return Assessment(
            candidate=self.candidate,
            feasible=True,
            **vars(figures_of(timeline, time, faults)),
            error=timeline.transition_error,
            largest_gap=timeline.largest_gap,
            remarks=self.motion.remarks,
            outside=formulas_outside(self.candidate, self.motion),
            verdict=verdict,
            why_late="" if latest is None else why_late(faults[latest], self.windows[latest], self.onsets[latest]),
        )


def study(cell: Cell, candidate: Candidate, world: World, sampling: Sampling, *, full: bool) -> Study | Infeasible:
    """Check, move and observe one candidate that starts in `world`.

    full: with the verdicts of every camera and their causes. Raises InputError for a sampling with too many samples.
    """
    motion = feasible_motion(cell, candidate, world)
    if isinstance(motion, Infeasible):
        return motion
    return observed(cell, rehearsal(cell, candidate, world, motion), sampling, full=full)


def rehearsal(cell: Cell, candidate: Candidate, world: World, motion: Motion) -> Rehearsal:
    """A candidate with its motion from `world`, and what must be seen when."""
    workspace, model = cell.workspace, cell.model
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in motion.primitives}
    formulas = ground_formulas(candidate, spans, motion.time)
    grounder = TargetGrounder(
        candidate=candidate,
        world=world,
        motion=motion,
        objects=workspace.objects,
        detectors=workspace.detectors,
        robot=workspace.robot,
        model=model,
    )
    targets = grounder.targets(formulas)
    column = {target.atom: number for number, target in enumerate(targets)}
    faults = pieces.fault_literals(formulas).items()
    return Rehearsal(
        candidate=candidate,
        world=world,
        motion=motion,
        formulas=formulas,
        targets=targets,
        stage=Stage(model, motion, pieces.cut_into_pieces(list(spans.values()), formulas), world.X_WO),
        faults={name: tuple(dict.fromkeys(column[one.atom] for one in literals)) for name, literals in faults},
        T=pieces.monitored_time(formulas),
        T_eoi=pieces.interesting_time(formulas),
    )


def observed(cell: Cell, scene: Rehearsal, sampling: Sampling, *, full: bool) -> Study:
    """What the cameras see of a motion; see `study`."""
    return all_observed(cell, [scene], sampling, full=full)[0]


def all_observed(cell: Cell, scenes: Sequence[Rehearsal], sampling: Sampling, *, full: bool) -> list[Study]:
    """As `observed` of each of several motions, which is faster together."""
    return with_delays(cell, all_watched(cell, scenes, sampling, full=full), sampling)


def all_watched(cell: Cell, scenes: Sequence[Rehearsal], sampling: Sampling, *, full: bool) -> list[Watched]:
    """As `all_observed`, without delays."""
    for scene in scenes:
        if (count := sample_count(sampling, scene.motion)) > MAX_SAMPLES:
            name = scene.candidate.name
            message = f"this sampling asks for {count:,.0f} samples of `{name}`; the limit is {MAX_SAMPLES:,}"
            mend = "leave it out: the default places samples where they matter"
            raise bad_input("too-many-samples", message, mend=mend)
    timelines = observe_all(scenes, cell.observer, sampling, full=full)
    return [Watched(**vars(scene), timeline=timeline) for scene, timeline in zip(scenes, timelines, strict=True)]


def with_delays(cell: Cell, watched: Sequence[Watched], sampling: Sampling) -> list[Study]:
    """Motions with how late faults are noticed; as they are where that is known."""
    asked = [one for one in watched if not isinstance(one, Study)]
    windows = iter(all_fault_windows(asked, [one.timeline for one in asked], cell.observer, sampling))
    return [one if isinstance(one, Study) else _study(cell, one, next(windows)) for one in watched]


def observed_again(cell: Cell, study: Study, sampling: Sampling, *, full: bool) -> Study:
    """The same motion seen by the cameras of another cell; see `study`."""
    timeline = observe(study, cell.observer, sampling, full=full)
    windows = all_fault_windows([study], [timeline], cell.observer, sampling)[0]
    return replace(study, timeline=timeline, windows=windows, onsets=fault_onsets(study, cell.observer))


def _study(cell: Cell, scene: Watched, windows: Mapping[str, Sequence[Window]]) -> Study:
    starts = (pieces.fault_intervals(scene.formulas, fault)[0].start for fault in scene.timeline.faults)
    recovery = recovery_over(scene.motion, cell.model, min(starts, default=scene.motion.time))
    return Study(**vars(scene), recovery=recovery, windows=windows, onsets=fault_onsets(scene, cell.observer))
