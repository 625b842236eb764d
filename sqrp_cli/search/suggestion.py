"""What can be done, and what has to be done first: a plan for a failing precondition, each step in its best way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Literal

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import NO_FIGURES
from sqrp_cli.files.entries import from_fields
from sqrp_cli.logic.domain import Domain, merge_domains
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import Planner, PlanningResult, ProvenImpossible, find_plan
from sqrp_cli.logic.planning_task import GaveUp, PlanStep
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.recorded_motion import RecordedMotions, limits_broken
from sqrp_cli.records import dataclass
from sqrp_cli.search.planned_step import CheckedCandidate, PlannedStep
from sqrp_cli.study.find import WantedWay, some_motion
from sqrp_cli.study.pipeline import RankJob, assess_all
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_analysis import world_left
from sqrp_cli.task.candidate import THEN, Candidate, Task
from sqrp_cli.task.feasibility import unmet_preconditions
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.grounding import formulas_outside
from sqrp_cli.task.task import read_task


@dataclass(frozen=True, eq=False)
class Suggestion:
    """How planning for a candidate's precondition ended, and the plan if there is one."""

    planning: Literal["satisfied", "plan", "impossible", "gave_up"]
    explanation: str  # one sentence; empty if the precondition holds already
    plan: list[PlannedStep] | None = None
    last: PlannedStep | None = None  # the candidate itself, after the plan; if it is feasible, every step is

    @property
    def advice(self) -> str:
        """How planning ended; if a step of the plan cannot be done, which one and why."""
        failing = next((step for step in (*(self.plan or ()), self.last) if step and not step.feasible), None)
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
        be done, after steps in their ways with `--ways first`.
        """
        self.cell, self.world, self.jobs, self.planner = cell, world, jobs, planner
        self.wanted = WantedWay(fastest=candidates > MOST_WITH_FIGURES)
        self._plans: dict[tuple[str, ...], PlanningResult] = {}
        self._done: dict[tuple[PlanStep, ...], tuple[PlannedStep, World | None]] = {}

    @cached_property
    def _domain(self) -> Domain:
        return merge_domains([skill.domain for skill in self.cell.workspace.skills.values()])

    def suggest(self, candidate: Candidate) -> Suggestion:
        """Plan with the skills of the workspace to the candidate's precondition, and check every step."""
        if not unmet_preconditions(self.cell, candidate, self.world):
            return Suggestion("satisfied", "")
        key = (candidate.skill.name, *candidate.binding.values())
        if key not in self._plans:
            goal, types = candidate.skill.action.precondition, self.cell.workspace.types
            self._plans[key] = self.planner(self._domain, types, self.world.facts, goal, candidate.binding)
        match self._plans[key]:
            case ():
                return Suggestion("satisfied", "")
            case tuple(steps):
                done = [self._after(steps[: count + 1]) for count in range(len(steps))]
                world, result = done[-1][1], None
                if world is not None and self.wanted.fastest:  # only whether it can be done
                    motion = some_motion(self.cell, candidate, world)
                    reasons = motion.reasons if isinstance(motion, Infeasible) else ()
                    result = replace(CandidateResult.infeasible(candidate, reasons), feasible=not reasons)
                elif world is not None:
                    result = RankJob(cell=self.cell, world=world).assess(candidate)
                first = f"first do {', then '.join(map(str, steps))}"
                last = _planned(candidate, world, result)
                return Suggestion("plan", first, [step for step, _ in done], last)
            case ProvenImpossible(never):
                parts = " and ".join(f"`{part}`" for part in never) or "all of it together"
                return Suggestion("impossible", f"no sequence of this workspace's skills can establish {parts}")
            case GaveUp(within, why):
                because = f": {why}" if why else ""
                return Suggestion("gave_up", f"no plan was found within {within}, which proves nothing{because}")

    def _after(self, steps: tuple[PlanStep, ...]) -> tuple[PlannedStep, World | None]:
        """The last of several steps, in its best way in the world after those before it, and the world after it."""
        if steps not in self._done:
            world = self._after(steps[:-1])[1] if len(steps) > 1 else self.world
            candidates = read_task(_text(steps[-1], self.cell.workspace), self.cell.workspace).candidates
            if world is None:
                self._done[steps] = _planned(candidates[0], None, None), None
            else:
                job = RankJob(cell=self.cell, world=world, wanted=self.wanted)
                best = rank(tuple(assess_all(job, candidates, self.jobs)), "q_eoi")[0]
                step = _planned(best.candidate, world, best)
                self._done[steps] = step, world_left(self.cell, best, world)
        return self._done[steps]


MOST_PLANNED = 20  # Most choices of objects for which a plan is sought; the shortest plan counts


def with_first_steps(task: Task, workspace: Workspace, facts: frozenset[Atom] | None = None) -> Task:
    """The task, with what has to be done first if the preconditions of none of its candidates hold.

    What that is is found as `check` does. The task stays as it is where nothing is needed or nothing helps. facts: that
    hold before it, by default those of the workspace.
    """
    facts = workspace.state if facts is None else facts
    if task.candidates[0].steps or any(not one.lacks(workspace, facts) for one in task.candidates):
        return task
    domain = merge_domains([skill.domain for skill in workspace.skills.values()])
    different = {tuple(one.binding.values()): one for one in reversed(task.candidates)}
    plans: list[tuple[list[str], Candidate]] = []
    for candidate in list(reversed(different.values()))[:MOST_PLANNED]:
        goal = candidate.skill.action.precondition
        found = find_plan(domain, workspace.types, facts, goal, candidate.binding)
        if isinstance(found, tuple) and found:
            plans.append(([_text(step, workspace) for step in found], candidate))
    if not plans:
        return task
    steps, last = min(plans, key=lambda plan: len(plan[0]))
    settings = [word for word in task.text.split()[1:] if "=" in word]
    names = [f"{name}={value}" for name, value in last.binding.items()]
    kept = [word for word in settings if word.split("=", 1)[0] not in last.binding]
    return read_task(THEN.join([*steps, " ".join([last.skill.name, *names, *kept])]), workspace, facts)


def _planned(candidate: Candidate, world: World | None, found: CandidateResult | None) -> PlannedStep:
    """The step of a candidate, assessed in a world; neither is there after a step that cannot be done."""
    return from_fields(
        PlannedStep,
        found or NO_FIGURES,
        task=candidate.task,
        action=str(PlanStep(candidate.skill.action.name, tuple(candidate.binding.values()))),
        feasible=found is not None and found.feasible,
        reasons=["a step before it cannot be done"] if found is None else list(found.reasons),
        world=world,
        result=found,
    )


def _text(step: PlanStep, workspace: Workspace) -> str:
    skill = next(skill for skill in workspace.skills.values() if skill.action.name == step.action)
    bound = zip((parameter.name for parameter in skill.action.parameters), step.arguments, strict=True)
    return " ".join([skill.name, *(f"{name}={value}" for name, value in bound)])


def check_candidate(candidate: Candidate, suggester: Suggester) -> CheckedCandidate:
    """Check one candidate in the suggester's world: its precondition, and whether the robot can make its motion.

    Its time is that of the first grip that works, in the fastest branch.
    """
    suggestion, outside = Suggestion("satisfied", ""), list[tuple[int, int]]()
    found: CandidateResult | Motion | Infeasible
    if candidate.steps:  # each in its way with `--ways first` after those before
        job = RankJob(cell=suggester.cell, world=suggester.world, wanted=WantedWay(fastest=True))
        found = job.assess(first_grip(candidate))
    else:
        suggestion, found = suggester.suggest(candidate), some_motion(suggester.cell, candidate, suggester.world)
        if isinstance(recorded := candidate.skill.recorded, RecordedMotions) and isinstance(found, Motion):
            broken = tuple(limits_broken(found, suggester.cell.collision, recorded.task.objects))
            found = Infeasible((*broken, *found.doubts)) if broken else found
        outside += [] if isinstance(found, Infeasible) else formulas_outside(candidate, found)
    reasons = () if isinstance(found, Motion) else found.reasons
    time, remarks = (None, ()) if isinstance(found, Infeasible) else (found.time, found.remarks)
    return from_fields(
        CheckedCandidate,
        candidate,
        suggestion,
        feasible=not reasons,
        reasons=list(map(candidate.skill.in_pieces, reasons)),
        time=time,
        objects=dict(candidate.binding),
        remarks=tuple(map(candidate.skill.in_pieces, remarks)),
        candidate=candidate,
        outside=tuple(outside),
    )


def best_suggestion(found: Sequence[CheckedCandidate], suggester: Suggester) -> tuple[PlannedStep, ...]:
    """The steps to complete a task: its best candidate, or a plan and the best candidate after it.

    Feasible candidates go before those that need a plan. Empty if neither exists.
    """
    now = [one.candidate for one in found if one.feasible]
    if now:
        job = RankJob(cell=suggester.cell, world=suggester.world)
        best = rank(tuple(assess_all(job, now, suggester.jobs)), "q_eoi")[0]
        done = job.steps_done(best.candidate) or [(best, suggester.world)]
        return tuple(_planned(one.candidate, world, one) for one, world in done)
    suggestions = [one for one in found if one.last and one.last.feasible]
    fastest = suggester.wanted.fastest  # of many candidates: few are compared, the first of each plan first
    if fastest:
        of_plan, numbered = Counter[object](), list[tuple[int, CheckedCandidate]]()
        for suggestion in suggestions:
            actions = tuple(step.action for step in suggestion.plan or ())
            numbered.append((of_plan[actions], suggestion))
            of_plan[actions] += 1
        numbered.sort(key=lambda pair: pair[0])
        suggestions = [suggestion for _, suggestion in numbered[:MOST_WITH_FIGURES]]
    compared = list[tuple[CandidateResult, CheckedCandidate]]()
    for one in suggestions:
        if one.last and one.last.result and one.last.world:
            job = RankJob(cell=suggester.cell, world=one.last.world, wanted=suggester.wanted)
            compared.append((job.assess(one.candidate) if fastest else one.last.result, one))
    if not compared:
        return ()
    first = rank([result for result, _ in compared], "q_eoi")[0].candidate
    chosen = next(one for result, one in compared if result.candidate is first)
    plan, last = chosen.plan, chosen.last
    if fastest:  # each step in its best way
        alone = Suggester(suggester.cell, suggester.world, suggester.planner, suggester.jobs).suggest(chosen.candidate)
        plan, last = alone.plan, alone.last
    return tuple(step for step in (*(plan or ()), last) if step is not None)
