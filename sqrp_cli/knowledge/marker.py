"""ArUco markers on things: which marker is where. Dictionary: OpenCV's `DICT_ARUCO_ORIGINAL`, ids 0 to 1023.

An object with a marker has it on its top (+z), as large as fits there. A link of robot or tool has one if its name is
`marker_ID` or ends with `_marker_ID`, such as `left_tip_marker_12`; its first box is then a plate that has the marker
on its +z face. A marker is printed with a white margin as wide as one of its modules, and the margin belongs to the
plate.
"""

from __future__ import annotations

import re

MAX_ID = 1023
"""Largest id of the dictionary."""

MODULES = 7
"""Modules along a side of a marker: 5 of the code and a black border; the plate with its margin has two more."""

BLACK_SHARE = MODULES / (MODULES + 2)
"""Side of the black square over the side of the plate."""

_LINK = re.compile(r"(?:.*_)?marker_(\d+)")


def link_marker(link: str) -> int | None:
    """The id of the marker on a link, or None."""
    match = _LINK.fullmatch(link)
    return int(match[1]) if match and int(match[1]) <= MAX_ID else None
