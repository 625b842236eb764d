"""What advice is asked about, and what a search for one kind of change answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

from sqrp_cli.cell.workspace import World
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import Goal, Kind
from sqrp_cli.search.moves import ProposedChange
from sqrp_cli.study.assessment import observed_again
from sqrp_cli.study.find import Plans
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.verdict import verdict, without_remedy
from sqrp_cli.study.whole_study import WholeAnalysis, reasons_of_step, worst_seen
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import Candidate

Item = TypeVar("Item")
Result = TypeVar("Result")


class TaskWays(NamedTuple):
    """A task with the ways in which its candidates are done."""

    text: str
    ways: tuple[Candidate, ...]


class Tried(NamedTuple):
    """A change that was tried."""

    change: ProposedChange
    study: WholeAnalysis
    """The way with it."""
    margin: Margin | None = None
    """Of a change that meets the goal; None where there is nothing to measure."""


class Found(NamedTuple):
    """What a search for one kind of change found."""

    met: Sequence[Tried] = ()
    """The changes that meet the goal, one of each target at most."""
    why: str = ""
    """Why there is none."""
    near: Sequence[Tried] = ()
    """What was tried in vain, if that is to be compared."""


def is_fastest(found: CandidateResult) -> bool:
    """Whether the figures of a candidate are those with `--ways fastest`."""
    return found.way.parameters == first_grip(found.candidate).parameters and not found.way.vias


def seen_by(cell: Cell, found: WholeAnalysis, sampling: Sampling, *, full: bool = False) -> WholeAnalysis:
    """The same motion seen by the cameras of another cell. full: with the verdicts of every camera."""
    steps = (observed_again(cell, one, sampling, full=full) for one in found.steps)
    return replace(found, steps=tuple(steps))


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """What is to be met, and what may be changed."""

    task: str
    """As it was asked for."""
    cell: Cell
    world: World
    sampling: Sampling
    fastest: Candidate
    """The candidate as `--ways fastest` has it."""
    best: CandidateResult
    """The candidate by its best way; by the fastest one where the motion is fixed."""
    assessments: Sequence[CandidateResult]
    """Of all candidates of the task, `best` among them."""
    goal: Goal
    aims: Mapping[str, Aim]
    """What cameras look at, by name, where the workspace says so."""
    listed: Callable[[], Sequence[TaskWays]]
    """The tasks that a change of the cell may affect, found out only when they are needed."""
    plans: Plans | None = None
    """The ways of candidates, as far as they are planned."""
    kinds: Sequence[Kind] | None = None
    """What may be changed; None: cameras and objects only where no other motion meets the goal."""
    fixed: bool = False
    """Whether the motion stays as it is."""
    jobs: int = 1
    """Processes to use at most; the answers do not depend on it."""

    def shared(self, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results of some work, in order, by as many processes as may be used."""
        return list(in_processes(work, items, min(self.jobs, len(items))))

    def met_for_sure(self, change: ProposedChange | None, found: WholeAnalysis) -> bool:
        """Whether a way meets the goal, with the samples of `explain`, too: where the verdict of any camera changes.

        change: of the cell in which it is studied, if any.
        """
        cell = self.cell if change is None else change.in_cell(self.cell)
        met = self.goal.met(found.assessment)
        return met and self.goal.met(seen_by(cell, found, self.sampling, full=True).assessment)

    def limit(self, one: Tried) -> str:
        """Which limit stands in the way of a change that does not meet the goal, in a sentence."""
        steps, reached = one.study.steps, one.study.assessment
        if replace(self.goal, time=None).met(reached):
            primitives = [primitive for step in steps for primitive in step.motion.primitives]
            longest = max(primitives, key=lambda primitive: primitive.end - primitive.start)
            return f"its motion takes that long, {longest.end - longest.start:.1f} s of it {longest.name}"
        if replace(self.goal, delay=None).met(reached):
            return reached.why_late
        worst = worst_seen([step.assessment("") for step in steps])
        sentence = verdict(one.change.in_cell(self.cell), steps[worst])
        said = reasons_of_step(one.study.candidate, worst + 1, [sentence])[0]
        return reached.why_late if said.endswith(NOTHING_MISSING) else without_remedy(said)
