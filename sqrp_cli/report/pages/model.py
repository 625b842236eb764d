"""Robot, objects and everything solid as a document from which a viewer builds the scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from sqrp_cli.programming.cell import Cell
from sqrp_cli.report.pages.libraries import simplified
from sqrp_cli.report.pages.paint import Color, css, solid_colors

STEP = 1e-4
"""Coordinates of meshes are given in multiples of this [m]."""


def model_document(cell: Cell) -> dict[str, Any]:
    """What moves with what, and the shape of every part.

    `joints`: parents first, each with the index of its `parent` (-1: the world), whether it `slides`, its `axis` and
    its `pose` in the parent at position 0. `links`: the `joint` that carries each (-1: the world), with its `pose` in
    it. `solids`: the `name` that verdicts use for it, its `parent` (a link or an object), its `color`, `vertices` (x,
    y, z, x, ... in the parent's frame, in multiples of `step`) and `triangles` (indices of three vertices each). Poses
    are 4x4 nested rows.
    """
    tree = cell.model.tree
    return {
        "step": STEP,
        "joints": [
            {"name": joint.name, "parent": parent, "slides": not turns, "axis": list(joint.axis), "pose": X.tolist()}
            for joint, parent, turns, X in zip(tree.joints, tree.parents, tree.turns.tolist(), tree.still, strict=True)
        ],
        "links": {name: {"joint": mount.joint, "pose": mount.X_JL.tolist()} for name, mount in tree.mounts.items()},
        "solids": [_solid(cell, index, color) for index, color in enumerate(solid_colors(cell))],
    }


def _solid(cell: Cell, index: int, color: Color) -> dict[str, Any]:
    solid = cell.observer.solids[index]
    vertices, triangles = simplified(solid.vertices, solid.triangles)
    return {
        "name": cell.solid_name(index),
        "parent": solid.part.parent,
        "color": css(color),
        "vertices": np.round(vertices / STEP).astype(int).reshape(-1).tolist(),
        "triangles": triangles.reshape(-1).tolist(),
    }
