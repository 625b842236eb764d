"""Camera images of a simulation, drawn by several processes, each with a model and an OpenGL context of its own."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array
from sqrp_cli.platform.processes import Pool, fresh
from sqrp_cli.run.image import NEEDED

if TYPE_CHECKING:
    from sqrp_cli.run.cell.mujoco_model import mujoco

Memory: TypeAlias = "ctypes.Array[ctypes.c_uint8]"
"""Memory that processes share."""
Task: TypeAlias = tuple[int, Array, float]
"""An image to draw: of a camera by index, at joint positions (MuJoCo's qpos), at time t [s]."""
MOST_WORKERS = 8
"""More would cost more memory than they save time."""
DRAWN_WITHIN = 120.0
"""A process that takes longer for an image [s] is taken for dead."""


class RenderPool:
    """Draws images in processes that end with its pool. Images do not depend on their number."""

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
        self.pool = Pool[Task, None](count, context, _drawing, *arguments, deadline=DRAWN_WITHIN)
        """The processes, which end by themselves at the latest when the interpreter does."""

    def images(self, cameras: Sequence[str], positions: Array, t: float) -> list[NDArray[np.uint8]]:
        """The images of some cameras at joint positions (MuJoCo's qpos) and time t [s], in the order of their names.

        Raises InputError if OpenGL cannot draw.
        """
        indices = [self._index[name] for name in cameras]
        for _ in self.pool.map([(index, positions, t) for index in indices]):
            pass
        return [_slot(self._memory, self._offsets[index], self._cameras[index]).copy() for index in indices]


def _slot(memory: Memory, offset: int, camera: Camera) -> NDArray[np.uint8]:
    """Where the image of a camera lies in the shared memory, shape (height, width, 3)."""
    shape = (camera.height, camera.width, 3)
    return np.ndarray(shape, dtype=np.uint8, buffer=memoryview(memory), offset=offset)


def _drawing(
    model: mujoco.MjModel, cameras: Sequence[Camera], seed: int, memory: Memory, offsets: list[int]
) -> Callable[[Task], None]:
    """What draws images into the shared memory. Raises InputError if OpenGL cannot draw."""
    os.environ["LP_NUM_THREADS"] = "0"  # threads of Mesa's software renderer would get in the other processes' way
    from sqrp_cli.run.cell.renderer import Renderer

    renderer = Renderer(model, cameras, seed)

    def draw(task: Task) -> None:
        index, positions, t = task
        renderer.move(positions)
        _slot(memory, offsets[index], cameras[index])[:] = renderer.image(cameras[index].name, t)

    return draw
