"""Planning a step again while a program runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sqrp_cli.knowledge.workspace.workspace import Workspace, World
    from sqrp_cli.program.record import Step
    from sqrp_cli.programming.program_update import StepReplanner


class LazyReplanner:
    """A replanner that loads what planning needs when a step has to be planned again."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._planner: StepReplanner | None = None

    def replan(self, step: Step, world: World) -> Step | None:
        """As `program.Replanner` says."""
        from sqrp_cli.programming.cell import Cell
        from sqrp_cli.programming.program_update import StepReplanner

        if self._planner is None:
            self._planner = StepReplanner(Cell.load(self._workspace))
        return self._planner.replan(step, world)
