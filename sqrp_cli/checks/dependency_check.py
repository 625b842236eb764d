"""The dependency check: whether a candidate is feasible, and if not, why, and what must be done first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqrp_cli.errors import Infeasible
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.grounding import formulas_outside
from sqrp_cli.programming.pipeline import Assignment, assess_all
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.suggestion import SuggestedStep, Suggester, Suggestion
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, some_motion
from sqrp_cli.programming.ways.grips import first_grip


@dataclass(frozen=True, eq=False, kw_only=True)
class Feasibility:
    """Whether a candidate is feasible."""

    candidate: Candidate
    feasible: bool
    reasons: tuple[str, ...] = ()
    """Why not, most useful first."""
    time: float | None = None
    """Duration of its motion, with the first grip that works, in the fastest branch [s]; None if infeasible."""
    suggestion: Suggestion
    """How to establish its precondition."""
    ways_around: tuple[str, ...] = ()
    """Detours where the direct move is blocked, such as `a1 goes around wall`."""
    outside: tuple[tuple[int, int], ...] = ()
    """The temporal operators that are never checked, see `grounding.formulas_outside`."""


def check_candidate(candidate: Candidate, suggester: Suggester) -> Feasibility:
    """Check one candidate in the suggester's world: its precondition, and whether the robot can make its motion."""
    if candidate.steps:
        return _check_steps(candidate, suggester)
    suggestion = suggester.suggest(candidate)
    motion = some_motion(suggester.cell, candidate, suggester.world)
    if isinstance(motion, Infeasible):
        return Feasibility(candidate=candidate, feasible=False, reasons=motion.reasons, suggestion=suggestion)
    return Feasibility(
        candidate=candidate,
        feasible=True,
        time=motion.time,
        suggestion=suggestion,
        ways_around=motion.ways_around,
        outside=formulas_outside(candidate, motion),
    )


def _check_steps(candidate: Candidate, suggester: Suggester) -> Feasibility:
    """Check a candidate of several steps, each in its fastest way after those before it."""
    wanted = WantedWay(fastest=True)
    found = Assignment(suggester.cell, suggester.world, Adaptive(), wanted=wanted).assess(first_grip(candidate))
    return Feasibility(
        candidate=candidate,
        feasible=found.feasible,
        reasons=found.reasons,
        time=found.time,
        suggestion=Suggestion("satisfied", ""),
        ways_around=found.ways_around,
    )


def best_suggestion(found: Sequence[Feasibility], suggester: Suggester) -> tuple[SuggestedStep, ...]:
    """The steps to complete a task: its best candidate, or a plan and the best candidate after it.

    Feasible candidates go before those that need a plan. Empty if neither exists.
    """
    now = [feasibility.candidate for feasibility in found if feasibility.feasible]
    if now:
        assignment = Assignment(suggester.cell, suggester.world, Adaptive())
        best = rank(tuple(assess_all(assignment, now, suggester.jobs)), "q_eoi")[0].assessment
        done = assignment.steps_done(best.candidate)
        return tuple(SuggestedStep.of(one.assessment, one.before) for one in done) or (
            SuggestedStep.of(best, suggester.world),
        )
    later = [feasibility.suggestion for feasibility in found if feasibility.suggestion.feasible]
    assessments = [step.assessment for suggestion in later if (step := suggestion.last) and step.assessment]
    if not assessments:
        return ()
    first = rank(assessments, "q_eoi")[0].assessment
    chosen = next(suggestion for suggestion in later if suggestion.last and suggestion.last.assessment is first)
    return tuple(step for step in (*(chosen.steps or ()), chosen.last) if step is not None)
