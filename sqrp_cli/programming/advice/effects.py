"""What a change gains and costs: the figures of every task of a workspace, before and after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.advice.change import CandidateEffect, EffectOnTask, ProposedChange
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, observed_again
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.grips import first_grip
from sqrp_cli.programming.whole_study import WholeStudy, whole_study


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

    def of(self, change: ProposedChange) -> tuple[EffectOnTask, ...]:
        """What a change does to each task."""
        return tuple(
            EffectOnTask(task=task.text, candidates=tuple(self._effect(way, found, change) for way, found in studied))
            for task, studied in zip(self._tasks, self._studied, strict=True)
        )

    @cached_property
    def _tasks(self) -> tuple[TaskWays, ...]:
        return self.listed()

    @cached_property
    def _studied(self) -> list[list[tuple[Candidate, WholeStudy | Infeasible]]]:
        return [
            [(way, whole_study(self.cell, way, self.world, self.sampling, full=False)) for way in task.ways]
            for task in self._tasks
        ]

    def _effect(self, way: Candidate, found: WholeStudy | Infeasible, change: ProposedChange) -> CandidateEffect:
        """Cameras are changed in the same motion; else it is planned again."""
        if change.camera is None:
            after = whole_study(self.cell, way, change.in_world(self.world), self.sampling, full=False)
        elif isinstance(found, WholeStudy):
            after = seen_by(change.in_cell(self.cell), found, self.sampling)
        else:
            after = found
        return CandidateEffect(before=assessed(way, found), after=assessed(way, after))


def assessed(way: Candidate, found: WholeStudy | Infeasible) -> Assessment:
    """The figures of a way, or why it cannot be done."""
    return found.assessment if isinstance(found, WholeStudy) else Assessment.infeasible(way, found.reasons)


def is_fastest(found: Assessment) -> bool:
    """Whether the figures of a candidate are those with `--ways fastest`."""
    first = first_grip(found.candidate)
    return found.way.parameters == first.parameters and not found.way.vias


def seen_by(cell: Cell, found: WholeStudy, sampling: Sampling, *, full: bool = False) -> WholeStudy:
    """The same motion seen by the cameras of another cell. full: with the verdicts of every camera."""
    steps = (observed_again(cell, one, sampling, full=full) for one in found.steps)
    return replace(found, steps=tuple(steps))


def finely_met(wish: Wish, cell: Cell, found: WholeStudy, sampling: Sampling) -> bool:
    """Whether a motion meets a wish with the samples of `explain`, too: where the verdict of any camera changes."""
    return wish.met(seen_by(cell, found, sampling, full=True).assessment)
