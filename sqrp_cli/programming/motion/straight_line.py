"""The joint path that moves the tool on a straight line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.trajectory import Path

TOLERANCE = 1e-6
"""Largest deviation of the tool from the line, in m and rad, between the points where it is met exactly."""

NEWTON_TOLERANCE = 1e-11
"""Largest error of the tool's pose where the line is met exactly, in m and rad."""

NEWTON_STEPS = 8
"""Newton steps within which a neighbouring point of the line must be met."""

LARGEST_STEP = 0.3
"""Largest motion of a joint between neighbouring points of the line [rad or m]: beyond it, the step is halved."""

SMALLEST_STEP = 1e-3
"""Share of the line below which steps are not halved any more: the arm cannot go on from there."""

FIRST_DEGREE, LAST_DEGREE = 4, 64
"""Degrees of the polynomials that are tried first and last, doubling in between."""

LIMIT_SAMPLES = 101
"""Points along a line at which joint limits are checked, ends included."""

LIMIT_SLACK = 1e-9
"""By how much joint positions may exceed a limit [rad or m], so that rounding does not matter at the limit."""


@dataclass(frozen=True, eq=False)
class ToolLine:
    """A straight line of the tool frame: its origin moves evenly while it turns evenly about one fixed axis (slerp).

    X_start, X_end: poses X_WT of the tool frame in the world, shape (4, 4).
    """

    X_start: Array
    X_end: Array

    @cached_property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.X_end[:3, 3] - self.X_start[:3, 3]))

    @cached_property
    def turn(self) -> Array:
        """Rotation vector of the whole turn, in world axes [rad], shape (3,)."""
        return rotation_vector(self.X_end[:3, :3] @ self.X_start[:3, :3].T)

    def pose(self, s: float) -> Array:
        """The pose X_WT at s in [0, 1], shape (4, 4)."""
        X_WT = self.X_start.copy()
        X_WT[:3, 3] += s * (self.X_end[:3, 3] - self.X_start[:3, 3])
        if self.turn.any():
            X_WT[:3, :3] = rotation_matrix(s * self.turn) @ X_WT[:3, :3]
        return X_WT

    def progress(self, s: float) -> str:
        """How far along the line s is, for people: `34 mm of 100 mm`, or in degrees when the tool only turns."""
        if self.length > 1e-6:
            return f"{1e3 * s * self.length:.0f} mm of {1e3 * self.length:.0f} mm"
        angle = np.degrees(np.linalg.norm(self.turn))
        return f"{s * angle:.0f} deg of {angle:.0f} deg"


def straight_line(model: RobotModel, q0: Array, line: ToolLine) -> Path | Infeasible:
    """The path from q0, shape (n,), at which the tool is at the line's start, that moves the tool along the line.

    The path is one polynomial per joint, met exactly at Chebyshev points and within `TOLERANCE` between them.
    Infeasible where the arm becomes singular or a joint reaches its limit on the way, saying where.
    """
    path = follow(model, q0, line)
    if isinstance(path, Path) and (reason := limit_reason(model, path, line)) is not None:
        return Infeasible((reason,))
    return path


def follow(model: RobotModel, q0: Array, line: ToolLine) -> Path | Infeasible:
    """As `straight_line`, whatever the joints' limits.

    The points of each degree are among those of twice the degree: those in between first check the fit, then refine it.
    """
    degree = FIRST_DEGREE
    s = _points(degree)
    q = np.empty((degree + 1, len(q0)))
    q[0] = q0
    for k in range(degree):
        step = _advance(model, line, q[k], s[k], s[k + 1])
        if isinstance(step, Infeasible):
            return step
        q[k + 1] = step
    while True:
        path = Path(np.array([0.0, 1.0]), (_fit_matrix(degree) @ q)[None])
        between = _points(2 * degree)[1::2]
        guesses = path.positions(between)
        errors = np.array([_pose_error(model, q_s, line.pose(at)) for q_s, at in zip(guesses, between, strict=True)])
        if np.linalg.norm(errors.reshape(-1, 2, 3), axis=-1).max() <= TOLERANCE:
            return path
        if degree == LAST_DEGREE:
            at = float(between[np.abs(errors).max(axis=1).argmax()])
            return Infeasible((f"the arm is close to singular after {line.progress(at)} of the straight line",))
        refined = np.empty((2 * degree + 1, len(q0)))
        refined[::2] = q
        for k, at in enumerate(between):
            start = guesses[k] if np.abs(guesses[k] - q[k]).max() <= LARGEST_STEP else q[k]
            step = _advance(model, line, start, s[k], at)
            if isinstance(step, Infeasible):
                return step
            refined[2 * k + 1] = step
        degree, q, s = 2 * degree, refined, _points(2 * degree)


def limit_reason(model: RobotModel, path: Path, line: ToolLine) -> str | None:
    """Why a path along the line is outside the joints' limits, or None when it keeps them."""
    s = np.linspace(0.0, 1.0, LIMIT_SAMPLES)
    q = path.positions(s)
    outside = (q < model.lower - LIMIT_SLACK) | (q > model.upper + LIMIT_SLACK)
    if not outside.any():
        return None
    first = int(outside.any(axis=1).argmax())
    joint = model.arm[int(outside[first].argmax())]
    return f"the arm reaches its limit of `{joint}` after {line.progress(float(s[first]))} of the straight line"


def _advance(model: RobotModel, line: ToolLine, q: Array, s: float, to: float) -> Array | Infeasible:
    """Joint positions that meet the line at `to`, on the branch of q, which is near the line at `s`."""
    reached = _newton(model, q, line.pose(to))
    if reached is not None and np.abs(reached - q).max() <= LARGEST_STEP:
        return reached
    if to - s < SMALLEST_STEP:
        return Infeasible((f"the arm cannot follow the straight line beyond {line.progress(s)}: it is singular there",))
    middle = 0.5 * (s + to)
    half_way = _advance(model, line, q, s, middle)
    return half_way if isinstance(half_way, Infeasible) else _advance(model, line, half_way, middle, to)


def _newton(model: RobotModel, q: Array, X_WT: Array) -> Array | None:
    """Joint positions near q that bring the tool to X_WT, or None when Newton's method does not get there."""
    for _ in range(NEWTON_STEPS):
        error = _pose_error(model, q, X_WT)
        if np.abs(error).max() <= NEWTON_TOLERANCE:
            return q
        q = q + np.linalg.lstsq(model.jacobian(q), error, rcond=1e-9)[0]
    return None


def _pose_error(model: RobotModel, q: Array, X_WT: Array) -> Array:
    """Position error over rotation vector from the tool's pose at q to X_WT, in world axes, shape (6,)."""
    reached = model.tool_pose(q)
    return np.concatenate([X_WT[:3, 3] - reached[:3, 3], rotation_vector(X_WT[:3, :3] @ reached[:3, :3].T)])


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


@cache
def _points(degree: int) -> Array:
    """The Chebyshev points of a degree, ends included, on [0, 1], shape (degree + 1,)."""
    points: Array = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    points.setflags(write=False)
    return points


@cache
def _fit_matrix(degree: int) -> Array:
    """Maps values at the Chebyshev points to the coefficients of the polynomial through them."""
    matrix = np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * _points(degree) - 1, degree)).astype(np.float64)
    matrix.setflags(write=False)
    return matrix
