"""The curves that moves take the tool frame along: straight lines, arcs, helices."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from sqrp_cli.geometry import Array, displacement, pose
from sqrp_cli.records import dataclass

FLAT = 1e-9  # three points whose circle has a radius above 1 / this of their distance are on a line


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolCurve:
    """A smooth curve of the tool frame over s in [0, 1], on which it turns evenly about one fixed axis (slerp).

    Its origin goes evenly along a straight line, and about an axis: a line has only the first, an arc the second, a
    helix both.
    """

    word: str  # what messages call it, such as `straight line`
    X_start: Array
    X_end: Array
    """Poses X_WT of the tool frame, shape (4, 4)."""
    along: Array  # how far its origin goes along a straight line [m], shape (3,)
    turn: Array  # rotation vector of the tool's turn, in world axes [rad], shape (3,)
    around: Array = field(default_factory=lambda: np.zeros(3))
    """Rotation vector of the way about the axis [rad], shape (3,)."""
    arm: Array = field(default_factory=lambda: np.zeros(3))
    """From a point of the axis to where its origin begins [m], shape (3,)."""

    @property
    def length(self) -> float:
        """Length of the way of its origin [m]."""
        return float(np.hypot(np.linalg.norm(np.cross(self.around, self.arm)), np.linalg.norm(self.along)))

    @property
    def turning(self) -> float:
        """Angle of the whole turn of the tool [rad]."""
        return float(np.linalg.norm(self.turn))

    @property
    def winding(self) -> float:
        """The greater of the turn and the way about the axis [rad]; 0 for a line, which never comes back."""
        angle = float(np.linalg.norm(self.around))
        return max(angle, self.turning) if angle > 0.0 else 0.0

    @property
    def twist(self) -> Array:
        """Velocity and angular velocity at the start, per unit of s, in world axes, shape (6,)."""
        return np.concatenate([np.cross(self.around, self.arm) + self.along, self.turn])

    def poses(self, s: Array) -> Array:
        """The poses X_WT at s in [0, 1], shape (m,), shape (m, 4, 4)."""
        X_WT = np.tile(self.X_start, (len(s), 1, 1))
        X_WT[:, :3, 3] += s[:, None] * self.along
        for k, share in enumerate(s.tolist() if self.turn.any() or self.around.any() else ()):
            about = displacement(np.zeros(3), share * self.around)[:3, :3] @ self.arm
            X_WT[k, :3, 3] += about - self.arm
            X_WT[k, :3, :3] = displacement(np.zeros(3), share * self.turn)[:3, :3] @ self.X_start[:3, :3]
        return X_WT


def tool_line(X_start: Array, X_end: Array) -> ToolCurve:
    """The straight line between two poses X_WT, shape (4, 4)."""
    along, turn = X_end[:3, 3] - X_start[:3, 3], rotation_vector(X_end[:3, :3] @ X_start[:3, :3].T)
    return ToolCurve(word="straight line", X_start=X_start, X_end=X_end, along=along, turn=turn)


def arc_through(X_start: Array, through: Array, X_end: Array) -> ToolCurve:
    """The arc from a pose through a point, shape (3,), to another pose; a line if the three points are on one."""
    p, q = through - X_start[:3, 3], X_end[:3, 3] - X_start[:3, 3]
    normal = np.cross(p, q)
    size = float(normal @ normal)
    if size <= FLAT * float(p @ p) * float(q @ q):
        return tool_line(X_start, X_end)
    axis = normal / np.sqrt(size)
    center = X_start[:3, 3] + np.cross((p @ p) * q - (q @ q) * p, normal) / (2.0 * size)
    first, last = X_start[:3, 3] - center, X_end[:3, 3] - center
    angle = float(np.arctan2(axis @ np.cross(first, last), first @ last)) % (2 * np.pi)
    turn = rotation_vector(X_end[:3, :3] @ X_start[:3, :3].T)
    return ToolCurve(
        word="arc", X_start=X_start, X_end=X_end, along=np.zeros(3), turn=turn, around=angle * axis, arm=first
    )


def helix_about(X_WA: Array, X_start: Array, angle: float, advance: float, *, keep_orientation: bool) -> ToolCurve:
    """The helix about the z axis of a pose X_WA, shape (4, 4), from another pose on.

    angle: right-handed, of the way about the axis and of the tool's turn [rad]. advance: along the axis meanwhile [m].
    """
    arm, around = X_start[:3, 3] - X_WA[:3, 3], angle * X_WA[:3, 2]
    X_AB, along = displacement(np.zeros(3), around), advance * X_WA[:3, 2]
    turn, R = (np.zeros(3), X_start[:3, :3]) if keep_orientation else (around, X_AB[:3, :3] @ X_start[:3, :3])
    X_end = pose(R, X_WA[:3, 3] + X_AB[:3, :3] @ arm + along)
    return ToolCurve(word="helix", X_start=X_start, X_end=X_end, along=along, turn=turn, around=around, arm=arm)


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
