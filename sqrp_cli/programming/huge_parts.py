"""Robots too large and cells with too many shapes to compute with, refused before anything is checked for contacts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.sensing.solids import load_solid

LARGEST_LINK = 20.0
"""How far a link that moves may reach from its origin, and its joints from each other [m].

The finer its motion has to be divided, the farther it reaches.
"""

MOST_SHAPES = 4000
"""Most solid shapes of robot, tool and objects together."""


def check_cell_size(workspace: Workspace, model: RobotModel) -> None:
    """Raises InputError, at the line of the URDF, for a link that moves and reaches further than `LARGEST_LINK`.

    Likewise for a joint further than that from the one that carries it, and for more than `MOST_SHAPES`.
    """
    shapes = len(model.parts) + sum(len(thing.parts) for thing in workspace.objects.values())
    if shapes > MOST_SHAPES:
        message = f"robot and objects have {shapes:,} shapes, expected at most {MOST_SHAPES:,}"
        raise InputError(Problem("too-many-shapes", message, Place(workspace.path), mend="join them into meshes"))
    tree, robot = model.tree, workspace.robot
    for joint, parent, X_PJ in zip(tree.joints, tree.parents, tree.still, strict=True):
        if parent >= 0 and (away := float(np.linalg.norm(X_PJ[:3, 3]))) > LARGEST_LINK:
            raise _refusal(f"joint `{joint.name}` is {away:.3g} m from the one that carries it", joint.place)
    for part in model.parts:
        if tree.mounts[part.parent].joint >= 0:
            away = float(np.linalg.norm(load_solid(part).vertices, axis=1).max())
            if away > LARGEST_LINK:
                message = (
                    f"link `{part.parent}` moves, and part `{part.name}` of it reaches {away:.3g} m from its origin"
                )
                raise _refusal(message, _place(robot.urdfs, part.parent))


def _refusal(message: str, place: Place | None) -> InputError:
    mend = "check the units, in metres, and the `scale` of meshes"
    return InputError(Problem("link-too-large", f"{message}, expected at most {LARGEST_LINK:g} m", place, mend=mend))


def _place(urdfs: Sequence[UrdfModel], name: str) -> Place | None:
    links = chain.from_iterable(urdf.links.values() for urdf in urdfs)
    return next((link.place for link in links if link.name == name), None)
