"""The time to stop a motion at an instant and move back to its start."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.timing import MotionLimits, joint_move_duration
from sqrp_cli.robot.kinematics import RobotModel

INSTANTS = 65
"""Instants at which stopping and moving back are computed, equally spaced from a fault's earliest time to the end."""
Recovery = tuple[Array, Array]
"""Instants at which the robot is to stop, and the time to stop and move back to the start then [s], shape (n,) each.

The time is linear in between; beyond the end it is that of the end.
"""


def recovery_over(motion: Motion, model: RobotModel, start: float) -> Recovery:
    """Stop and move-back times from `start` [s] to the end of a motion.

    Stopping: every joint of the arm comes to rest as soon as its acceleration and jerk limits allow; the slowest
    counts. Moving back: a joint move to the joint positions at the start of the motion. Detours are followed on the way
    back too: after such a primitive by a joint move to its end and back along it, within it back along its path, in the
    same time.
    """
    limits = MotionLimits.of(model)
    t = np.linspace(min(start, motion.time), motion.time, INSTANTS)
    n = len(model.arm)
    q, velocity, acceleration = (np.empty((INSTANTS, n)) for _ in range(3))
    of_instant = np.searchsorted([primitive.end for primitive in motion.primitives[:-1]], t)
    for index in sorted({*of_instant.tolist()}):
        rows = np.flatnonzero(of_instant == index)
        primitive = motion.primitives[index]
        motion_then = primitive.trajectory.motion(t[rows] - primitive.start, 2)
        q[rows], velocity[rows], acceleration[rows] = (values[:, :n] for values in motion_then)
    stopping, displacement = stop(velocity, acceleration, limits)
    q, target, further = q + displacement, motion.positions(0, np.zeros(1))[:, :n], 0.0
    back = joint_move_duration(q, target, limits)
    for index, primitive in enumerate(motion.primitives):
        if primitive.around is None:
            continue
        start_of_way, end_of_way = primitive.trajectory.path.positions([0.0, 1.0])[:, :n]
        from_start = further + float(joint_move_duration(start_of_way, target[0], limits))
        within, after = of_instant == index, of_instant > index
        back[within] = from_start + t[within] - primitive.start
        target, further = end_of_way[None], from_start + primitive.trajectory.duration
        back[after] = further + joint_move_duration(q[after], target, limits)
    return t, stopping.max(axis=1) + back


def stop(velocity: Array, acceleration: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """The shortest time to rest from velocities and accelerations [s], and how far joints move meanwhile [rad or m].

    All have the shape (m, n).
    The acceleration changes at the jerk limit to a peak p, stays there if p is the acceleration limit, and returns to
    zero. With signs such that p is positive, velocity u and acceleration b: p^2 / J - b^2 / 2J = -u.
    """
    A, J = limits.acceleration, limits.jerk
    sign = np.where(velocity + acceleration * np.abs(acceleration) / (2 * J) > 0, -1.0, 1.0)
    u, b = sign * velocity, np.minimum(sign * acceleration, A)
    p = np.clip(np.sqrt(np.maximum(b * b / 2 - J * u, 0.0)), np.maximum(b, 0.0), A)
    rise, fall = (p - b) / J, p / J
    gained = (2 * p * p - b * b) / (2 * J)
    hold = np.maximum(-u - gained, 0.0) / np.where(p > 0, p, 1.0)
    after_rise = u + b * rise + J * rise**2 / 2
    after_hold = after_rise + p * hold
    moved = (
        u * rise + b * rise**2 / 2 + J * rise**3 / 6
        + after_rise * hold + p * hold**2 / 2
        + after_hold * fall + p * fall**2 / 2 - J * fall**3 / 6
    )  # fmt: skip
    return rise + hold + fall, sign * moved
