"""What can be done, and what has to be done first: a plan for a failing precondition, each step in its best way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import NO_FIGURES
from sqrp_cli.knowledge.workspace.workspace import Workspace, World
from sqrp_cli.logic.domain import merge_domains
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import AlreadySatisfied, GaveUp, Plan, Planner, PlanningResult, ProvenImpossible, find_plan
from sqrp_cli.logic.planning_task import PlanStep
from sqrp_cli.programming.candidate import THEN, Candidate, Task
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import unmet_preconditions
from sqrp_cli.programming.grounding import formulas_outside
from sqrp_cli.programming.pipeline import Assignment, assess_all
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.task import read_task
from sqrp_cli.programming.ways.find import WantedWay, some_motion
from sqrp_cli.programming.ways.grips import first_grip
from sqrp_cli.programming.whole_study import world_left


@dataclass(frozen=True, eq=False)
class SuggestedStep:
    """One step of a suggestion with its best candidate, as `rank` orders them."""

    task: str
    """Its text, such as `place g2 tray`."""
    action: str
    """The same as planners write it."""
    world: World | None
    """The world that it starts from; None if a step before it is infeasible."""
    assessment: CandidateResult | None
    """Of its best candidate, or of the first if none is feasible."""

    @classmethod
    def of(cls, assessment: CandidateResult, world: World) -> SuggestedStep:
        """The step of a candidate assessed in a world."""
        candidate = assessment.candidate
        action = PlanStep(candidate.skill.action.name, tuple(candidate.binding.values()))
        return cls(candidate.task, str(action), world, assessment)

    @property
    def feasible(self) -> bool:
        """Whether it is feasible after the steps before it."""
        return self.assessment is not None and self.assessment.feasible

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is infeasible."""
        return ("a step before it cannot be done",) if self.assessment is None else self.assessment.reasons


@dataclass(frozen=True, eq=False)
class Suggestion:
    """How planning for a candidate's precondition ended, and the plan if there is one."""

    outcome: Literal["satisfied", "plan", "impossible", "gave_up"]
    explanation: str
    """One sentence; empty if the precondition holds already."""
    steps: tuple[SuggestedStep, ...] | None = None
    """The plan."""
    last: SuggestedStep | None = None
    """The candidate itself, after the plan."""

    @property
    def feasible(self) -> bool:
        """Whether every step of a plan is feasible, the candidate itself included."""
        return self.last is not None and self.last.feasible

    @property
    def words(self) -> str:
        """How planning ended; if a step of the plan cannot be done, which one and why."""
        steps = (*(self.steps or ()), *((self.last,) if self.last else ()))
        failing = next((step for step in steps if not step.feasible), None)
        if failing is None:
            return self.explanation
        then = "after that" if failing is self.last else "but"
        return f"{self.explanation}, {then} {failing.task} cannot be done: {'; '.join(failing.reasons)}"


MOST_WITH_FIGURES = 20
"""Of more candidates that need a plan, so many that can be done are compared, and the best is tried in all ways."""


class Suggester:
    """Suggests first steps in one world; results that several candidates share are computed once."""

    def __init__(
        self, cell: Cell, world: World, planner: Planner = find_plan, jobs: int = 1, candidates: int = 1
    ) -> None:
        """planner: finds the plans. jobs: most processes that score the candidates of a step.

        candidates: how many will be asked about; of more than `MOST_WITH_FIGURES`, it is only asked whether they can
        be done, after steps in their ways with `--ways fastest`.
        """
        self.cell = cell
        self.world = world
        self.jobs = jobs
        self._planner = planner
        self._wanted = WantedWay(fastest=candidates > MOST_WITH_FIGURES)
        self._domain = merge_domains([skill.domain for skill in cell.workspace.skills.values()])
        self._plans: dict[tuple[str, ...], PlanningResult] = {}
        self._done: dict[tuple[PlanStep, ...], tuple[SuggestedStep, World | None]] = {}

    def in_best_way(self, suggestions: Sequence[Suggestion]) -> Suggestion | None:
        """Of suggestions that can be done the one whose last step ranks first, each of its steps in its best way."""
        if self._wanted.fastest:  # the first of each plan first
            of_plan: Counter[object] = Counter()
            ordered = []
            for suggestion in suggestions:
                plan = tuple(step.action for step in suggestion.steps or ())
                ordered.append((of_plan[plan], suggestion))
                of_plan[plan] += 1
            ordered.sort(key=lambda pair: pair[0])
            suggestions = [suggestion for _, suggestion in ordered[:MOST_WITH_FIGURES]]
        figures = [self._figures(step) for suggestion in suggestions if (step := suggestion.last) is not None]
        if not figures:
            return None
        first = rank(figures, "q_eoi")[0].candidate
        best = suggestions[next(index for index, one in enumerate(figures) if one.candidate is first)]
        if not self._wanted.fastest or best.last is None or best.last.assessment is None:
            return best
        return Suggester(self.cell, self.world, self._planner, self.jobs).suggest(best.last.assessment.candidate)

    def _figures(self, step: SuggestedStep) -> CandidateResult:
        """The assessment of the last step of a suggestion."""
        assert step.assessment is not None  # noqa: S101 - it can be done
        assert step.world is not None  # noqa: S101
        if not self._wanted.fastest:
            return step.assessment
        return Assignment(cell=self.cell, world=step.world, wanted=self._wanted).assess(step.assessment.candidate)

    def suggest(self, candidate: Candidate) -> Suggestion:
        """Plan with the skills of the workspace to the candidate's precondition, and check every step."""
        if not unmet_preconditions(self.cell, candidate, self.world):
            return Suggestion("satisfied", "")
        match self._plan(candidate):
            case AlreadySatisfied():
                return Suggestion("satisfied", "")
            case Plan(steps):
                done = [self._after(steps[: count + 1]) for count in range(len(steps))]
                listed = ", then ".join(map(str, steps))
                last = self._after_all(candidate, done[-1][1])
                return Suggestion("plan", f"first do {listed}", tuple(step for step, _ in done), last)
            case ProvenImpossible(never):
                parts = " and ".join(f"`{part}`" for part in never) or "all of it together"
                return Suggestion("impossible", f"no sequence of this workspace's skills can establish {parts}")
            case GaveUp(within, why):
                because = f": {why}" if why else ""
                return Suggestion("gave_up", f"no plan was found within {within}, which proves nothing{because}")

    def _plan(self, candidate: Candidate) -> PlanningResult:
        key = (candidate.skill.name, *candidate.binding.values())
        if key not in self._plans:
            goal, types = candidate.skill.action.precondition, self.cell.workspace.types
            self._plans[key] = self._planner(self._domain, types, self.world.facts, goal, candidate.binding)
        return self._plans[key]

    def _after(self, steps: tuple[PlanStep, ...]) -> tuple[SuggestedStep, World | None]:
        """The last of several steps, in the world after those before it, and the world after it."""
        if steps not in self._done:
            world = self._after(steps[:-1])[1] if len(steps) > 1 else self.world
            self._done[steps] = self._in_best_way(steps[-1], world)
        return self._done[steps]

    def _in_best_way(self, step: PlanStep, world: World | None) -> tuple[SuggestedStep, World | None]:
        task = self._task(step)
        if world is None:
            return SuggestedStep(task.text, str(step), None, None), None
        assignment = Assignment(cell=self.cell, world=world, wanted=self._wanted)
        best = rank(tuple(assess_all(assignment, task.candidates, self.jobs)), "q_eoi")[0]
        return SuggestedStep.of(best, world), world_left(self.cell, best, world)

    def _after_all(self, candidate: Candidate, world: World | None) -> SuggestedStep:
        if world is None:
            action = PlanStep(candidate.skill.action.name, tuple(candidate.binding.values()))
            return SuggestedStep(candidate.task, str(action), None, None)
        if self._wanted.fastest:
            motion = some_motion(self.cell, candidate, world)
            reasons = motion.reasons if isinstance(motion, Infeasible) else ()
            possible = CandidateResult(candidate=candidate, feasible=not reasons, reasons=reasons, **vars(NO_FIGURES))
            return SuggestedStep.of(possible, world)
        return SuggestedStep.of(Assignment(cell=self.cell, world=world).assess(candidate), world)

    def _task(self, step: PlanStep) -> Task:
        """The task of a step, with all its candidates."""
        workspace = self.cell.workspace
        task = read_task(_text(step, workspace), workspace)
        return Task(task.candidates[0].task, task.skill, task.candidates)


MOST_PLANNED = 20
"""Most choices of objects for which a plan is sought; the shortest plan counts."""


def with_first_steps(task: Task, workspace: Workspace, facts: frozenset[Atom] | None = None) -> Task:
    """The task, with what has to be done first if the preconditions of none of its candidates hold.

    What that is is found as `check` does. The task stays as it is where nothing is needed or nothing helps. facts: that
    hold before it, by default those of the workspace.
    """
    facts = workspace.state if facts is None else facts
    if task.candidates[0].steps or any(not one.lacks(workspace, facts) for one in task.candidates):
        return task
    plans = sorted(_plans(task, workspace, facts), key=lambda found: len(found[0]))
    if not plans:
        return task
    steps, last = plans[0]
    settings = [word for word in task.text.split()[1:] if "=" in word]
    names = [f"{name}={value}" for name, value in last.binding.items()]
    kept = [word for word in settings if word.split("=", 1)[0] not in last.binding]
    return read_task(THEN.join([*steps, " ".join([last.skill.name, *names, *kept])]), workspace, facts)


def _plans(task: Task, workspace: Workspace, facts: frozenset[Atom]) -> Iterator[tuple[list[str], Candidate]]:
    """Plans for the different choices of objects: the tasks to do first, and the candidate."""
    domain = merge_domains([skill.domain for skill in workspace.skills.values()])
    different = {tuple(one.binding.values()): one for one in reversed(task.candidates)}
    for candidate in list(reversed(different.values()))[:MOST_PLANNED]:
        goal = candidate.skill.action.precondition
        found = find_plan(domain, workspace.types, facts, goal, candidate.binding)
        if isinstance(found, Plan):
            yield [_text(step, workspace) for step in found.steps], candidate


def _text(step: PlanStep, workspace: Workspace) -> str:
    skill = next(skill for skill in workspace.skills.values() if skill.action.name == step.action)
    bound = zip((parameter.name for parameter in skill.action.parameters), step.arguments, strict=True)
    return " ".join([skill.name, *(f"{name}={value}" for name, value in bound)])


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
    remarks: tuple[str, ...] = ()
    """Detours and speeds that are not reached, such as `a1 goes around wall` and `a4 reaches 3.4 of 5 cm/s`."""
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
        remarks=motion.remarks,
        outside=formulas_outside(candidate, motion),
    )


def _check_steps(candidate: Candidate, suggester: Suggester) -> Feasibility:
    """Check a candidate of several steps, each in its way with `--ways fastest` after those before."""
    wanted = WantedWay(fastest=True)
    found = Assignment(cell=suggester.cell, world=suggester.world, wanted=wanted).assess(first_grip(candidate))
    return Feasibility(
        candidate=candidate,
        feasible=found.feasible,
        reasons=found.reasons,
        time=found.time,
        suggestion=Suggestion("satisfied", ""),
        remarks=found.remarks,
    )


def best_suggestion(found: Sequence[Feasibility], suggester: Suggester) -> tuple[SuggestedStep, ...]:
    """The steps to complete a task: its best candidate, or a plan and the best candidate after it.

    Feasible candidates go before those that need a plan. Empty if neither exists.
    """
    now = [feasibility.candidate for feasibility in found if feasibility.feasible]
    if now:
        assignment = Assignment(cell=suggester.cell, world=suggester.world)
        best = rank(tuple(assess_all(assignment, now, suggester.jobs)), "q_eoi")[0]
        done = assignment.steps_done(best.candidate)
        return tuple(SuggestedStep.of(one.assessment, one.before) for one in done) or (
            SuggestedStep.of(best, suggester.world),
        )
    later = [feasibility.suggestion for feasibility in found if feasibility.suggestion.feasible]
    chosen = suggester.in_best_way(later)
    steps = () if chosen is None else (*(chosen.steps or ()), chosen.last)
    return tuple(step for step in steps if step is not None)
