"""A way of doing a task with all data behind its figures, step by step; most tasks have one step."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, study
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.program_update import world_after
from sqrp_cli.programming.whole_assessment import assessment_of_all, reasons_of_step


@dataclass(frozen=True, eq=False)
class WholeStudy:
    """A feasible way with the study of each of its steps, in the world that those before it leave."""

    candidate: Candidate
    """The way, of one step or several."""
    steps: tuple[Study, ...]
    """At least one."""

    @property
    def assessment(self) -> Assessment:
        """The figures of the whole, without a sentence."""
        each = [step.assessment("") for step in self.steps]
        return assessment_of_all(self.candidate, each) if self.candidate.steps else each[0]


def whole_study(cell: Cell, way: Candidate, world: World, sampling: Sampling, *, full: bool) -> WholeStudy | Infeasible:
    """Study a way that starts in `world`, of one step or several; see `study`."""
    done: list[Study] = []
    for step in way.steps or (way,):
        found = study(cell, step, world, sampling, full=full)
        if isinstance(found, Infeasible):
            return Infeasible(reasons_of_step(way, len(done) + 1, found.reasons), found.tried)
        done.append(found)
        if len(done) < len(way.steps):
            world = world_after(step, found.motion, world)
    return WholeStudy(way, tuple(done))
