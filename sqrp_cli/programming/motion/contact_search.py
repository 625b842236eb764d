"""Where a guarded move is expected to meet what it looks for."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import inverse
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.motion.collision.collision import CollisionScene
from sqrp_cli.programming.motion.collision.collision_body import distance_within, placement_at
from sqrp_cli.programming.motion.tool_curve import ToolLine

TOUCH = 1e-5
"""Distance that counts as contact [m]."""

ARM_OF_TURN = 0.5
"""No part of tool and held object is further from the tool frame [m]: bounds their motion while the tool turns."""


def contact_share(scene: CollisionScene, world: World, line: ToolLine, other: str) -> float | None:
    """The first s in [0, 1] at which the tool, or what it holds, touches an object on a line; None if it does not.

    Steps are as long as the distance allows (conservative advancement), so that no contact is stepped over.
    """
    model = scene.model
    X_WF = model.link_poses(model.with_fingers(model.home, model.finger_positions(world.joints))[None])
    X_TW = inverse(X_WF[model.tool_frame][0])
    moving = [(b, X_TW @ X_WF[b.name][0] @ b.X_PG) for b in scene.bodies if b.name in model.hand_links]
    if world.held is not None and world.X_TO is not None:
        moving += [(body, world.X_TO @ body.X_PG) for body in scene.object_bodies[world.held]]
    resting = [(body.geometry, placement_at(world.X_WO[other] @ body.X_PG)) for body in scene.object_bodies[other]]
    motion = line.length + ARM_OF_TURN * line.turning
    s = 0.0
    while s <= 1.0:
        X_WT, left = line.poses(np.array([s]))[0], (1.0 - s) * motion + TOUCH
        near = [
            distance
            for body, X_TG in moving
            for geometry, X_WG in resting
            if (distance := distance_within(body.geometry, placement_at(X_WT @ X_TG), geometry, X_WG, left)) is not None
        ]
        if not near:
            return None
        if min(near) <= TOUCH:
            return s
        s += max(min(near), TOUCH) / motion
    return None
