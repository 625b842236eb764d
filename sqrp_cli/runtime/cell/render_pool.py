"""Camera images drawn by several processes, each with a model and an OpenGL context of its own."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, TypeAlias
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.processes import process_context, without_interrupts

if TYPE_CHECKING:
    from sqrp_cli.runtime.cell.engine import mujoco

Memory: TypeAlias = "ctypes.Array[ctypes.c_uint8]"
"""Memory that processes share."""

MOST_WORKERS = 8
"""More would cost more memory than they save time."""


@dataclass(frozen=True)
class _Task:
    """An image to draw: of a camera by index, of the joint positions (None: as before), at time t [s]."""

    camera: int
    positions: Array | None
    t: float


class RenderPool:
    """Draws images in processes that start with it and end with `close`. Images do not depend on their number."""

    def __init__(self, model: mujoco.MjModel, cameras: Sequence[Camera], seed: int) -> None:
        """Starts the processes, which get ready while the caller goes on."""
        self._cameras = tuple(cameras)
        self._index = {camera.name: index for index, camera in enumerate(cameras)}
        sizes = [camera.height * camera.width * 3 for camera in cameras]
        self._offsets = np.concatenate([[0], np.cumsum(sizes)]).tolist()
        self._workers: list[BaseProcess] = []
        self._pipes: list[Connection] = []
        self._end = finalize(self, _end, self._pipes, self._workers)
        self._ready = False
        context = process_context()
        # Memory that has no name, which would outlive processes that are killed.
        self._memory = context.RawArray(ctypes.c_uint8, max(1, self._offsets[-1]))
        with without_interrupts():
            for _ in range(min(len(os.sched_getaffinity(0)), len(cameras), MOST_WORKERS)):
                ours, theirs = context.Pipe()
                self._pipes.append(ours)
                arguments = (theirs, model, self._cameras, seed, self._memory, self._offsets)
                worker = context.Process(target=_draw, args=arguments, daemon=True)
                worker.start()
                theirs.close()
                self._workers.append(worker)

    def images(self, cameras: Sequence[str], positions: Array, t: float) -> list[NDArray[np.uint8]]:
        """The images of some cameras at joint positions (MuJoCo's qpos) and time t [s], in the order of their names.

        Raises InputError if OpenGL cannot draw.
        """
        self._await_ready()
        waiting = [self._index[name] for name in reversed(cameras)]
        informed: set[int] = set()
        busy: dict[Connection, int] = {}

        def give(worker: int) -> None:
            if waiting:
                task = _Task(waiting.pop(), None if worker in informed else positions, t)
                informed.add(worker)
                self._pipes[worker].send(task)
                busy[self._pipes[worker]] = worker

        for worker in range(len(self._pipes)):
            give(worker)
        while busy:
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)  # noqa: S101 - only connections were waited for
                pipe.recv()
                give(busy.pop(pipe))
        return [self._slot(self._index[name]).copy() for name in cameras]

    def close(self) -> None:
        """End the processes; happens by itself at the latest when the interpreter ends."""
        self._end()

    def _await_ready(self) -> None:
        if self._ready:
            return
        for pipe in self._pipes:
            error = pipe.recv()
            if error is not None:
                raise InputError(*error)
        self._ready = True

    def _slot(self, camera: int) -> NDArray[np.uint8]:
        return _slot(self._memory, self._offsets[camera], self._cameras[camera])


def _end(pipes: list[Connection], workers: list[BaseProcess]) -> None:
    for pipe in pipes:
        pipe.close()
    for worker in workers:
        worker.join()


def _slot(memory: Memory, offset: int, camera: Camera) -> NDArray[np.uint8]:
    """Where the image of a camera lies in the shared memory, shape (height, width, 3)."""
    shape = (camera.height, camera.width, 3)
    return np.ndarray(shape, dtype=np.uint8, buffer=memoryview(memory), offset=offset)


def _draw(
    pipe: Connection, model: mujoco.MjModel, cameras: Sequence[Camera], seed: int, memory: Memory, offsets: list[int]
) -> None:
    """What a process does: say whether it can draw, then draw one image after the other until the pipe closes."""
    os.environ["LP_NUM_THREADS"] = "0"  # threads of Mesa's software renderer would get in the other processes' way
    from sqrp_cli.runtime.cell.renderer import Renderer

    with suppress(EOFError, BrokenPipeError):  # the other end is closed
        try:
            renderer = Renderer(model, cameras, seed)
        except InputError as error:
            pipe.send(error.problems)
            return
        pipe.send(None)
        while True:
            task = pipe.recv()
            if task.positions is not None:
                renderer.move(task.positions)
            camera = cameras[task.camera]
            _slot(memory, offsets[task.camera], camera)[:] = renderer.image(camera.name, task.t)
            pipe.send(None)
