"""The solids of robot, tool and objects, the pairs that must not touch, and links that touch by design."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.geometry import Array, Indices, norms, pose, transform
from sqrp_cli.knowledge.robot.joint_tree import Mount
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import (
    CLEARANCE,
    Body,
    Contact,
    NamePairs,
    distance_within,
    pair,
    placement_at,
)
from sqrp_cli.programming.motion.collision.motion_bound import LowBodies, MotionBound
from sqrp_cli.programming.motion.collision.placed_bodies import BodyArrays, BodyPairs, PlacedBodies
from sqrp_cli.programming.motion.collision.placed_scene import PlacedScene
from sqrp_cli.programming.solids import load_solid

SAMPLES = 200
"""Joint positions that are tried, spread over the limits of the joints."""

ALWAYS = 0.95
"""Share of the positions in which a pair must touch to count as always touching."""


class CollisionScene:
    """The solids of robot, tool and objects; `placed` puts the objects at their poses in a world."""

    def __init__(
        self,
        model: RobotModel,
        objects: Iterable[SceneObject],
        disabled_pairs: Iterable[tuple[str, str]] = (),
        padding: float = 0.0,
    ) -> None:
        """Load every solid.

        disabled_pairs: pairs of links that are not checked, beside those that are fixed to each other or neighbours
        across one joint. padding: extra clearance from fixed objects [m]. Raises InputError for an unusable mesh.
        """
        self.model = model
        self.bound = MotionBound(model)
        objects = tuple(objects)
        self.bodies = tuple(Body.of(load_solid(part)) for part in model.parts)
        self.object_bodies = {obj.name: tuple(Body.of(load_solid(part)) for part in obj.parts) for obj in objects}
        skipped = {pair(*names) for names in (*disabled_pairs, *model.adjacent_pairs)}
        depth, rods = self.bound.depth, self.bound.rods
        self.self_pairs = tuple(
            (i, j) if depth[a.name] < depth[b.name] else (j, i)
            for i, a in enumerate(self.bodies)
            for j, b in enumerate(self.bodies[:i])
            if depth[a.name] != depth[b.name]
            and pair(a.name, b.name) not in skipped
            and not {a.name, b.name} & rods.keys()  # rods pass the links that they are made for
        )
        every = [*self.bodies, *chain.from_iterable(self.object_bodies.values())]
        self._arrays, self._rows = BodyArrays.of(every), {body: row for row, body in enumerate(every)}
        self._low = LowBodies(model, self.bound, self.bodies)
        self._clearance = {obj.name: CLEARANCE + (padding if obj.fixed else 0.0) for obj in objects}
        self._placed: WeakKeyDictionary[World, PlacedScene] = WeakKeyDictionary()
        self._contacts: WeakKeyDictionary[World, Contact | None] = WeakKeyDictionary()

    def placed(self, world: World, allowed: NamePairs = frozenset()) -> PlacedScene:
        """The scene with every object where `world` has it; contacts of `allowed` pairs do not count.

        The held object moves with the tool and may touch it. Objects of unknown pose are left out.
        """
        if world not in self._placed:
            self._placed[world] = self._place(world)
        return self._placed[world].allowing(allowed) if allowed else self._placed[world]

    def contact_in(self, world: World) -> Contact | None:
        """A contact in a world before anything moves, or None when everything keeps its clearance."""
        if world not in self._contacts:
            self._contacts[world] = self.placed(world).check(self.model.arm_positions(world.joints))
        return self._contacts[world]

    def _place(self, world: World) -> PlacedScene:
        """See `placed`."""
        mounts, depths = self.model.tree.mounts, self.bound.depth
        bodies, carriers = list(self.bodies), [mounts[body.name] for body in self.bodies]
        clearance = [CLEARANCE] * len(bodies)
        for name, X_WO in world.X_WO.items():
            if name != world.held:
                of_object = self.object_bodies[name]
                bodies += of_object
                carriers += [Mount(-1, X_WO)] * len(of_object)
                clearance += [self._clearance[name]] * len(of_object)
        depth = [depths[body.name] for body in self.bodies] + [0] * (len(bodies) - len(self.bodies))
        rods = {i: self.bound.rods[body.name] for i, body in enumerate(self.bodies) if body.name in self.bound.rods}
        moving = [i for i, joints in enumerate(depth) if joints or i in rods]
        resting = range(len(self.bodies), len(bodies))
        pairs = [np.array(self.self_pairs, dtype=np.intp).reshape(-1, 2), _crossed(resting, moving)]
        if world.held is not None and world.X_TO is not None:
            hand = self.model.hand_links
            partners = [i for i, body in enumerate(bodies) if body.name not in hand]
            held = self.object_bodies[world.held]
            pairs.append(_crossed(range(len(bodies), len(bodies) + len(held)), partners)[:, ::-1])
            bodies += held
            carriers += [mounts[self.model.tool_frame].with_offset(world.X_TO)] * len(held)
            depth += [depths[self.model.tool_frame]] * len(held)
        inner, outer = np.concatenate(pairs).T.copy()
        placed = PlacedBodies.of(self._arrays, [self._rows[body] for body in bodies], depth, carriers, rods)
        body_pairs = BodyPairs.of(inner, outer, np.array(clearance)[inner], placed, self._low)
        fingers = self.model.finger_positions(world.joints)
        return PlacedScene(self.model, self.bound, self._low, placed, body_pairs, fingers)

    def supports(self, name: str, X_WO: Array, world: World) -> frozenset[str]:
        """Names of the objects that carry object `name` at `X_WO`: those it touches, but not once raised a little."""
        raised = pose(position=(0.0, 0.0, 3 * CLEARANCE)) @ X_WO
        return frozenset(
            other
            for other, X_WB in self._others_near(name, X_WO, world)
            if self._touch(name, X_WO, other, X_WB) and not self._touch(name, raised, other, X_WB)
        )

    def _others_near(self, name: str, X_WO: Array, world: World) -> list[tuple[str, Array]]:
        """The objects whose spheres meet those of an object at `X_WO`, with their poses."""
        others = [
            (other, X_WB, body)
            for other, X_WB in world.X_WO.items()
            if other not in (name, world.held)
            for body in self.object_bodies[other]
        ]
        rows = [self._rows[body] for _, _, body in others]
        X_WB = np.array([X_WB for _, X_WB, _ in others]).reshape(-1, 4, 4)
        centers = transform(X_WB, self._arrays.center[rows, None])[:, 0]
        near = np.zeros(len(others), dtype=bool)
        for body in self.object_bodies[name]:
            apart = norms(centers - transform(X_WO, body.center[None]))
            near |= apart < self._arrays.radius[rows] + body.radius + CLEARANCE
        return list({others[k][0]: others[k][:2] for k in np.flatnonzero(near).tolist()}.values())

    def _touch(self, first: str, X_WA: Array, second: str, X_WB: Array) -> bool:
        return any(
            distance_within(a.geometry, placement_at(X_WA @ a.X_PG), b.geometry, placement_at(X_WB @ b.X_PG), CLEARANCE)
            is not None
            for a in self.object_bodies[first]
            for b in self.object_bodies[second]
        )


def _crossed(first: Sequence[int], second: Sequence[int]) -> Indices:
    """All pairs of one of the first and one of the second, in this order, shape (P, 2)."""
    return np.stack([np.repeat(first, len(second)), np.tile(second, len(first))], axis=1).astype(np.intp)


@dataclass(frozen=True)
class SelfContacts:
    """Pairs of links, neither neighbours nor rigidly connected, by how they touch: closer than the clearance."""

    at_home: NamePairs
    """At the home position."""
    always: NamePairs
    """In `ALWAYS` of the positions tried, or more. Both belong to the robot and are not checked."""
    never: NamePairs
    """In none of them; that proves little, so they are still checked."""

    @property
    def unchecked(self) -> NamePairs:
        """The pairs whose contact is not checked."""
        return self.at_home | self.always


def find_self_contacts(model: RobotModel, seed: int) -> SelfContacts:
    """Try `SAMPLES` positions that depend on `seed` alone; joints without limits turn once, slide 1 m either way."""
    scene = CollisionScene(model, ())
    fingers = dict(zip(model.fingers.joints, model.fingers.open.tolist(), strict=True))
    placed = scene.placed(World(facts=frozenset(), X_WO={}, held=None, X_TO=None, joints=fingers))
    half = np.where(model.turns, np.pi, 1.0)
    lower = np.where(np.isfinite(model.lower), model.lower, model.home - half)
    upper = np.where(np.isfinite(model.upper), model.upper, model.home + half)
    drawn = lower + (upper - lower) * np.random.default_rng(seed).random((SAMPLES, len(model.arm)))
    home, *touching = placed.touching_pairs(np.concatenate([model.home[None], drawn]))
    pairs = frozenset(pair(scene.bodies[i].name, scene.bodies[j].name) for i, j in scene.self_pairs)
    counts = {names: sum(names in found for found in touching) for names in pairs}
    return SelfContacts(
        at_home=home,
        always=frozenset(names for names, count in counts.items() if count >= ALWAYS * SAMPLES),
        never=frozenset(names for names, count in counts.items() if count == 0 and names not in home),
    )
