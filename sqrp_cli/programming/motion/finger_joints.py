"""Where the joints of the fingers are, and how finely their motion is divided."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.sensing.solids import load_solid


def finger_steps(model: RobotModel, start: Array, end: Array, step: float) -> int:
    """In how many equal steps the fingers go from start to end, (f,) each, without any point moving by over `step` [m].

    At least 1. Measured at the boxes around the solids, along 33 positions.
    """
    share = np.linspace(0.0, 1.0, 33)[:, None]
    poses = model.link_poses(
        np.concatenate([np.broadcast_to(model.home, (33, len(model.home))), start + share * (end - start)], axis=1)
    )
    corners = [
        transform(poses[part.parent], load_solid(part).corners)
        for part in model.parts
        if part.parent in model.fingers.links
    ]
    longest = max((float(np.linalg.norm(np.diff(c, axis=0), axis=-1).max()) for c in corners), default=0.0)
    return max(1, int(np.ceil(32 * longest / step)))
