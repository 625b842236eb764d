"""The benchmark scene: a UR5 with its collision meshes sweeps past cameras that watch boxes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, look_at, pose, transform
from sqrp_cli.logic.literal import Atom
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Box, Mesh, Part
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.sight_scene import shrink
from sqrp_cli.sight.solids import Solid, load_solids
from sqrp_cli.sight.targets import SoughtBox, Target
from tests.sight.views import make_box, make_camera, make_detector

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"
DETECTOR = make_detector(distance=(0.1, 3.0), min_pixels=8.0)
SIZE = (0.05, 0.05, 0.05)


@dataclass(frozen=True, eq=False)
class BenchmarkScene:
    """States, cameras and boxes; each box is a target of its own that one camera has to see."""

    observer: Observer
    states: SceneStates
    targets: tuple[Target, ...]

    @property
    def boxes(self) -> tuple[SoughtBox, ...]:
        return tuple(box for target in self.targets for box in target.boxes)

    @property
    def triangles(self) -> int:
        return sum(len(solid.triangles) for solid in self.observer.solids)

    def eye(self, camera: int) -> Array:
        """Camera centre in the world, shape (3,)."""
        return self.states.camera_poses(self.observer.cameras[camera])[0, :3, 3]

    def points(self, box: SoughtBox, lattice: Array) -> Array:
        """World points of a box without its skin for `lattice` (n, 3) in [-1, 1]^3, shape (m, n, 3)."""
        half_size, _ = shrink(box.size, box.normal)
        X_WB = np.broadcast_to(self.states.box_poses(box), (self.states.count, 4, 4))
        return transform(X_WB, lattice * half_size)


def make_scene(
    states: int = 160, cameras: int = 6, boxes: int = 3, splits: int = 0, *, fixtures: bool = False
) -> BenchmarkScene:
    """`splits`: how often every triangle of a mesh is cut in four. `fixtures`: with a crate, a post and a thin rail."""
    model = RobotModel.load(load_workspace(TABLETOP).robot)
    shapes = {
        "crate": ((0.22, 0.16, 0.18), (0.62, -0.42, 0.09)),
        "post": ((0.06, 0.06, 0.6), (0.15, 0.6, 0.3)),
        "rail": ((0.5, 0.02, 0.02), (0.4, 0.1, 0.35)),
    }
    parts = [Part(name, WORLD, Box(size), pose(position=place)) for name, (size, place) in shapes.items() if fixtures]
    solids = [_split(solid, splits) for solid in load_solids([*model.parts, *parts])]

    # A sweep over the boxes: each joint goes to and fro about its home position.
    phase = np.linspace(0.0, 2 * np.pi, states)[:, None]
    swing = np.array([1.3, 0.35, 0.45, 0.5, 0.5, 1.0])
    q = model.home + swing * np.sin(phase * np.array([1, 2, 3, 2, 1, 4]) + np.arange(6))
    frames = dict(model.link_poses(q))
    frames = {
        name: X[:1] if np.array_equal(X[0], X[-1]) and np.ptp(X, axis=0).max() == 0 else X for name, X in frames.items()
    }
    frames[WORLD] = pose()[None]
    return BenchmarkScene(
        Observer(tuple(_camera(i, cameras) for i in range(cameras)), tuple(solids)),
        SceneStates(states, frames),
        tuple(_target(i, model.tool_frame) for i in range(boxes)),
    )


def _camera(index: int, count: int) -> Camera:
    angle = 2 * np.pi * index / count + 0.2
    eye = np.array([0.2 + 1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.6 + 0.35 * (index % 3)])
    return make_camera(look_at(eye, (0.25, 0.0, 0.2)), name=f"cam{index}", focal=(520.0, 520.0), far=4.0)


def _target(index: int, tool: str) -> Target:
    """Every third box moves with the tool, the others stand about the table."""
    if index % 3 == 2:
        frame, X_FB = tool, pose(position=(0.02 * (index // 3), 0.0, 0.04))
    else:
        frame, X_FB = WORLD, pose(position=(0.45 - 0.07 * index, 0.25 - 0.11 * index, 0.025))
    return Target(Atom("seen", (f"box{index}",)), 1, (make_box(SIZE, X_FB, frame=frame, detector=DETECTOR),))


def _split(solid: Solid, splits: int) -> Solid:
    if not isinstance(solid.part.shape, Mesh):
        return solid
    corners = solid.vertices[solid.triangles]
    for _ in range(splits):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate(
            [np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    vertices, triangles = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    return replace(solid, vertices=vertices, triangles=triangles)


def lattice(side: int) -> Array:
    """Points of a `side`^3 lattice on the surface of [-1, 1]^3, shape (n, 3); side 2 gives the corners."""
    steps = np.linspace(-1.0, 1.0, side)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[np.abs(points).max(axis=1) == 1.0]
