"""Straight lines of a single arm from one posture."""

from __future__ import annotations

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.straight_line import follow_within_limits, limit_reason
from sqrp_cli.motion.tool_curve import ToolCurve
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.trajectory import JointPath


def straight_line(model: RobotModel, q0: Array, line: ToolCurve) -> JointPath | Infeasible:
    """The joint path that moves the tool along the line, from q0, shape (n,), with the tool at the line's start.

    The path is one polynomial per joint, exact at Chebyshev points and within `TOLERANCE` between them. Infeasible,
    with the place, where the arm becomes singular or a joint reaches its limit.
    """
    (path,) = follow_within_limits(model, q0[None], line, np.zeros(len(model.arm), dtype=bool))
    if isinstance(path, JointPath) and (reason := limit_reason(model, path, line)) is not None:
        return Infeasible((reason,))
    return path
