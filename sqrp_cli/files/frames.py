"""Frames that poses refer to: their names in files, and their world poses.

A frame is `world`, a link of the robot, an object, or `OBJECT@start`. Skills also write `tool` for the tool frame, and
their parameters for objects.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from sqrp_cli.geometry import Array, read_only

WORLD = "world"  # the cell's world, wherever a frame is named
WORLD_LINK = "robot/world"
"""Name of a URDF's link `world`, which is at the robot's base and need not be the cell's world."""
TOOL = "tool"  # in a skill: the tool frame, or all parts of the tool
AT_START = "@start"  # behind the name of an object: the frame that stays where it was when the step began
_X_WW = read_only(np.eye(4))


def link_called(name: str, links: Collection[str]) -> str:
    """The link that a name means in a file about the robot."""
    return WORLD_LINK if name == WORLD and WORLD_LINK in links else name


def frame_poses(
    X_WL: Mapping[str, Array], X_WO: Mapping[str, Array], starts: Mapping[str, Array], X_WW: Array = _X_WW
) -> dict[str, Array]:
    """World poses X_WF of all frames by name, with the given shapes (..., 4, 4).

    X_WL: of links. X_WO: of objects, and starts: of objects when the step began. X_WW: of the world itself, in the
    wanted shape.
    """
    return {**X_WO, **{f"{name}{AT_START}": X_WS for name, X_WS in starts.items()}, **X_WL, WORLD: X_WW}


Stay = tuple[slice, Array | None, Array | None]
"""Where an object is over consecutive samples of a motion, the rows.

Its pose X_TO in the tool frame while it is held, shape (4, 4), else None; then the pose X_WO where it rests.
"""


def carried_poses(X_WT: Array, stays: Iterable[Stay]) -> Array:
    """World poses of an object that moves with the tool while it is held and rests otherwise, shape (m, 4, 4).

    X_WT: poses of the tool frame, shape (m, 4, 4). stays: cover all m samples; each is used before the next is drawn.
    """
    X_WO = np.empty_like(X_WT)
    for rows, X_TO, resting in stays:
        X_WO[rows] = resting if X_TO is None else X_WT[rows] @ X_TO
    return X_WO
