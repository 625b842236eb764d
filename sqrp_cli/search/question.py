"""What advice is asked about, what a search answers, and what a change gains and costs in every task of a workspace."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin, TaskEffect
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import Goal, Kind
from sqrp_cli.search.moves import ProposedChange
from sqrp_cli.study.assessment import observed_again
from sqrp_cli.study.find import Plans
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.verdict import HELP, verdict
from sqrp_cli.study.whole_study import WholeStudy, reasons_of_step, whole_study, worst_seen
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import Candidate


@dataclass(frozen=True, eq=False)
class TaskWays:
    """A task with the ways in which its candidates are done."""

    text: str
    ways: tuple[Candidate, ...]


@dataclass(frozen=True, eq=False)
class Effects:
    """The tasks that a change may affect."""

    cell: Cell
    world: World
    sampling: Sampling
    listed: Callable[[], tuple[TaskWays, ...]]
    """The tasks, found out only when they are needed."""

    def of(self, change: ProposedChange) -> tuple[TaskEffect, ...]:
        """What a change does to each task. Cameras are changed in the same motion; else it is planned again."""
        cell, world, effects = change.in_cell(self.cell), change.in_world(self.world), []
        for task, studied in self._studied:
            pairs = []
            for way, found in studied:
                after = found
                if change.camera is None:
                    after = whole_study(self.cell, way, world, self.sampling, full=False)
                elif isinstance(found, WholeStudy):
                    after = seen_by(cell, found, self.sampling)
                pairs.append((assessed(way, found), assessed(way, after)))
            effects.append(TaskEffect.of(task.text, pairs))
        return tuple(effects)

    @cached_property
    def _studied(self) -> list[tuple[TaskWays, list[tuple[Candidate, WholeStudy | Infeasible]]]]:
        def found(way: Candidate) -> WholeStudy | Infeasible:
            return whole_study(self.cell, way, self.world, self.sampling, full=False)

        return [(task, [(way, found(way)) for way in task.ways]) for task in self.listed()]


def assessed(way: Candidate, found: WholeStudy | Infeasible) -> CandidateResult:
    """The figures of a way, or why it cannot be done."""
    return found.assessment if isinstance(found, WholeStudy) else CandidateResult.infeasible(way, found.reasons)


def is_fastest(found: CandidateResult) -> bool:
    """Whether the figures of a candidate are those with `--ways fastest`."""
    return found.way.parameters == first_grip(found.candidate).parameters and not found.way.vias


def seen_by(cell: Cell, found: WholeStudy, sampling: Sampling, *, full: bool = False) -> WholeStudy:
    """The same motion seen by the cameras of another cell. full: with the verdicts of every camera."""
    steps = (observed_again(cell, one, sampling, full=full) for one in found.steps)
    return replace(found, steps=tuple(steps))


def finely_met(wish: Goal, cell: Cell, found: WholeStudy, sampling: Sampling) -> bool:
    """Whether a motion meets a wish with the samples of `explain`, too: where the verdict of any camera changes."""
    return wish.met(seen_by(cell, found, sampling, full=True).assessment)


Item = TypeVar("Item")
Result = TypeVar("Result")


class Met(NamedTuple):
    """A change that meets the wish."""

    change: ProposedChange
    found: CandidateResult
    """The way with it."""
    margin: Margin | None = None
    """None where there is nothing to measure."""


class Near(NamedTuple):
    """A change that comes near."""

    change: ProposedChange
    study: WholeStudy
    """The way with it."""


class Miss(NamedTuple):
    """A kind of change that does not meet the wish."""

    why: str
    """Why not, or why it was not tried."""
    near: Sequence[Near] = ()
    """What was tried, if that is to be compared."""


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
    wish: Goal
    aims: Mapping[str, Aim]
    """What cameras look at, by name, where the workspace says so."""
    effects: Effects
    """Every task of the workspace."""
    plans: Plans = field(default_factory=Plans)
    """The ways of candidates, as far as they are planned."""
    kinds: Sequence[Kind] | None = None
    """What may be changed; None: cameras and objects only where no other motion meets the wish."""
    fixed: bool = False
    """Whether the motion stays as it is."""
    jobs: int = 1
    """Processes to use at most; the answers do not depend on it."""

    def shared(self, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results of some work, in order, by as many processes as may be used."""
        return list(in_processes(work, items, min(self.jobs, len(items))))

    def limit(self, cell: Cell, found: WholeStudy) -> str:
        """Which limit stands in the way of a way in a cell, in a sentence."""
        if replace(self.wish, time=None).met(found.assessment):
            primitives = [primitive for step in found.steps for primitive in step.motion.primitives]
            longest = max(primitives, key=lambda primitive: primitive.end - primitive.start)
            return f"its motion takes that long, {longest.end - longest.start:.1f} s of it {longest.name}"
        if replace(self.wish, delay=None).met(found.assessment):
            return found.assessment.why_late
        worst = worst_seen([step.assessment("") for step in found.steps])
        said = reasons_of_step(found.candidate, worst + 1, [verdict(cell, found.steps[worst])])[0]
        return found.assessment.why_late if said.endswith(NOTHING_MISSING) else said.split(HELP)[0]
