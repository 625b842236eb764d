"""A cell in MuJoCo: motion, camera images and injected faults.

Images are drawn by several processes, each with a model and an OpenGL context of its own.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.workspace.workspace import Workspace, World
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.platform.processes import Pool, fresh
from sqrp_cli.runtime.cell.interface import ArmReference, CellState
from sqrp_cli.runtime.image import NEEDED, CameraImage

if TYPE_CHECKING:
    from sqrp_cli.runtime.cell.engine import mujoco


Memory: TypeAlias = "ctypes.Array[ctypes.c_uint8]"
"""Memory that processes share."""

MOST_WORKERS = 8
"""More would cost more memory than they save time."""


DRAWN_WITHIN = 120.0
"""A process that takes longer for an image [s] is taken for dead."""


@dataclass(frozen=True, eq=False)
class _Task:
    """An image to draw: of a camera by index, at joint positions (MuJoCo's qpos), at time t [s]."""

    camera: int
    positions: Array
    t: float


class RenderPool:
    """Draws images in processes that start with it and end with `close`. Images do not depend on their number."""

    def __init__(self, model: mujoco.MjModel, cameras: Sequence[Camera], seed: int) -> None:
        """Starts the processes, which get ready while the caller goes on."""
        self._cameras = tuple(cameras)
        self._index = {camera.name: index for index, camera in enumerate(cameras)}
        sizes = [camera.height * camera.width * 3 for camera in cameras]
        self._offsets = np.concatenate([[0], np.cumsum(sizes)]).tolist()
        context = fresh(NEEDED)
        # Memory that has no name, which would outlive processes that are killed.
        self._memory = context.RawArray(ctypes.c_uint8, max(1, self._offsets[-1]))
        count = min(len(os.sched_getaffinity(0)), len(cameras), MOST_WORKERS)
        arguments = (model, self._cameras, seed, self._memory, self._offsets)
        self._pool = Pool[_Task, None](count, context, _drawing, *arguments, deadline=DRAWN_WITHIN)

    def images(self, cameras: Sequence[str], positions: Array, t: float) -> list[NDArray[np.uint8]]:
        """The images of some cameras at joint positions (MuJoCo's qpos) and time t [s], in the order of their names.

        Raises InputError if OpenGL cannot draw.
        """
        tasks = [_Task(self._index[name], positions, t) for name in cameras]
        for _ in self._pool.map(tasks):
            pass
        return [self._slot(task.camera).copy() for task in tasks]

    def close(self) -> None:
        """End the processes, which end by themselves at the latest when the interpreter does."""
        self._pool.close()

    def _slot(self, camera: int) -> NDArray[np.uint8]:
        return _slot(self._memory, self._offsets[camera], self._cameras[camera])


def _slot(memory: Memory, offset: int, camera: Camera) -> NDArray[np.uint8]:
    """Where the image of a camera lies in the shared memory, shape (height, width, 3)."""
    shape = (camera.height, camera.width, 3)
    return np.ndarray(shape, dtype=np.uint8, buffer=memoryview(memory), offset=offset)


def _drawing(
    model: mujoco.MjModel, cameras: Sequence[Camera], seed: int, memory: Memory, offsets: list[int]
) -> Callable[[_Task], None]:
    """What draws images into the shared memory. Raises InputError if OpenGL cannot draw."""
    os.environ["LP_NUM_THREADS"] = "0"  # threads of Mesa's software renderer would get in the other processes' way
    from sqrp_cli.runtime.cell.renderer import Renderer

    renderer = Renderer(model, cameras, seed)

    def draw(task: _Task) -> None:
        renderer.move(task.positions)
        camera = cameras[task.camera]
        _slot(memory, offsets[task.camera], camera)[:] = renderer.image(camera.name, task.t)

    return draw


class SimulatedCell(AbstractContextManager["SimulatedCell"]):
    """A cell in simulated time; a context manager, as it holds processes that draw.

    The same workspace, world, seed and calls give the same bytes again.
    """

    @interrupts_later()  # the bindings of MuJoCo turn KeyboardInterrupt into other errors
    def __init__(self, workspace: Workspace, world: World, seed: int) -> None:
        """The cell at rest in a world, at t = 0; an object of unknown pose is not in it. seed: of the image noise.

        Raises InputError without the extra `sim` or without OpenGL (with the command that installs it), and for a mesh
        that cannot be used or images that are too large.
        """
        from sqrp_cli.runtime.cell.mujoco_model import build_model
        from sqrp_cli.runtime.cell.physics import Physics, placed_objects
        from sqrp_cli.runtime.image import check_simulated

        check_simulated(workspace)
        self._workspace = workspace
        self._model = build_model(workspace, placed_objects(world))
        self._physics = Physics(workspace, world, self._model)
        self._renderers = RenderPool(self._model, tuple(workspace.cameras.values()), seed)

    @interrupts_later()
    def reset(self, world: World) -> None:
        """Start again at t = 0, at rest in a world with the same objects; as a new cell would, but at once."""
        from sqrp_cli.runtime.cell.physics import Physics

        self._physics = Physics(self._workspace, world, self._model)

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self._physics.t

    @interrupts_later()
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

    def __exit__(self, *_: object) -> None:
        self.close()
