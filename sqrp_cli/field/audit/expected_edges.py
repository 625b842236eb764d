"""The edges that a camera should show: where robot and objects end against what is behind them.

The picture that the cell's model would give says which pixels show which body, and how far away it is. A body's outline
in it, smoothed, gives points of its edge to a fraction of a pixel, with their place in the cell and their normals.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, inverse, matrix_to_quaternion, transform
from sqrp_cli.records import dataclass
from sqrp_cli.run.cell.mujoco_model import build_model
from sqrp_cli.run.cell.renderer import PixelSolids, Renderer
from sqrp_cli.run.cell.simulated_cell import placed_objects
from sqrp_cli.run.robot_body import RobotBody

SMOOTHED = 1.5
"""Standard deviation of the blur that makes an outline of pixels a line [pixels]."""
_STRAIGHT = 0.68 / (SMOOTHED * np.sqrt(2.0 * np.pi))
"""Least slope of a blurred outline: less of it has a corner, or another outline nearby."""
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)
TOUCH = 0.005
"""Where depths differ by less than this [m], an object stands on another one: the edge is that of the movable one."""
LOOSE, FIXED = (7e-4, 7e-4, 3e-4, 6e-3), (5e-4, 5e-4, 5e-4, 1e-3)
"""Standard deviations of the places of movable and of fixed objects along the world's axes [m], and of their turn about
the vertical [rad]: objects stand where they should, nearly."""
POINTS = 400
"""Points of the edges in an image, at most."""
STEP = 0.005
"""Time over which speeds are measured [s]."""


@dataclass(frozen=True, eq=False)
class PlannedMoment:
    """Where everything is at some time: joints [rad or m], also `STEP` later, and poses of objects, (4, 4).

    held: the object that moves with the tool.
    """

    joints: Mapping[str, float]
    later: Mapping[str, float]
    X_WO: Mapping[str, Array]
    held: str | None


@dataclass(frozen=True, eq=False)
class ExpectedEdges:
    """n points of the edges in an image.

    points: in the optical frame [m], (n, 3). speeds: how they move in it [m/s], (n, 3). beside: the same points, one
    pixel further along the normal from body to background, (n, 3). body: a number for each body, (n,).
    owner: the number of the object that they are of, -1 for the robot, (n,).
    levers: how points would move in the optical frame if their object turned about the world's vertical [m/rad],
    (n, 3). freedom: standard deviations of the place of their object along the world's axes [m] and of that turn [rad],
    (n, 4). R_CW: the world's axes in the optical frame, (3, 3).
    """

    points: Array
    speeds: Array
    beside: Array
    body: Array
    owner: Array
    levers: Array
    freedom: Array
    R_CW: Array

    def of(self, kept: Mask) -> ExpectedEdges:
        """Some of the points, (n,)."""
        columns = ("points", "speeds", "beside", "body", "owner", "levers", "freedom")
        return replace(self, **{name: getattr(self, name)[kept] for name in columns})


class EdgeRenderer:
    """Gives the edges that cameras should show of a cell."""

    def __init__(self, workspace: Workspace, body: RobotBody, world: World) -> None:
        """world: with the objects that are in the cell. Raises InputError where OpenGL cannot draw."""
        self._body, self._cameras = body, workspace.cameras
        self._model = build_model(workspace, placed_objects(world))
        self._renderer = Renderer(self._model, list(workspace.cameras.values()), 0)
        model = self._model
        self._names = [model.body(index).name for index in range(model.nbody)]
        self._objects = [name in placed_objects(world) for name in self._names]
        self._movable = {
            index for index in range(1, model.nbody) if self._objects[index] and model.body(index).jntnum[0]
        }
        self._rng = np.random.default_rng(0)

    def edges(self, camera: str, X_FC: Array, moment: PlannedMoment) -> ExpectedEdges:
        """The edges in an image of a camera whose pose in its frame is X_FC (4, 4)."""
        X_WL, X_WL_later = (self._body.link_poses(q) for q in (moment.joints, moment.later))
        self._renderer.move(self._positions(moment))
        solids = self._renderer.solids(camera, X_FC)
        # How a part is held is not known well enough to measure by it.
        left_out = self._names.index(moment.held) if moment.held in self._names else 0
        outlines = _outlines(solids, self._objects, self._movable, left_out, self._rng)
        frame = self._cameras[camera].frame
        X_CW, X_CW_later = (inverse(X_FC if frame == WORLD else poses[frame] @ X_FC) for poses in (X_WL, X_WL_later))
        later = np.empty_like(outlines.points)
        for index in np.unique(outlines.body):
            rows, name = outlines.body == index, self._names[index]
            moved = X_WL_later[name] @ inverse(X_WL[name]) if name in X_WL else np.eye(4)
            later[rows] = transform(X_CW_later @ moved @ inverse(X_CW), outlines.points[rows])
        owner = np.where(np.array(self._objects)[outlines.body], outlines.body, -1)
        levers = np.zeros_like(outlines.points)
        for index in np.unique(owner[owner >= 0]):
            rows, X_WO = owner == index, moment.X_WO.get(self._names[index])
            if X_WO is not None:
                arms = outlines.points[rows] - transform(X_CW, X_WO[None, :3, 3])
                levers[rows] = np.cross(X_CW[:3, 2], arms)
        return ExpectedEdges(
            points=outlines.points,
            speeds=(later - outlines.points) / STEP,
            beside=outlines.beside,
            body=outlines.body,
            owner=owner,
            levers=levers,
            freedom=np.where(np.isin(owner, list(self._movable))[:, None], LOOSE, FIXED),
            R_CW=X_CW[:3, :3],
        )

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._renderer.close()

    def _positions(self, moment: PlannedMoment) -> Array:
        """MuJoCo's qpos."""
        tree, model = self._body.tree, self._model
        known = [index for index, joint in enumerate(tree.joints) if joint.name in moment.joints]
        q = np.array([moment.joints[tree.joints[index].name] for index in known])
        found = np.array(model.qpos0, dtype=float)
        for joint, position in zip(tree.joints, tree.driven_by(known, self._body.rest).positions(q), strict=True):
            found[model.joint(joint.name).qposadr[0]] = position
        for name, X_WO in moment.X_WO.items():
            if name in self._names and model.body(name).jntnum[0]:
                at = model.joint(name).qposadr[0]
                x, y, z, w = matrix_to_quaternion(X_WO[:3, :3]).tolist()
                found[at : at + 7] = *X_WO[:3, 3], w, x, y, z
        return found


class _Outline(NamedTuple):
    """n points of outlines, as in `ExpectedEdges`."""

    points: Array
    beside: Array
    body: Array


def _outlines(
    solids: PixelSolids, is_object: list[bool], movable: Collection[int], left_out: int, rng: np.random.Generator
) -> _Outline:
    """Points on the outlines of the robot and of each object; those of the robot are of its links."""
    groups = np.where([True, *is_object[1:]], np.arange(len(is_object)), -1)
    group = groups[solids.body].astype(np.int16)
    there = np.flatnonzero(np.bincount(solids.body.ravel()))
    wanted = [number for number in np.unique(groups[there]).tolist() if number not in (0, left_out)]
    found = [
        one
        for number in wanted
        if (one := _outline(solids, group, number, -TOUCH if number in movable else TOUCH)) is not None
    ]
    if not found:
        return _Outline(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int64))
    most = max(POINTS // len(found), 40)
    kept = [rng.permutation(len(one.body))[:most] for one in found]
    parts = [[column[rows] for column in one] for one, rows in zip(found, kept, strict=True)]
    return _Outline(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _outline(solids: PixelSolids, group: NDArray[np.int16], number: int, nearer: float) -> _Outline | None:
    """Points on the outline of a group of bodies, where it is nearer than what is beside it by a distance [m]."""
    height, width = group.shape
    margin = int(4 * SMOOTHED) + 1
    first_column, first_row, columns, rows = cv2.boundingRect((group == number).astype(np.uint8))
    top, left = max(first_row - margin, 0), max(first_column - margin, 0)
    crop = slice(top, first_row + rows + margin), slice(left, first_column + columns + margin)
    inside, z = group[crop] == number, solids.z[crop]
    share = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), SMOOTHED, borderType=cv2.BORDER_REPLICATE)
    # Outermost pixels of the group next to what is behind it.
    outer = cv2.erode(inside.astype(np.uint8), _CROSS, borderType=cv2.BORDER_REPLICATE) == 0
    nearest_outside = cv2.erode(np.where(inside, np.float32(1e6), z).astype(np.float32), _CROSS)
    edge = outer & inside & (nearest_outside > z + nearer)
    v, u = np.nonzero(edge)
    whole = (v + top >= margin) & (v + top < height - margin) & (u + left >= margin) & (u + left < width - margin)
    v, u = v[whole], u[whole]
    if not len(v):
        return None
    gy, gx = np.gradient(share)
    slope = np.stack([gx[v, u], gy[v, u]], axis=-1)
    steepness = np.linalg.norm(slope, axis=1)
    normal = -slope / np.maximum(steepness, 1e-9)[:, None]
    # How far from pixels along their normals the blurred outline is at one half [pixels], (n,).
    steps = np.arange(-1.0, 2.51, 0.25)
    x, y = ((at[:, None] + steps * normal[:, [axis]]).astype(np.float32) for axis, at in enumerate((u, v)))
    values = cv2.remap(share, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    below = values < 0.5
    first = np.clip(np.argmax(below, axis=1), 1, len(steps) - 1)
    a, b = (values[np.arange(len(u)), index] for index in (first - 1, first))
    crossing = steps[first - 1] + 0.25 * (a - 0.5) / np.maximum(a - b, 1e-6)
    away = np.where(below.any(axis=1) & ~below[:, 0], crossing, np.inf)
    good = (steepness > _STRAIGHT) & (np.abs(away - 0.5) < 1.0)
    v, u, normal, away = v[good], u[good], normal[good], away[good]
    if not len(v):
        return None
    pixel = np.array([solids.x[1] - solids.x[0], solids.y[1] - solids.y[0]])
    plane = np.stack([solids.x[u + left], solids.y[v + top]], axis=-1) + normal * away[:, None] * pixel
    depth = z[v, u][:, None]
    points = np.column_stack([plane * depth, depth])
    beside = np.column_stack([(plane + normal * pixel) * depth, depth])
    return _Outline(points, beside, solids.body[crop][v, u])
