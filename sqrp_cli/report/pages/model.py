"""Robot, objects and everything solid as a document from which a viewer builds the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sqrp_cli.programming.cell import Cell
from sqrp_cli.report.documents.document import Pose, Record
from sqrp_cli.report.pages.libraries import simplified
from sqrp_cli.report.pages.paint import Color, css, solid_colors
from sqrp_cli.shapes import Triangles

STEP = 1e-4
"""Coordinates of meshes are given in multiples of this [m]."""


@dataclass(frozen=True, kw_only=True)
class ModelJoint(Record):
    """A joint of the robot."""

    name: str
    parent: int
    """Index of the joint that carries it; -1: the world."""
    slides: bool
    axis: list[float]
    pose: Pose
    """In the parent, at position 0."""


@dataclass(frozen=True, kw_only=True)
class ModelLink(Record):
    """A link of the robot."""

    joint: int
    """Index of the joint that carries it; -1: the world."""
    pose: Pose
    """In the joint."""


@dataclass(frozen=True, kw_only=True)
class ModelSolid(Record):
    """Something solid."""

    name: str
    """What verdicts call it."""
    parent: str
    """The link or object that carries it."""
    color: str
    vertices: list[int]
    """x, y, z, x, ... in the parent's frame, in multiples of `step`."""
    triangles: list[int]
    """Indices of three vertices each."""


@dataclass(frozen=True, kw_only=True)
class SceneModel(Record):
    """What moves with what, and the shape of every part."""

    step: float
    joints: list[ModelJoint]
    """Parents first."""
    links: Mapping[str, ModelLink]
    solids: list[ModelSolid]

    @classmethod
    def of(cls, cell: Cell) -> SceneModel:
        """The model of a cell. Raises InputError where a library is missing."""
        tree = cell.model.tree
        return cls(
            step=STEP,
            joints=[
                ModelJoint(name=joint.name, parent=parent, slides=not turns, axis=list(joint.axis), pose=X.tolist())
                for joint, parent, turns, X in zip(
                    tree.joints, tree.parents, tree.turns.tolist(), tree.still, strict=True
                )
            ],
            links={name: ModelLink(joint=mount.joint, pose=mount.X_JL.tolist()) for name, mount in tree.mounts.items()},
            solids=[_solid(cell, index, color) for index, color in enumerate(solid_colors(cell))],
        )


def _solid(cell: Cell, index: int, color: Color) -> ModelSolid:
    solid = cell.observer.solids[index]
    surface = simplified(Triangles(solid.vertices, solid.triangles))
    return ModelSolid(
        name=cell.solid_name(index),
        parent=solid.part.parent,
        color=css(color),
        vertices=np.round(surface.vertices / STEP).astype(int).reshape(-1).tolist(),
        triangles=surface.faces.reshape(-1).tolist(),
    )
