"""The curves that moves take the tool frame along: straight lines, arcs, helices."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from sqrp_cli.geometry import Array, read_only
from sqrp_cli.records import dataclass

FLAT = 1e-9
"""Three points whose circle has a radius above 1 / this of their distance are on a line."""


class ToolCurve(Protocol):
    """A smooth curve of the tool frame over s in [0, 1]."""

    @property
    def word(self) -> str:
        """What messages call it, such as `straight line`."""

    @property
    def length(self) -> float:
        """Length of the way of the tool frame's origin [m]."""

    @property
    def turning(self) -> float:
        """Angle of the whole turn of the tool [rad]."""

    @property
    def winding(self) -> float:
        """Angle of a turn or a way round that may come back to where it was [rad]; 0 if it cannot."""

    @property
    def X_end(self) -> Array:
        """Pose X_WT of the tool frame at the end, shape (4, 4)."""

    @property
    def twist(self) -> Array:
        """Velocity and angular velocity at the start, per unit of s, in world axes, shape (6,)."""

    def poses(self, s: Array) -> Array:
        """The poses X_WT at s in [0, 1], shape (m,), shape (m, 4, 4)."""


@dataclass(frozen=True, eq=False)
class ToolLine:
    """A straight line of the tool frame: its origin moves evenly while it turns evenly about one fixed axis (slerp)."""

    word: ClassVar[str] = "straight line"
    winding: ClassVar[float] = 0.0
    X_start: Array
    X_end: Array
    """Poses X_WT of the tool frame in the world, shape (4, 4)."""

    @cached_property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.X_end[:3, 3] - self.X_start[:3, 3]))

    @cached_property
    def turn(self) -> Array:
        """Rotation vector of the whole turn, in world axes [rad], shape (3,)."""
        return rotation_vector(self.X_end[:3, :3] @ self.X_start[:3, :3].T)

    @property
    def turning(self) -> float:
        """Angle of the whole turn [rad]."""
        return float(np.linalg.norm(self.turn))

    @property
    def twist(self) -> Array:
        """Velocity and angular velocity per unit of s, in world axes, shape (6,)."""
        return np.concatenate([self.X_end[:3, 3] - self.X_start[:3, 3], self.turn])

    def until(self, s: float) -> ToolLine:
        """Its beginning up to s."""
        return ToolLine(self.X_start, read_only(self.poses(np.array([s]))[0]))

    def poses(self, s: Array) -> Array:
        """The poses X_WT at s in [0, 1], shape (m,), shape (m, 4, 4)."""
        X_WT = np.tile(self.X_start, (len(s), 1, 1))
        X_WT[:, :3, 3] += s[:, None] * (self.X_end[:3, 3] - self.X_start[:3, 3])
        if self.turn.any():
            X_WT[:, :3, :3] = [rotation_matrix(turn) @ self.X_start[:3, :3] for turn in s[:, None] * self.turn]
        return X_WT


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolHelix:
    """A helix of the tool frame, or an arc: it goes evenly about an axis and along it, and turns evenly."""

    X_start: Array
    """Pose X_WT of the tool frame, shape (4, 4)."""
    point: Array
    """Any point of the axis, shape (3,) [m]."""
    axis: Array
    """Unit vector, shape (3,)."""
    angle: float
    """By how much it goes about the axis, right-handed [rad]."""
    advance: float
    """How far it goes along the axis meanwhile [m]."""
    turn: Array
    """Rotation vector of the tool's turn, in world axes [rad], shape (3,)."""
    word: str = "helix"
    """What messages call it."""

    @cached_property
    def radius(self) -> float:
        """Distance of the tool frame's origin from the axis [m]."""
        return float(np.linalg.norm(np.cross(self.axis, self.X_start[:3, 3] - self.point)))

    @property
    def length(self) -> float:
        """Length of the way [m]."""
        return float(np.hypot(self.radius * self.angle, self.advance))

    @property
    def turning(self) -> float:
        """Angle of the whole turn of the tool [rad]."""
        return float(np.linalg.norm(self.turn))

    @property
    def winding(self) -> float:
        """The greater of the turn and the way round [rad]."""
        return max(abs(self.angle), self.turning)

    @cached_property
    def X_end(self) -> Array:
        """Pose X_WT at the end, shape (4, 4)."""
        return read_only(self.poses(np.array([1.0]))[0])

    @property
    def twist(self) -> Array:
        """Velocity and angular velocity at the start, per unit of s, in world axes, shape (6,)."""
        around = self.angle * np.cross(self.axis, self.X_start[:3, 3] - self.point)
        return np.concatenate([around + self.advance * self.axis, self.turn])

    def poses(self, s: Array) -> Array:
        """The poses X_WT at s in [0, 1], shape (m,), shape (m, 4, 4)."""
        X_WT = np.tile(self.X_start, (len(s), 1, 1))
        arm = self.X_start[:3, 3] - self.point
        for k, share in enumerate(s.tolist()):
            around = rotation_matrix(share * self.angle * self.axis) @ arm
            X_WT[k, :3, 3] = self.point + around + share * self.advance * self.axis
            X_WT[k, :3, :3] = rotation_matrix(share * self.turn) @ self.X_start[:3, :3]
        return X_WT


def arc_through(X_start: Array, through: Array, X_end: Array) -> ToolHelix | ToolLine:
    """The arc from a pose through a point, shape (3,), to another pose; a line if the three points are on one.

    The tool turns evenly about one fixed axis, as on a line (slerp).
    """
    p, q = through - X_start[:3, 3], X_end[:3, 3] - X_start[:3, 3]
    normal = np.cross(p, q)
    size = float(normal @ normal)
    if size <= FLAT * float(p @ p) * float(q @ q):
        return ToolLine(X_start, X_end)
    axis = normal / np.sqrt(size)
    center = X_start[:3, 3] + np.cross((p @ p) * q - (q @ q) * p, normal) / (2.0 * size)
    first, last = X_start[:3, 3] - center, X_end[:3, 3] - center
    angle = float(np.arctan2(axis @ np.cross(first, last), first @ last)) % (2 * np.pi)
    turn = rotation_vector(X_end[:3, :3] @ X_start[:3, :3].T)
    return ToolHelix(X_start=X_start, point=center, axis=axis, angle=angle, advance=0.0, turn=turn, word="arc")


def helix_about(X_WA: Array, X_start: Array, angle: float, advance: float, *, keep_orientation: bool) -> ToolHelix:
    """The helix about the z axis of a pose X_WA, shape (4, 4), from another pose on."""
    axis: Array = X_WA[:3, 2]
    turn = np.zeros(3) if keep_orientation else angle * axis
    return ToolHelix(X_start=X_start, point=X_WA[:3, 3], axis=axis, angle=angle, advance=advance, turn=turn)


def progress(curve: ToolCurve, s: float) -> str:
    """The position s on a curve in words: `34 mm of 100 mm`, or in degrees when the tool only turns."""
    if curve.length > 1e-6:
        return f"{1e3 * s * curve.length:.0f} mm of {1e3 * curve.length:.0f} mm"
    angle = np.degrees(curve.turning)
    return f"{s * angle:.0f} deg of {angle:.0f} deg"


def rotation_vector(R: Array) -> Array:
    """Axis times angle [rad] of a rotation matrix, shape (3,); for half a turn, one of both axes."""
    skew = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.sqrt(skew @ skew)), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if cosine > -0.9:
        return skew * (float(np.arctan2(sine, cosine)) / sine) if sine > 1e-9 else skew
    column = (R + R.T + (1 - np.trace(R)) * np.eye(3))[:, int(np.diag(R).argmax())]
    angle = float(np.copysign(np.arctan2(sine, cosine), skew @ column or 1.0))
    vector: Array = column * (angle / np.linalg.norm(column))
    return vector


def rotation_matrix(vector: Array) -> Array:
    """The rotation matrix of axis times angle [rad], shape (3,) (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    K: Array = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: Array = np.eye(3, dtype=np.float64)
    R += float(np.sin(angle)) * K + float(1.0 - np.cos(angle)) * (K @ K)
    return R
