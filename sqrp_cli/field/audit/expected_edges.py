"""The edges that a camera should show: where robot and objects end against what is behind them.

The picture that the cell's model would give says which pixels show which body, and how far away it is. A body's outline
in it, smoothed, gives points of its edge to a fraction of a pixel, with their place in the cell and their normals.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.audit.bag_footage import Footage
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Indices, inverse, matrix_to_quaternion, transform
from sqrp_cli.program.record import Program
from sqrp_cli.run.cell.mujoco_model import build_model
from sqrp_cli.run.cell.renderer import PixelSolids, Renderer
from sqrp_cli.run.cell.simulated_cell import placed_objects
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.robot_body import RobotBody

SMOOTHED = 1.5  # Standard deviation of the blur that makes an outline of pixels a line [pixels]
_STRAIGHT = 0.68 / (SMOOTHED * np.sqrt(2.0 * np.pi))
"""Least slope of a blurred outline: less of it has a corner, or another outline nearby."""
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)
TOUCH = 0.005
"""Where depths differ by less than this [m], an object stands on another one: the edge is that of the movable one."""
LOOSE, FIXED = (7e-4, 7e-4, 3e-4, 6e-3), (5e-4, 5e-4, 5e-4, 1e-3)
"""Standard deviations of the places of movable and of fixed objects along the world's axes [m], and of their turn about
the vertical [rad]: objects stand where they should, nearly."""
POINTS = 400  # Points of the edges in an image, at most
STEP = 0.005  # Time over which speeds are measured [s]
ExpectedEdges: TypeAlias = Mapping[str, Array]
"""n points of the edges in an image, by what is known of them.

points: in the optical frame [m], (n, 3). speeds: how they move in it [m/s], (n, 3). beside: the same points, one pixel
further along the normal from body to background, (n, 3). body: a number for each body, (n,). owner: the number of the
object that they are of, -1 for the robot, (n,). levers: how points would move in the optical frame if their object
turned about the world's vertical [m/rad], (n, 3). freedom: standard deviations of the place of their object along the
world's axes [m] and of that turn [rad], (n, 4). R_CW: the world's axes in the optical frame, (n, 3, 3).
"""


class EdgeRenderer:
    """Gives the edges that cameras should show while a program runs."""

    def __init__(self, program: Program, workspace: Workspace, footage: Footage) -> None:
        """footage: where the robot was. Raises InputError where OpenGL cannot draw."""
        self.body, self._footage, self._program = RobotBody.load(workspace.robot), footage, program
        self._cameras, objects = workspace.cameras, placed_objects(program.steps[0].before)
        self._model = model = build_model(workspace, objects)
        self._renderer = Renderer(model, list(workspace.cameras.values()), 0)
        self.close = self._renderer.close
        self._names = [model.body(index).name for index in range(model.nbody)]
        self._objects = np.array([name in objects for name in self._names])
        self._movable = [index for index in range(1, model.nbody) if self._objects[index] and model.body(index).jntnum]
        self._rng = np.random.default_rng(0)
        self._nominal = [NominalStep(step, program.joints, self.body) for step in program.steps]
        ends = [start + step.time for start, step in zip(footage.starts, program.steps, strict=True)]
        self.spans = list(zip(footage.starts, ends, strict=True))
        """When each step begins and ends, by the robot's clock [s]."""

    def edges(self, camera: str, X_FC: Array, t: float) -> ExpectedEdges | None:
        """The edges in an image of a camera whose pose in its frame is X_FC (4, 4), at time t of the robot's clock [s].

        None for a time at which it does not do as planned. An object that moves with the tool has none: how it is held
        is not known well enough to measure by it.
        """
        index = next((i for i, (start, end) in enumerate(self.spans) if start <= t <= end), None)
        if index is None or not self._footage.as_planned(np.array([t]))[0]:
            return None
        tau = t - self.spans[index][0]
        known = self._footage.joints(np.array([t, t + STEP]))
        joints = [{name: float(q[i]) for name, q in known.items()} for i in (0, 1)]
        X_WO = self._nominal[index].object_poses(tau)
        held = next((p.held for p in self._program.steps[index].primitives if tau <= p.end), None)
        X_WL, X_WL_later = (self.body.link_poses(q) for q in joints)
        self._renderer.move(self._positions(joints[0], X_WO))
        # Points on the outlines of the robot's links and of each object but a held one.
        solids = self._renderer.solids(camera, X_FC)
        groups = np.where([True, *self._objects[1:]], np.arange(len(self._objects)), -1)
        group = groups[solids.body].astype(np.int16)
        there = np.flatnonzero(np.bincount(solids.body.ravel()))
        left_out = (0, self._names.index(held) if held in self._names else 0)
        wanted = [number for number in np.unique(groups[there]).tolist() if number not in left_out]
        outlines = (_outline(solids, group, one, -TOUCH if one in self._movable else TOUCH) for one in wanted)
        found = [one for one in outlines if one is not None]
        kept = [self._rng.permutation(len(one[2]))[: max(POINTS // len(found), 40)] for one in found]
        chosen = [[column[rows] for column in one] for one, rows in zip(found, kept, strict=True)]
        nothing = (np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int64))
        points, beside, body = map(np.concatenate, zip(nothing, *chosen, strict=True))
        frame = self._cameras[camera].frame
        X_CW, X_CW_later = (inverse(X_FC if frame == WORLD else poses[frame] @ X_FC) for poses in (X_WL, X_WL_later))
        later, levers = np.empty_like(points), np.zeros_like(points)
        owner = np.where(self._objects[body], body, -1)
        for index in np.unique(body):
            rows, name = body == index, self._names[index]
            moved = X_WL_later[name] @ inverse(X_WL[name]) if name in X_WL else np.eye(4)
            later[rows] = transform(X_CW_later @ moved @ inverse(X_CW), points[rows])
            if self._objects[index] and name in X_WO:
                arms = points[rows] - transform(X_CW, X_WO[name][None, :3, 3])
                levers[rows] = np.cross(X_CW[:3, 2], arms)
        return {
            "points": points,
            "speeds": (later - points) / STEP,
            "beside": beside,
            "body": body,
            "owner": owner,
            "levers": levers,
            "freedom": np.where(np.isin(owner, self._movable)[:, None], LOOSE, FIXED),
            "R_CW": np.tile(X_CW[:3, :3], (len(points), 1, 1)),
        }

    def _positions(self, joints: Mapping[str, float], X_WO: Mapping[str, Array]) -> Array:
        """MuJoCo's qpos."""
        tree, model = self.body.tree, self._model
        known = [index for index, joint in enumerate(tree.joints) if joint.name in joints]
        q = np.array([joints[tree.joints[index].name] for index in known])
        found = np.array(model.qpos0, dtype=float)
        for joint, position in zip(tree.joints, tree.driven_by(known, self.body.rest).positions(q), strict=True):
            found[model.joint(joint.name).qposadr[0]] = position
        for name, X in X_WO.items():
            if name in self._names and model.body(name).jntnum[0]:
                at = model.joint(name).qposadr[0]
                x, y, z, w = matrix_to_quaternion(X[:3, :3]).tolist()
                found[at : at + 7] = *X[:3, 3], w, x, y, z
        return found


Outline = tuple[Array, Array, Indices]
"""n points of outlines as in `ExpectedEdges`: themselves, those beside them, and their bodies."""


def _outline(solids: PixelSolids, group: NDArray[np.int16], number: int, nearer: float) -> Outline | None:
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
    return points, beside, solids.body[crop][v, u]
