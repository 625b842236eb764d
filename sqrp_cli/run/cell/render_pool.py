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


def start_drawing(
    model: mujoco.MjModel, cameras: Sequence[Camera], seed: int
) -> tuple[Pool[Task, None], list[NDArray[np.uint8]]]:
    """Start processes that draw images, which get ready while the caller goes on, and end when their pool is closed.

    Returns them with the image of each camera, shape (height, width, 3): what its last task has drawn. Images do not
    depend on the number of processes. A task raises InputError if OpenGL cannot draw.
    """
    context, size = fresh(NEEDED), sum(camera.height * camera.width * 3 for camera in cameras)
    memory = context.RawArray(ctypes.c_uint8, max(1, size))  # without a name, which would outlive killed processes
    count = min(len(os.sched_getaffinity(0)), len(cameras), MOST_WORKERS)
    pool = Pool[Task, None](count, context, _drawing, model, tuple(cameras), seed, memory, deadline=DRAWN_WITHIN)
    return pool, _images(memory, cameras)


def _images(memory: Memory, cameras: Sequence[Camera]) -> list[NDArray[np.uint8]]:
    """Where the image of each camera lies in the shared memory, shape (height, width, 3)."""
    sizes = [(camera.height, camera.width, 3) for camera in cameras]
    offsets = np.cumsum([0, *(height * width * depth for height, width, depth in sizes)]).tolist()
    view = memoryview(memory)
    return [np.ndarray(size, np.uint8, view, offset) for size, offset in zip(sizes, offsets[:-1], strict=True)]


def _drawing(model: mujoco.MjModel, cameras: Sequence[Camera], seed: int, memory: Memory) -> Callable[[Task], None]:
    """What draws images into the shared memory. Raises InputError if OpenGL cannot draw."""
    os.environ["LP_NUM_THREADS"] = "0"  # threads of Mesa's software renderer would get in the other processes' way
    from sqrp_cli.run.cell.renderer import Renderer

    renderer, images = Renderer(model, cameras, seed), _images(memory, cameras)

    def draw(task: Task) -> None:
        index, positions, t = task
        renderer.move(positions)
        images[index][:] = renderer.image(cameras[index].name, t)

    return draw
