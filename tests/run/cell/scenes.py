"""Cells for tests of the simulation: real workspaces with other things, cameras and places in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from sqrp_cli.camera.camera import Camera, DistortionModel
from sqrp_cli.camera.markers import ObjectMarker
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import Array, look_at, pose, read_only
from sqrp_cli.shapes import Box, Part, Shape
from tests.cells import ROOT
from tests.task.robots import robot


@cache
def workspace(folder: str) -> Workspace:
    """A workspace of the repository."""
    return load_workspace(ROOT / folder)


@cache
def empty() -> Workspace:
    """A workspace with next to no robot, which is quickly made ready."""
    tabletop = workspace("workspaces/tabletop")
    return replace(tabletop, robot=robot(Path(__file__).parent / "post.urdf", "tip"), objects={}, cameras={})


def camera(
    name: str = "cam",
    eye: Sequence[float] = (1.0, 0.4, 0.8),
    target: Sequence[float] = (0.3, 0.1, 0.0),
    *,
    size: tuple[int, int] = (640, 480),
    focal: tuple[float, float] = (600.0, 600.0),
    center: tuple[float, float] | None = None,
    lens: tuple[DistortionModel, Sequence[float]] = ("none", ()),
    frame: str = "world",
    X_FC: Array | None = None,
) -> Camera:
    """A camera; `X_FC` counts before `eye` and `target`."""
    cx, cy = center or ((size[0] - 1) / 2, (size[1] - 1) / 2)
    matrix = read_only([[focal[0], 0.0, cx], [0.0, focal[1], cy], [0.0, 0.0, 1.0]])
    X = look_at(eye, target) if X_FC is None else X_FC
    return Camera(
        name=name, width=size[0], height=size[1], matrix=matrix, distortion_model=lens[0],
        distortion=read_only(lens[1]), frame=frame, X_FC=read_only(X), rate=10.0, latency=0.05,
    )  # fmt: skip


def thing(
    name: str,
    position: Sequence[float],
    size: tuple[float, float, float] = (0.04, 0.04, 0.04),
    *,
    color: str | None = "red",
    fixed: bool = False,
    shape: Shape | None = None,
    marker: int | ObjectMarker | None = None,
    rotation: Array | None = None,
) -> SceneObject:
    """A thing made of one part, a box unless `shape` says otherwise."""
    part = Part(name, name, shape or Box(size), read_only(pose()))
    return SceneObject(
        name=name, type="thing", color=color, size=size, pose=read_only(pose(rotation, position)), fixed=fixed,
        marker=ObjectMarker(id=marker) if isinstance(marker, int) else marker, parts=(part,),
    )  # fmt: skip


TABLE = thing("table", (0.0, 0.0, -0.02), (2.0, 2.0, 0.04), color="grey", fixed=True)


def cell(base: Workspace, things: Sequence[SceneObject], cameras: Sequence[Camera] = ()) -> Workspace:
    """A workspace with other things and cameras in it."""
    return replace(
        base,
        objects={item.name: item for item in things},
        cameras={item.name: item for item in cameras} or base.cameras,
    )


def world(base: Workspace, joints: Mapping[str, float] | None = None) -> World:
    """The initial world of a workspace, with some joints elsewhere."""
    initial = base.stated_world
    return replace(initial, joints={**initial.joints, **(joints or {})})


class Quintic:
    """A reference from rest to rest in the shape 10 x^3 - 15 x^4 + 6 x^5, and then at rest."""

    def __init__(self, start: Mapping[str, float], end: Mapping[str, float], begin: float, duration: float) -> None:
        self.joints = tuple(start)
        self._start = np.array([start[name] for name in start])
        self._change = np.array([end.get(name, start[name]) for name in start]) - self._start
        self._begin, self._duration = begin, duration

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        x = np.clip((t[:, None] - self._begin) / self._duration, 0.0, 1.0)
        s = x**3 * (10 - 15 * x + 6 * x**2)
        ds = 30 * x**2 * (1 - x) ** 2 / self._duration
        dds = 60 * x * (1 - x) * (1 - 2 * x) / self._duration**2
        return self._start + s * self._change, ds * self._change, dds * self._change


class Rest(Quintic):
    """A reference that stands still."""

    def __init__(self, joints: Mapping[str, float]) -> None:
        super().__init__(joints, joints, 0.0, 1.0)
