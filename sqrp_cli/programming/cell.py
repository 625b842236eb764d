"""A workspace made ready for computing: robot model, collision scene and cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.workspace import Workspace, World
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision import CollisionScene, finger_positions
from sqrp_cli.programming.motion.fingers import closed_on
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
        objects = [t for t in workspace.objects.values() if t.X_WO is not None or t.X_TO is not None]
        parts = [*model.parts, *(part for thing in objects for part in thing.parts)]
        return cls(
            workspace,
            model,
            CollisionScene(model, objects, workspace.robot.disabled_pairs, workspace.padding),
            Observer(tuple(workspace.cameras.values()), load_solids(parts)),
            seed,
        )

    @property
    def initial_world(self) -> World:
        """The world before any program has run. Raises InputError where the fingers cannot hold what they should."""
        world, model = self.workspace.initial_world, self.model
        if world.held is None or world.X_TO is None:
            return world
        fingers = closed_on(self.collision, world.held, world.X_TO, finger_positions(model, world))
        if isinstance(fingers, str):
            place = self.workspace.places.get(f"objects.{world.held}.pose")
            raise InputError(Problem("not-held", f"`{world.held}` is stated to be held, but {fingers}", place))
        return replace(
            world,
            X_WO={**world.X_WO, world.held: model.tool_pose(model.home) @ world.X_TO},
            joints={**world.joints, **dict(zip(model.fingers.joints, fingers.tolist(), strict=True))},
        )

    def solid_name(self, index: int) -> str:
        """What output calls a solid: its link for the robot's own parts, else the part."""
        part = self.observer.solids[index].part
        of_robot = part.parent in self.model.links and part.parent not in self.model.tool_links
        return part.parent if of_robot else part.name
