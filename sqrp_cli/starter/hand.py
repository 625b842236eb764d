"""Where a gripper of one or two driven joints grasps, how it opens and closes: told by the shapes of its fingers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import product

import numpy as np

from sqrp_cli.geometry import Array, cross, inverse, pose, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.robot.urdf import UrdfJoint
from sqrp_cli.sight.solids import load_solids

MOST_DRIVEN = 2  # driven joints of a gripper; a hand with more has no single way to close
TIPS = 0.02  # length of the ends of fingers between which an object is gripped [m]
LEAST_GAP = 0.01  # least clear width of open fingers [m]
JAW_GAP = 0.015  # by how much a single jaw opens wider than the object [m]
OPENINGS = 41  # positions between closed and open that are tried


@dataclass(frozen=True, eq=False)
class Grip:
    """How a gripper grasps."""

    open: Mapping[str, float]  # of each driven joint [rad or m]
    closed: Mapping[str, float]
    width: float  # clear width between the open fingers [m]
    X_RT: Array
    """The frame that grasps in the link that carries the fingers: between their tips, z out, y along which they close;
    shape (4, 4)."""
    single: bool = False  # whether one jaw stands still: the frame lies on its face, y to the other one


def driven_joints(joints: Collection[UrdfJoint], carried: Collection[str]) -> list[UrdfJoint]:
    """The joints that drive the fingers on some links, but endless ones; empty if there are none, or more than two."""
    moving = [joint for joint in joints if joint.movable and joint.mimic is None and joint.parent in carried]
    driven = [one for one in moving if np.isfinite([one.lower, one.upper]).all() and one.lower < one.upper]
    return driven if len(driven) <= MOST_DRIVEN else []


def find_grip(cell: Cell, root: str, carried: Collection[str], out: Array, size: float) -> Grip | None:
    """How the fingers of a cell grasp an object of a size [m]; None if nothing closes between them.

    cell: with its fingers `open` at one end of their limits and `closed` at the other. root, carried: the link that
    carries them, and every link on it. out: unit vector in `root` along which they point, shape (3,).

    Which ends are open is told by the shapes: there the tips are furthest apart. Where only one jaw moves, it opens as
    far as the object needs.
    """
    model, driven = cell.model, cell.model.fingers
    solids = load_solids([part for part in model.parts if part.parent in carried])
    best: Grip | None = None
    for ends in product((True, False), repeat=len(driven.joints)):
        first, last = (np.where(side, driven.closed, driven.open) for side in (np.array(ends), ~np.array(ends)))
        q = first + np.linspace(0.0, 1.0, OPENINGS)[:, None] * (last - first)
        home = np.broadcast_to(model.home, (OPENINGS, len(model.home)))
        X_WL = model.link_poses(np.concatenate([home, q], axis=1))
        X_RW = inverse(X_WL[root])
        places = [transform(X_RW @ X_WL[one.part.parent], one.vertices) for one in solids]  # (OPENINGS, V, 3) each
        # The way of each part's end, across `out`, from closed to open.
        ways = [_end(place[-1] - place[0], place[-1] @ out) for place in places]
        ways = [way - out * (way @ out) for way in ways]
        moving = [index for index, way in enumerate(ways) if np.linalg.norm(way) > LEAST_GAP / 4]
        if not moving:
            continue
        lead = max(moving, key=lambda index: float((places[index][-1] @ out).max()))
        y = ways[lead] / np.linalg.norm(ways[lead])
        far = [places[index] for index in moving if ways[index] @ y > 0]
        near = [places[index] for index in moving if ways[index] @ y <= 0]
        single = not near
        near = near or [place for index, place in enumerate(places) if index not in moving]
        if not near:
            continue
        # Of each position: the clear width, and as coordinates along x, y and `out` the middle between the tips.
        x, found = cross(y, out), np.empty((OPENINGS, 4))
        for k in range(OPENINGS):
            sides = [np.concatenate([place[k] for place in side]) for side in (near, far)]
            tips = [float((side @ out).max()) for side in sides]
            one, other = (side[side @ out > min(tips) - TIPS] for side in sides)
            low, high = float((one @ y).max()), float((other @ y).min())
            across = low if single else 0.5 * (low + high)
            middle = max((one @ x).min(), (other @ x).min()) + min((one @ x).max(), (other @ x).max())
            found[k] = high - low, 0.5 * middle, across, max(tips)
        wide = np.flatnonzero(found[:, 0] >= size + JAW_GAP)
        at = int(wide[0]) if single and len(wide) else int(found[:, 0].argmax())
        width = float(found[at, 0])
        if width > max(LEAST_GAP, found[0, 0] + LEAST_GAP / 4, best.width if best else 0.0):
            # The tips reach furthest somewhere on their way to the object, and must not touch what it stands on.
            furthest = found[: at + 1][found[: at + 1, 0] >= min(size, width), 3].max()
            X_RT = pose(np.column_stack([x, y, out]), found[at, 1] * x + found[at, 2] * y + furthest * out)
            opened, closed = (dict(zip(driven.joints, row.tolist(), strict=True)) for row in (q[at], q[0]))
            best = Grip(opened, closed, width, X_RT, single)
    return best


def _end(ways: Array, along: Array) -> Array:
    """The mean way (3,) of the vertices of a part, (V, 3), at the end that is furthest `along`, (V,)."""
    mean: Array = ways[along > along.max() - TIPS].mean(axis=0)
    return mean
