"""The colours of pages and pictures."""

from __future__ import annotations

from itertools import cycle

from sqrp_cli.motion.cell import Cell

Color = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

COVERED: Color = (42, 157, 111)
HIDDEN: Color = (208, 58, 75)
CULPRIT: Color = (238, 158, 166)
"""Colour in pictures of what hides a target; the target's outline must stand out from it."""

_NAMED: dict[str, Color] = {
    "red": (207, 74, 63),
    "green": (74, 157, 91),
    "blue": (67, 114, 201),
    "yellow": (217, 178, 58),
    "orange": (221, 132, 52),
    "brown": (138, 100, 70),
    "purple": (126, 87, 176),
    "pink": (219, 130, 165),
    "grey": (180, 188, 196),
    "gray": (180, 188, 196),
    "black": (48, 54, 60),
    "white": (242, 244, 245),
}
_ROBOT: tuple[Color, ...] = ((195, 204, 212), (143, 163, 179))
_TOOL: Color = (224, 165, 60)
_OTHER: Color = (170, 178, 185)


def solid_colors(cell: Cell) -> list[Color]:
    """A colour for every solid: objects have their own if it is known, links alternate, the tool stands out."""
    shades = cycle(_ROBOT)
    colors = []
    for solid in cell.observer.solids:
        parent = solid.part.parent
        if parent in cell.workspace.objects:
            colors.append(_NAMED.get((cell.workspace.objects[parent].color or "").lower(), _OTHER))
        else:
            colors.append(_TOOL if parent in cell.model.tool_links else next(shades))
    return colors


def css(color: Color) -> str:
    """A colour in CSS."""
    return "#{:02x}{:02x}{:02x}".format(*color)
