"""Curves that moves take the tool along - straight lines, arcs, helices - and the joint paths that follow them."""

from __future__ import annotations

from dataclasses import field
from functools import cache, cached_property

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask, displacement, pose
from sqrp_cli.motion.position_limits import LIMIT_SLACK, past_limits
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import least_steps, misses, newton, past_limit, pose_errors
from sqrp_cli.robot.robot import AXES_OF_A_POSE
from sqrp_cli.trajectory import JointPath

SHORTEST_LINE = 1e-9  # curves that are no longer have no speed [m]
FLAT = 1e-9  # three points whose circle has a radius above 1 / this of their distance are on a line
TOLERANCE = 1e-6  # largest deviation of the tool from the line, in m and rad, between the points of interpolation
NEWTON_TOLERANCE = 1e-11  # largest error of the tool's pose at the points of interpolation, in m and rad
LARGEST_STEP = 0.3
"""Largest motion of a joint between neighbouring points of the line [rad or m]: beyond it, the step is halved."""
SMALLEST_STEP = 1e-3  # shortest step, as a share of the line: below it the arm cannot continue
FIRST_DEGREE, LAST_DEGREE, LAST_WINDING_DEGREE = 4, 64, 256
"""Degrees of the polynomials that are tried first and last, also of a curve that winds, doubling in between."""
LARGEST_TURN = 1.0  # turn of a curve that winds between neighbouring points [rad], so that no whole turn is overlooked
LIMIT_SAMPLES = 101  # points along a line at which joint limits are checked, ends included


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolCurve:
    """A smooth curve of the tool frame over s in [0, 1], on which it turns evenly about one fixed axis (slerp).

    Its origin goes evenly along a straight line, and about an axis: a line has only the first, an arc the second, a
    helix both.
    """

    word: str  # what messages call it, such as `straight line`
    X_start: Array
    X_end: Array  # Poses X_WT of the tool frame, shape (4, 4)
    along: Array  # how far its origin goes along a straight line [m], shape (3,)
    turn: Array  # rotation vector of the tool's turn, in world axes [rad], shape (3,)
    around: Array = field(default_factory=lambda: np.zeros(3))
    """Rotation vector of the way about the axis [rad], shape (3,)."""
    arm: Array = field(default_factory=lambda: np.zeros(3))
    """From a point of the axis to where its origin begins [m], shape (3,)."""

    @cached_property
    def length(self) -> float:
        """Length of the way of its origin [m]."""
        return float(np.hypot(np.linalg.norm(np.cross(self.around, self.arm)), np.linalg.norm(self.along)))

    @property
    def turning(self) -> float:
        """Angle of the whole turn of the tool [rad]."""
        return float(np.linalg.norm(self.turn))

    @cached_property
    def winding(self) -> float:
        """The greater of the turn and the way about the axis [rad]; 0 for a line, which never comes back."""
        angle = float(np.linalg.norm(self.around))
        return max(angle, self.turning) if angle > 0.0 else 0.0

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


def follow_within_limits(model: RobotModel, q0: Array, line: ToolCurve, may_turn: Mask) -> list[JointPath | Infeasible]:
    """As `follow`; a redundant arm, or one that may turn its tool away a little, holds joints that would leave limits.

    may_turn: joints that whole turns may bring within their limits, shape (n,). If holding joints still does not help,
    the path is the one that moves the joints least, limits ignored.
    """
    followed = follow(model, q0, line)
    held, limits = np.zeros(q0.shape, dtype=bool), (model.lower, model.upper)
    at_limit = ((q0 <= model.lower + LIMIT_SLACK) | (q0 >= model.upper - LIMIT_SLACK)) & (model.angle_tolerance > 0.0)
    most = len(model.arm) - (0 if model.angle_tolerance else AXES_OF_A_POSE)
    tried, going = list(followed), list(range(len(q0)))
    for _ in range(most + 1):
        for row in list(going):
            path = tried[row]
            # Where a joint that begins at its limit would move past it at once, there may be no path to judge by.
            more = past_limits(path, *limits, may_turn) > 0.0 if isinstance(path, JointPath) else at_limit[row]
            if more.any() and not (more & held[row]).any() and (more | held[row]).sum() <= most:
                held[row] |= more
            else:
                going.remove(row)
        for mask in np.unique(held[going], axis=0) if going else ():
            rows = [row for row in going if (held[row] == mask).all()]
            for row, path in zip(rows, follow(model, q0[rows], line, ~mask), strict=True):
                tried[row] = path
    return [
        trial if isinstance(trial, JointPath) and not past_limits(trial, *limits, may_turn).any() else path
        for trial, path in zip(tried, followed, strict=True)
    ]


def follow(model: RobotModel, q0: Array, line: ToolCurve, moving: Mask | None = None) -> list[JointPath | Infeasible]:
    """The paths that move the tool along a curve from each of b joint positions, shape (b, n), joint limits ignored.

    Each is one polynomial per joint, exact at Chebyshev points and within `TOLERANCE` between them, of the least degree
    that fits. The points of a degree are among those of twice the degree: those in between first check the fit, then
    refine it. Infeasible, with the place, where the arm is or becomes singular. All branches are followed at once.
    moving: which joints may move, shape (n,); by default all.
    """
    # Newton's method starts on the tangent; if that ends too far away, the line is followed from point to point.
    n, degree, s = q0.shape[1], FIRST_DEGREE, _interpolation(FIRST_DEGREE)[0]
    J = model.tool_poses_and_jacobians(q0)[1] * (True if moving is None else moving)
    twist = np.concatenate([np.cross(line.around, line.arm) + line.along, line.turn])  # per unit of s, at its start
    tangents = least_steps(J, np.tile(twist, (len(q0), 1)))
    guesses = (q0[:, None] + s[1:, None] * tangents[:, None]).reshape(-1, n)
    reached, met = _meet(model, guesses, np.tile(line.poses(s[1:]), (len(q0), 1, 1)), moving)
    q = np.concatenate([q0[:, None], reached.reshape(len(q0), degree, -1)], axis=1)
    near = (np.abs(np.diff(q, axis=1)).max(axis=2) <= LARGEST_STEP) & (np.diff(s) * line.winding <= LARGEST_TURN)
    far = np.flatnonzero(~(near & met.reshape(near.shape)).all(axis=1))
    stuck = np.full(len(q0), np.inf)
    for k in range(degree if len(far) else 0):
        going = far[np.isinf(stuck[far])]
        at, to = (np.full(len(going), value) for value in s[k : k + 2])
        q[going, k + 1], stuck[going] = _advance(model, line, q[going, k], at, to, moving)
    paths: dict[int, JointPath | Infeasible] = {}
    rows = np.arange(len(q0))  # those that have no path yet, with points q (r, degree + 1, n)
    while len(rows):
        for row, end in zip(rows.tolist(), stuck.tolist(), strict=True):
            if end < np.inf:
                reason = f"the arm cannot follow the {line.word} beyond {progress(line, end)}: it is singular there"
                paths[row] = Infeasible((reason,))
        going = np.isinf(stuck)
        rows, q = rows[going], q[going]
        s, between, fit, refine = _interpolation(degree)
        targets, guesses = line.poses(between), refine @ q
        flat, each = guesses.reshape(-1, n), np.tile(targets, (len(rows), 1, 1))
        errors = (
            misses(model, flat, each, moving)[0] if model.angle_tolerance else pose_errors(model.tool_poses(flat), each)
        )
        deviations = np.linalg.norm(errors.reshape(len(rows), degree, 2, 3), axis=-1).max(axis=-1)
        paths |= {row: JointPath(np.array([0.0, 1.0]), c[None]) for row, c in zip(rows.tolist(), fit @ q, strict=True)}
        misfits = np.flatnonzero(deviations.max(axis=1, initial=0.0) > TOLERANCE)
        if degree == (LAST_WINDING_DEGREE if line.winding else LAST_DEGREE):
            for row, off in zip(rows[misfits].tolist(), deviations[misfits], strict=True):
                where = progress(line, float(between[off.argmax()]))
                paths[row] = Infeasible((f"the arm is close to singular after {where} of the {line.word}",))
            break
        rows, q, guesses = rows[misfits], q[misfits], guesses[misfits]
        reached, met = _meet(model, guesses.reshape(-1, n), np.tile(targets, (len(rows), 1, 1)), moving)
        reached = reached.reshape(guesses.shape)
        near = (np.abs(guesses - q[:, :-1]).max(axis=2) <= LARGEST_STEP) & (
            (between - s[:-1]) * line.winding <= LARGEST_TURN
        )
        on = np.nonzero(~(near & met.reshape(near.shape)))
        stuck_at = np.full((len(rows), degree), np.inf)
        reached[on], stuck_at[on] = _advance(model, line, q[on], s[on[1]], between[on[1]], moving)
        degree, stuck = 2 * degree, stuck_at.min(axis=1)
        refined = np.empty((len(rows), degree + 1, n))
        refined[:, ::2], refined[:, 1::2] = q, reached
        q = refined
    return [paths[row] for row in range(len(q0))]


def limit_reason(model: RobotModel, path: JointPath, line: ToolCurve) -> str | None:
    """Why a path along the line is outside the joints' limits, or None when it keeps them."""
    excess = past_limits(path, model.lower, model.upper)
    if not excess.any():
        return None
    s = np.linspace(0.0, 1.0, LIMIT_SAMPLES)
    q = path.positions(s)
    outside = ((q < model.lower - LIMIT_SLACK) | (q > model.upper + LIMIT_SLACK)) & (excess > 0.0)
    if not outside.any():
        return str(past_limit(model, excess))
    first = int(outside.any(axis=1).argmax())
    joint = outside[first].argmax()
    past = past_limit(model, np.where(np.arange(len(excess)) == joint, excess, 0.0))
    return f"{past}, which it reaches after {progress(line, float(s[first]))} of the {line.word}"


def _advance(
    model: RobotModel, line: ToolCurve, q: Array, s: Array, to: Array, moving: Mask | None
) -> tuple[Array, Array]:
    """Joint positions that meet the line at `to`, each on the branch of a row of q that meets it at `s`.

    Shapes: q (m, n), s and to (m,). Returns them, shape (m, n), and the positions s where the arm cannot continue,
    infinite where it can, shape (m,). A step is halved if its next point is not found.
    """
    stuck = np.full(len(q), np.inf)
    if not len(q):
        return q, stuck
    reached, met = _meet(model, q, line.poses(to), moving)
    met &= (to - s) * line.winding <= LARGEST_TURN
    shortest = to - s < SMALLEST_STEP
    stuck[~met & shortest] = s[~met & shortest]
    halved = np.flatnonzero(~met & ~shortest)
    middle = 0.5 * (s + to)
    reached[halved], stuck[halved] = _advance(model, line, q[halved], s[halved], middle[halved], moving)
    on = halved[np.isinf(stuck[halved])]
    reached[on], stuck[on] = _advance(model, line, reached[on], middle[on], to[on], moving)
    return reached, stuck


def _meet(model: RobotModel, guesses: Array, X_WT: Array, moving: Mask | None) -> tuple[Array, Mask]:
    """Joint positions near guesses (m, n) that bring the tool to poses (m, 4, 4), and which of them do, (m,)."""
    q, errors = newton(model, X_WT, guesses, NEWTON_TOLERANCE, moving)
    return q, (errors <= NEWTON_TOLERANCE) & (np.abs(q - guesses).max(axis=1, initial=0.0) <= LARGEST_STEP)


@cache
def _interpolation(degree: int) -> tuple[Array, Array, Array, Array]:
    """For polynomials of a degree on [0, 1]: points, points between them, and two matrices.

    The Chebyshev points, ends included, shape (degree + 1,); those of twice the degree in between, shape (degree,);
    what maps values at the points to the polynomial's coefficients, and what maps them to values in between.
    """
    s, finer = (0.5 - 0.5 * np.cos(np.pi * np.arange(count + 1) / count) for count in (degree, 2 * degree))
    fit = np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * s - 1, degree)).astype(np.float64)
    between = finer[1::2]
    return s, between, fit, np.polynomial.chebyshev.chebvander(2 * between - 1, degree) @ fit
