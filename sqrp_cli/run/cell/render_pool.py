"""Camera images of a simulation, drawn by several processes, each with a model and an OpenGL context of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array
from sqrp_cli.platform.processes import Pool, fresh
from sqrp_cli.run.image import NEEDED, ImageArray

if TYPE_CHECKING:
    from sqrp_cli.run.cell.mujoco_model import mujoco

Task: TypeAlias = tuple[str, Array, float]
"""An image to draw: of a camera by name, at joint positions (MuJoCo's qpos), at time t [s]."""
MOST_WORKERS = 8  # More would cost more memory than they save time
DRAWN_WITHIN = 120.0  # A process that takes longer for an image [s] is taken for dead


def start_drawing(model: mujoco.MjModel, cameras: Sequence[Camera], seed: int) -> Pool[Task, ImageArray]:
    """Start processes that draw images, which get ready while the caller goes on.

    Images do not depend on the number of processes. A task raises InputError if OpenGL cannot draw.
    """
    count = min(len(os.sched_getaffinity(0)), len(cameras), MOST_WORKERS)
    return Pool(count, fresh(NEEDED), _drawing, model, tuple(cameras), seed, deadline=DRAWN_WITHIN)


def _drawing(model: mujoco.MjModel, cameras: Sequence[Camera], seed: int) -> Callable[[Task], ImageArray]:
    """What draws images. Raises InputError if OpenGL cannot draw."""
    os.environ["LP_NUM_THREADS"] = "0"  # threads of Mesa's software renderer would get in the other processes' way
    from sqrp_cli.run.cell.renderer import Renderer

    renderer = Renderer(model, cameras, seed)

    def draw(task: Task) -> ImageArray:
        name, positions, t = task
        renderer.move(positions)
        return renderer.image(name, t)

    return draw
