"""A workspace made ready for computing: robot model, collision scene and cameras."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision import CollisionScene
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.solids import load_solids


@dataclass(frozen=True, eq=False)
class Cell:
    """What all candidates of a workspace share; made once. seed: of what planning draws at random."""

    workspace: Workspace
    model: RobotModel
    collision: CollisionScene
    observer: Observer
    seed: int = 0

    @classmethod
    def load(cls, workspace: Workspace, seed: int = 0) -> Cell:
        """Read the robot and every mesh. Raises InputError for a URDF or mesh that cannot be used."""
        model = RobotModel.load(workspace.robot)
        objects = [thing for thing in workspace.objects.values() if thing.X_WO is not None]
        parts = [*model.parts, *(part for thing in objects for part in thing.parts)]
        return cls(
            workspace,
            model,
            CollisionScene(model, objects, workspace.robot.disabled_pairs, workspace.padding),
            Observer(tuple(workspace.cameras.values()), load_solids(parts)),
            seed,
        )

    def solid_name(self, index: int) -> str:
        """What output calls a solid: its link for the robot's own parts, else the part."""
        part = self.observer.solids[index].part
        of_robot = part.parent in self.model.links and part.parent not in self.model.tool_links
        return part.parent if of_robot else part.name
