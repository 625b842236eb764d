"""A tool that the workspace file describes as boxes and a grasp frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sqrp_cli.errors import Place
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.knowledge.robot.urdf import LinkGeometry, UrdfJoint, UrdfLink, UrdfModel
from sqrp_cli.shapes import Box

TOOL_BODY, TOOL_TIP = "tool_body", "tool_tip"
"""The links of such a tool: its root with the boxes, and the grasp frame."""


def tool_of_boxes(
    boxes: Sequence[tuple[tuple[float, float, float], Array]], X_BT: Array, path: Path, place: Place
) -> UrdfModel:
    """The tool as a robot description without a file of its own.

    boxes: full extents [m] of each, and the pose of its centre in the root link, shape (4, 4). X_BT: pose of the grasp
    frame in the root link, shape (4, 4). path, place: of the file and the entry that describe it.
    """
    solid = tuple(LinkGeometry(None, Box(size), read_only(X_BG), place) for size, X_BG in boxes)
    links = {TOOL_BODY: UrdfLink(TOOL_BODY, solid, (), None, place), TOOL_TIP: UrdfLink(TOOL_TIP, (), (), None, place)}
    tip = UrdfJoint(
        name=f"{TOOL_TIP}_joint",
        type="fixed",
        parent=TOOL_BODY,
        child=TOOL_TIP,
        X_PJ=read_only(X_BT),
        axis=read_only([1.0, 0.0, 0.0]),
        lower=0.0,
        upper=0.0,
        velocity=None,
        effort=None,
        mimic=None,
        place=place,
    )
    return UrdfModel("tool", path, links, {tip.name: tip}, TOOL_BODY)
