"""What advice is asked about, and what a search answers: changes that meet the wish, or what comes nearest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.change import Kind, Margin, Miss, ProposedChange
from sqrp_cli.programming.advice.effects import Effects
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.verdict import HELP, NOTHING_MISSING, verdict
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_study import WholeStudy, reasons_of_step, worst_seen

Item = TypeVar("Item")
Result = TypeVar("Result")


class Met(NamedTuple):
    """A change that meets the wish."""

    change: ProposedChange
    found: Assessment
    """The way with it."""


class Near(NamedTuple):
    """A change that comes near."""

    change: ProposedChange
    study: WholeStudy
    """The way with it."""


class Found(NamedTuple):
    """What a search finds about one way, object or camera."""

    met: Met
    margin: Margin | None = None


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
    best: Assessment
    """The candidate by its best way; by the fastest one where the motion is fixed."""
    assessments: Sequence[Assessment]
    """Of all candidates of the task, `best` among them."""
    wish: Wish
    aims: Mapping[str, Aim]
    """What cameras look at, by name, where the workspace says so."""
    effects: Effects
    """Every task of the workspace."""
    kinds: Sequence[Kind] | None = None
    """What may be changed; None: cameras and objects only where no other motion meets the wish."""
    fixed: bool = False
    """Whether the motion stays as it is."""
    jobs: int = 1
    """Processes to use at most; the answers do not depend on it."""

    def shared(self, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results of some work, in order, by as many processes as may be used."""
        return list(in_processes(work, items, min(self.jobs, len(items))))

    def nearest(self, kind: Kind, why: str, near: Sequence[Near]) -> Miss:
        """Why none of several changes meets the wish, and which comes nearest."""
        best = min(near, key=lambda one: self.wish.shortfall(one.study.assessment))
        limit = self._limit(best.change.in_cell(self.cell), best.study)
        return Miss(kind=kind, why=why, nearest=best.change, found=best.study.assessment, limit=limit)

    def _limit(self, cell: Cell, found: WholeStudy) -> str:
        """Which limit stands in the way of a way in a cell, in a sentence."""
        if replace(self.wish, time=None).met(found.assessment):
            primitives = [primitive for step in found.steps for primitive in step.motion.primitives]
            longest = max(primitives, key=lambda primitive: primitive.end - primitive.start)
            return f"its motion takes that long, {longest.end - longest.start:.1f} s of it {longest.name}"
        worst = worst_seen([step.assessment("") for step in found.steps])
        said = reasons_of_step(found.candidate, worst + 1, [verdict(cell, found.steps[worst])])[0]
        return found.assessment.why_late if said.endswith(NOTHING_MISSING) else said.split(HELP)[0]
