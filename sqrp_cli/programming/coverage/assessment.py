"""One candidate from check to quality: preconditions, motion, skill states, coverage and the final figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sqrp_cli.errors import Infeasible, InputError, Problem
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.formula_time import Stretch, merge
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.faults import fault_metrics
from sqrp_cli.programming.coverage.quality import NO_FIGURES, Figures, Qualities, figures_of
from sqrp_cli.programming.coverage.sampling import MAX_SAMPLES, Sampling, sample_count
from sqrp_cli.programming.coverage.stage import Stage
from sqrp_cli.programming.coverage.timeline import Timeline, observe
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.grounding import TargetGrounder, formulas_outside, ground_formulas
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.motion.stop_and_return import Recovery, recovery_over
from sqrp_cli.programming.pieces import GroundFormula, cut_into_pieces, interesting_time, monitored_time
from sqrp_cli.programming.targets import Target
from sqrp_cli.programming.task import Candidate


@dataclass(frozen=True, eq=False)
class Assessment(Figures):
    """What is reported of one candidate."""

    candidate: Candidate
    feasible: bool
    reasons: tuple[str, ...] = ()
    """Why it is infeasible, most useful first."""
    error: float | None = None
    """Bound on the error of Q from bisection, in 0..1."""
    largest_gap: float | None = None
    """Between samples [s]."""
    ways_around: tuple[str, ...] = ()
    """Detours where the direct move is blocked, such as `a1 goes around wall`."""
    outside: tuple[tuple[int, int], ...] = ()
    """The temporal operators that are never checked, see `grounding.formulas_outside`."""
    verdict: str = ""
    """One or two sentences."""
    recalibrated: tuple[Qualities, ...] = ()
    """The qualities for random camera poses, if requested."""

    @classmethod
    def infeasible(cls, candidate: Candidate, reasons: tuple[str, ...], verdict: str = "") -> Assessment:
        """The assessment of a candidate that cannot be done."""
        return cls(candidate, feasible=False, reasons=reasons, verdict=verdict, **vars(NO_FIGURES))

    @property
    def delay_worst(self) -> float | None:
        """The longest time that any fault may remain unnoticed [s]; None without faults."""
        return max((fault.delay_worst for fault in self.faults.values()), default=None)


@dataclass(frozen=True, eq=False)
class Study:
    """A feasible candidate with all data behind its figures."""

    candidate: Candidate
    world: World
    motion: Motion
    formulas: tuple[GroundFormula, ...]
    targets: tuple[Target, ...]
    stage: Stage
    timeline: Timeline
    recovery: Recovery

    def assessment(self, verdict: str) -> Assessment:
        """The figures of the candidate."""
        timeline, time = self.timeline, self.motion.time
        faults = {
            fault: fault_metrics(timeline, fault, fault_intervals(self.formulas, fault), self.recovery, time)
            for fault in timeline.faults
        }
        return Assessment(
            candidate=self.candidate,
            feasible=True,
            **vars(figures_of(timeline, time, faults)),
            error=timeline.transition_error,
            largest_gap=timeline.largest_gap,
            ways_around=self.motion.ways_around,
            outside=formulas_outside(self.candidate, self.motion),
            verdict=verdict,
        )


def study(cell: Cell, candidate: Candidate, world: World, sampling: Sampling, *, full: bool) -> Study | Infeasible:
    """Check, move and observe one candidate that starts in `world`.

    full: with the verdicts of every camera and their causes. Raises InputError for a sampling with too many samples.
    """
    workspace, model = cell.workspace, cell.model
    motion = feasible_motion(cell, candidate, world)
    if isinstance(motion, Infeasible):
        return motion
    if (count := sample_count(sampling, motion)) > MAX_SAMPLES:
        message = f"this sampling asks for {count:,.0f} samples of `{candidate.name}`; the limit is {MAX_SAMPLES:,}"
        raise InputError(
            Problem("too-many-samples", message, mend="leave it out: the default places samples where they matter")
        )
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
    stage = Stage(model, motion, cut_into_pieces(list(spans.values()), formulas), world.X_WO)
    timeline = observe(
        stage,
        cell.observer,
        targets,
        sampling,
        faults=_fault_columns(formulas, targets),
        T=monitored_time(formulas),
        T_eoi=interesting_time(formulas),
        full=full,
    )
    start = min((fault_intervals(formulas, fault)[0].start for fault in timeline.faults), default=motion.time)
    return Study(
        candidate=candidate,
        world=world,
        motion=motion,
        formulas=formulas,
        targets=targets,
        stage=stage,
        timeline=timeline,
        recovery=recovery_over(motion, model, start),
    )


def _fault_columns(formulas: tuple[GroundFormula, ...], targets: tuple[Target, ...]) -> Mapping[str, tuple[int, ...]]:
    columns: dict[str, dict[int, None]] = {}
    index = {target.atom: column for column, target in enumerate(targets)}
    for formula in formulas:
        if formula.fault is not None and formula.operator.literals:
            found = {index[literal.atom]: None for literal in formula.operator.literals}
            columns.setdefault(formula.fault, {}).update(found)
    return {fault: tuple(found) for fault, found in columns.items()}


def fault_intervals(formulas: tuple[GroundFormula, ...], fault: str) -> tuple[Stretch, ...]:
    """When a fault may happen: the union of the intervals of its operators that have literals."""
    return merge(f.operator.stretch for f in formulas if f.fault == fault and f.operator.literals)
