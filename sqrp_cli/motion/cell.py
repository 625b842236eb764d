"""A workspace prepared for computing: robot model, collision scene and cameras; too large ones are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import Place, bad_input
from sqrp_cli.motion.collision import CollisionScene, NamePairs, find_self_contacts
from sqrp_cli.motion.fingers import closed_on
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel, positions_of
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.solids import load_solid


@dataclass(frozen=True, eq=False)
class Cell:
    """Data that all candidates of a workspace share; computed once."""

    workspace: Workspace
    model: RobotModel
    collision: CollisionScene
    observer: Observer
    unchecked_pairs: NamePairs  # of links whose contact is not checked, beside neighbours
    never_touching: NamePairs | None
    """Pairs of links that touch in no position tried, where the unchecked ones are found so; None: an SRDF has them."""
    seed: int  # seed of all random numbers in planning

    @classmethod
    def load(cls, workspace: Workspace, seed: int = 0) -> Cell:
        """Read the robot and every mesh. Raises InputError for a URDF or mesh that cannot be used."""
        robot = workspace.robot
        model = RobotModel.load(robot)
        _check_size(workspace, model)
        objects = [t for t in workspace.objects.values() if t.X_WO is not None or t.X_TO is not None]
        handled = {name for task in workspace.recordings.values() for name in task.objects}
        moved = [obj for name, obj in workspace.objects.items() if name in handled and obj not in objects]
        parts = [*model.parts, *(part for obj in (*objects, *moved) for part in obj.parts)]
        found = find_self_contacts(model, seed) if robot.srdf is None else None
        unchecked, never_touching = (robot.disabled_pairs, None) if found is None else found
        placed = [*objects, *moved]
        colors, movable = {obj.name: obj.color or "" for obj in placed}, {obj.name for obj in placed if not obj.fixed}
        own = set(model.links) - model.tool_links  # a part of the robot has the name of its link in output
        named = [(part, part.parent if part.parent in own else part.name) for part in parts]
        solids = tuple(
            replace(load_solid(part, name), color=colors.get(part.parent), movable=part.parent in movable)
            for part, name in named
        )
        return cls(
            workspace=workspace,
            model=model,
            collision=CollisionScene(model, objects, unchecked, workspace.padding),
            observer=Observer(tuple(workspace.cameras.values()), solids, workspace.lights),
            unchecked_pairs=unchecked,
            never_touching=never_touching,
            seed=seed,
        )

    def with_cameras_of(self, workspace: Workspace) -> Cell:
        """The cell of a workspace that differs in its cameras only; motions stay the same."""
        observer = replace(self.observer, cameras=tuple(workspace.cameras.values()))
        return replace(self, workspace=workspace, observer=observer)

    @property
    def initial_world(self) -> World:
        """The world before any program has run. Raises InputError if the fingers cannot hold the held object."""
        world, model = self.workspace.stated_world, self.model
        if world.held is None or world.X_TO is None:
            return world
        fingers = closed_on(self.collision, world.held, world.X_TO, positions_of(model.fingers.joints, world.joints))
        if isinstance(fingers, str):
            place = self.workspace.places.get(f"objects.{world.held}.pose")
            raise bad_input("not-held", f"`{world.held}` is stated to be held, but {fingers}", place)
        return replace(
            world,
            X_WO={**world.X_WO, world.held: model.tool_pose(model.home) @ world.X_TO},
            joints={**world.joints, **dict(zip(model.fingers.joints, fingers.tolist(), strict=True))},
        )


LARGEST_LINK = 20.0
"""Largest extent of a moving link from its origin, and largest distance of joints from each other [m].

The larger a link, the more finely its motion has to be divided.
"""

MOST_SHAPES = 4000  # most solid shapes of robot, tool and objects together


def _check_size(workspace: Workspace, model: RobotModel) -> None:
    """Raises InputError, at the line of the URDF, for a link that moves and reaches further than `LARGEST_LINK`.

    Likewise for a joint further than that from the one that carries it, and for more than `MOST_SHAPES`.
    """
    shapes = len(model.parts) + sum(len(obj.parts) for obj in workspace.objects.values())
    if shapes > MOST_SHAPES:
        message = f"robot and objects have {shapes:,} shapes, expected at most {MOST_SHAPES:,}"
        raise bad_input("too-many-shapes", message, workspace.whole_file, mend="join them into meshes")
    tree, robot = model.tree, workspace.robot
    far: list[tuple[float, str, Place | None]] = [
        (
            float(np.linalg.norm(X_PJ[:3, 3])),
            f"joint `{joint.name}` is {{}} m from the one that carries it",
            joint.place,
        )
        for joint, parent, X_PJ in zip(tree.joints, tree.parents, tree.terms[:, 0], strict=True)
        if parent >= 0
    ]
    places = {link.name: link.place for urdf in robot.urdfs for link in urdf.links.values()}
    for part in model.parts:
        if tree.mounts[part.parent][0] >= 0:
            away = float(np.linalg.norm(load_solid(part).vertices, axis=1).max())
            what = f"link `{part.parent}` moves, and part `{part.name}` of it reaches {{}} m from its origin"
            far.append((away, what, places.get(part.parent)))
    for away, what, place in far:
        if away > LARGEST_LINK:
            message = f"{what.format(f'{away:.3g}')}, expected at most {LARGEST_LINK:g} m"
            mend = "check the units, in metres, and the `scale` of meshes"
            raise bad_input("link-too-large", message, place, mend=mend)
