"""ArUco markers as printed: dictionary `DICT_ARUCO_ORIGINAL` of OpenCV, ids 0 to 1023.

A marker has a white margin at least as wide as one of its modules. An object with a marker has it in the middle of its
top (+z), black square and margin together as large as fits there; on links the workspace states the black square.
"""

from __future__ import annotations

from sqrp_cli.knowledge.scene import SceneObject

MODULES = 7
"""Modules along a side of the black square: 5 of the code, and its border."""


def printed_side(thing: SceneObject) -> float:
    """Side of the black square of an object's marker [m]."""
    return min(thing.size[:2]) * MODULES / (MODULES + 2)
