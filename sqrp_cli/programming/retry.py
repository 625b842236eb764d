"""Planning a step again from where a fault left the cell."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.program.record import Step
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import study
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.coverage.verdict import verdict
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.program_update import make_step
from sqrp_cli.programming.task import Candidate


@dataclass(frozen=True, eq=False)
class StepReplanner:
    """A `program.Replanner` for the steps of one cell."""

    cell: Cell

    def replan(self, step: Step, world: World) -> Step | None:
        """The same skill with the same parameters from `world`; None where that is infeasible."""
        skill = self.cell.workspace.skills[step.skill]
        names = [parameter.name for parameter in skill.action.parameters]
        objects = {name: str(step.parameters[name]) for name in names}
        motion = {name: value for name, value in step.parameters.items() if name not in objects}
        candidate = Candidate(skill, objects, motion, " ".join(objects.values()) or skill.name)
        found = study(self.cell, candidate, world, Adaptive(), full=True)
        if isinstance(found, Infeasible):
            return None
        cameras = tuple(camera.name for camera in self.cell.observer.cameras)
        return make_step(step.task, found, found.assessment(verdict(self.cell, found)), cameras)
