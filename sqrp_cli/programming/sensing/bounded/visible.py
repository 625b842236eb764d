"""Whether enough of a box is visible from wherever a camera may be: by branch and bound over its centre."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.columns import Columns
from sqrp_cli.programming.sensing.bounded.hulls import axes_to_boxes
from sqrp_cli.programming.sensing.bounded.shares import NearSolids, share_bounds
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines

_HALVINGS = 3
"""How often the columns of centres are halved where that may decide."""


def visible_enough(
    lines: SightLines, poses: SolidPoses, pairs: Pairs, needed: Array, bounds: PoseBounds, *, surely: bool
) -> Mask:
    """Of the v sight lines in pairs, along which surely, or possibly, as much of the box as needed (v,) is visible.

    Lines in no pair are surely free, and not said to be possibly so. What is left undecided after all halvings counts
    as not sure, and as possible; so does what no halving can decide.
    """
    shown = np.zeros(len(lines.state), dtype=bool)
    columns, near = Columns.whole(np.unique(pairs.line), bounds), NearSolids.of(lines, poses, pairs, bounds.reach)
    for _ in range(_HALVINGS + 1):
        looks = _from_columns(lines, columns)
        found = share_bounds(looks, poses, near.of_lines(columns.line), columns)
        least = needed[columns.line]
        if surely:
            doubtful, hopeless = found.low < least, found.middle - found.error < least
        else:
            doubtful, hopeless = found.high >= least, found.middle + found.error >= least
        shown[columns.line[hopeless]] = True
        columns = columns.some(doubtful & ~shown[columns.line])
        if not len(columns.line):
            return ~shown if surely else shown
        left, columns = columns.line, columns.split()
    shown[left] = True
    return ~shown if surely else shown


def _from_columns(lines: SightLines, columns: Columns) -> SightLines:
    """A sight line from the middle of each column, with a hull of its own."""
    hull = lines.hull[columns.line]
    _, aside, over = (axis[hull] for axis in axes_to_boxes(lines))
    X_WC = lines.X_WC[hull]
    X_WC[:, :3, 3] += columns.middle[:, :1] * aside + columns.middle[:, 1:] * over
    return replace(
        lines,
        state=lines.state[columns.line],
        hull=np.arange(len(hull)),
        box=lines.box[hull],
        X_WC=X_WC,
        X_WB=lines.X_WB[hull],
        half_size=lines.half_size[hull],
        offset=lines.offset[hull],
    )
