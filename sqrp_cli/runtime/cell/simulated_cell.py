"""A cell in MuJoCo: motion, camera images and injected faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqrp_cli.knowledge.workspace.workspace import Workspace, World
from sqrp_cli.runtime.cell.interface import ArmReference, CellState
from sqrp_cli.runtime.image import CameraImage


class SimulatedCell:
    """A cell in simulated time; a context manager, as it holds processes that draw.

    The same workspace, world, seed and calls give the same bytes again.
    """

    def __init__(self, workspace: Workspace, world: World, seed: int) -> None:
        """The cell at rest in a world, at t = 0; an object of unknown pose is not in it. seed: of the image noise.

        Raises InputError without the extra `sim` or without OpenGL (with the command that installs it), and for a mesh
        that cannot be used or images that are too large.
        """
        from sqrp_cli.runtime.cell.mujoco_model import build_model
        from sqrp_cli.runtime.cell.physics import Physics, placed_objects
        from sqrp_cli.runtime.cell.render_pool import RenderPool
        from sqrp_cli.runtime.image import check_simulated

        check_simulated(workspace)
        self._workspace = workspace
        self._model = build_model(workspace, placed_objects(world))
        self._physics = Physics(workspace, world, self._model)
        self._renderers = RenderPool(self._model, tuple(workspace.cameras.values()), seed)

    def reset(self, world: World) -> None:
        """Start again at t = 0, at rest in a world with the same objects; as a new cell would, but at once."""
        from sqrp_cli.runtime.cell.physics import Physics

        self._physics = Physics(self._workspace, world, self._model)

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self._physics.t

    def advance(self, t: float, reference: ArmReference) -> float:
        """Let time pass until t [s], and return it, while the controller follows the reference within its torques."""
        self._physics.advance(t, reference)
        return t

    def grasp(self) -> None:
        """Switch suction on, or close the fingers with a force: what is there is held, if anything is.

        Suction takes the object whose surface is within 3 mm of the tool frame's origin, at once. Fingers hold by
        friction, as soon as they have closed, at 5 cm/s.
        """
        self._physics.grasp()

    def tool_force(self) -> float:
        """How hard the tool, or what it holds, pushes against anything else [N], as a force sensor at it would say."""
        return self._physics.tool_force()

    def release(self) -> None:
        """Switch suction off, or let the fingers follow the reference again (which then opens them)."""
        self._physics.release()

    def slip(self) -> None:
        """Lose the hold until the next `release`: the cup leaks, or the fingers get slippery. What was held falls."""
        self._physics.slip()

    def miss_next_grasp(self) -> None:
        """Let the next `grasp` do nothing."""
        self._physics.miss_next_grasp()

    def frames(self, cameras: Sequence[str]) -> Mapping[str, CameraImage]:
        """An image of each camera as all now is, by name in the order given."""
        images = self._renderers.images(cameras, self._physics.positions, self.t)
        return {name: CameraImage(name, self.t, image) for name, image in zip(cameras, images, strict=True)}

    def measured_joints(self, t: float | None = None) -> Mapping[str, float]:  # noqa: ARG002 - it knows no other time
        """Position of every movable joint of robot and tool as its encoder says now [rad or m]."""
        return self._physics.joints()

    def trouble(self) -> None:
        """A simulated robot follows its motion until it is stopped."""

    def truth(self) -> CellState:
        """The present ground truth."""
        physics = self._physics
        return CellState(self.t, physics.object_poses(), physics.held(), physics.joints())

    def tracking_error(self) -> float:
        """Distance of the tool frame from where the reference wanted it [m], root mean square over all steps so far."""
        return float((self._physics.squared_error / max(self._physics.steps, 1)) ** 0.5)

    def close(self) -> None:
        """End the processes that draw."""
        self._renderers.close()

    def __enter__(self) -> SimulatedCell:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
