"""The solids of robot, tool and objects, the pairs that must not touch, and links that touch by design."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, inverse, pose, transform
from sqrp_cli.motion.placed_scene import CLEARANCE, MotionBound, NamePairs, PlacedScene, pair
from sqrp_cli.records import dataclass
from sqrp_cli.robot.joint_tree import Mount
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.sight.solids import distance, load_solids, scale_doubt

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
        self.solids = load_solids(model.parts)
        objects = tuple(objects)
        self.object_solids = {obj.name: load_solids(obj.parts) for obj in objects}
        skipped = {pair(*names) for names in (*disabled_pairs, *model.adjacent_pairs)}
        depth, rods = self.bound.depth, self.bound.rods
        names = [solid.part.parent for solid in self.solids]
        self.self_pairs = tuple(
            (i, j) if depth[a] < depth[b] else (j, i)
            for i, a in enumerate(names)
            for j, b in enumerate(names[:i])
            if depth[a] != depth[b]
            and pair(a, b) not in skipped
            and not {a, b} & rods.keys()  # rods pass the links that they are made for
        )
        self._doubts = {
            obj.name: f"{doubt}: perhaps it is in millimetres, say `scale: 0.001`"
            for obj in objects
            for solid in self.object_solids[obj.name]
            if (doubt := scale_doubt(solid, obj)) and solid.diagonal > max(obj.size)
        }
        self._clearance = {obj.name: CLEARANCE + (padding if obj.fixed else 0.0) for obj in objects}
        self._placed: WeakKeyDictionary[World, PlacedScene] = WeakKeyDictionary()
        self._contacts: WeakKeyDictionary[World, str] = WeakKeyDictionary()

    def placed(self, world: World, allowed: NamePairs = frozenset()) -> PlacedScene:
        """The scene with every object where `world` has it; contacts of `allowed` pairs do not count.

        The held object moves with the tool and may touch it. Objects of unknown pose are left out.
        """
        if world not in self._placed:
            tree, bound = self.model.tree, self.bound
            solids, clearance = list(self.solids), [CLEARANCE] * len(self.solids)
            names = [solid.part.parent for solid in solids]
            mounts, depth = [tree.mounts[name] for name in names], [bound.depth[name] for name in names]
            moving = [i for i, name in enumerate(names) if bound.depth[name] or name in bound.rods]
            for name, X_WO in world.X_WO.items():
                if name != world.held:
                    of_object = self.object_solids[name]
                    solids += of_object
                    mounts += [Mount(-1, X_WO)] * len(of_object)
                    clearance += [self._clearance[name]] * len(of_object)
            depth += [0] * (len(solids) - len(depth))
            pairs = [*self.self_pairs, *product(range(len(names), len(solids)), moving)]
            if world.held is not None and world.X_TO is not None:
                held, hand = self.object_solids[world.held], self.model.hand_links
                partners = [i for i, solid in enumerate(solids) if solid.part.parent not in hand]
                pairs += [(i, k) for k in range(len(solids), len(solids) + len(held)) for i in partners]
                solids += held
                mounts += [tree.mounts[self.model.tool_frame].with_offset(world.X_TO)] * len(held)
                depth += [bound.depth[self.model.tool_frame]] * len(held)
            inner, outer = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
            self._placed[world] = PlacedScene(
                model=self.model,
                bound=bound,
                solids=tuple(solids),
                mounts=tuple(mounts),
                depth=tuple(depth),
                inner=inner,
                outer=outer,
                clearance=np.array(clearance)[inner],
                fingers=self.model.finger_positions(world.joints),
                doubts=self._doubts,
            )
        return self._placed[world].allowing(allowed) if allowed else self._placed[world]

    def contact_in(self, world: World) -> str:
        """A contact in a world before anything moves; empty when everything keeps its clearance.

        An object of a doubtful size counts as touching an arm that is inside it, too: it is everywhere, so that paths
        would be searched in vain, or around a few of its faces.
        """
        if world not in self._contacts:
            q = self.model.arm_positions(world.joints)
            contact, joints = self.placed(world).check(q), self.model.joint_origins(q)
            said = "" if contact is None else str(contact)
            for name, doubt in self._doubts.items():
                if not said and name in world.X_WO and name != world.held:
                    corners = np.concatenate([solid.vertices for solid in self.object_solids[name]])
                    local = transform(inverse(world.X_WO[name]), joints)
                    if ((corners.min(axis=0) < local) & (local < corners.max(axis=0))).all():
                        said = f"the arm is inside {name} ({doubt})"
            self._contacts[world] = said
        return self._contacts[world]

    def supports(self, name: str, X_WO: Array, world: World) -> frozenset[str]:
        """Names of the objects that carry object `name` at `X_WO`: those it touches, but not once raised a little."""
        raised = pose(position=(0.0, 0.0, 3 * CLEARANCE)) @ X_WO
        return frozenset(
            other
            for other in world.X_WO
            if other not in (name, world.held)
            and self.touch(name, X_WO, other, world)
            and not self.touch(name, raised, other, world)
        )

    def touch(self, name: str, X_WO: Array, other: str, world: World) -> bool:
        """Whether object `name`, if at `X_WO`, is closer to another one than the clearance."""
        return any(
            distance(one, X_WO, two, world.X_WO[other], CLEARANCE, CLEARANCE) is not None
            for one in self.object_solids[name]
            for two in self.object_solids[other]
        )


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
    pairs = frozenset(pair(scene.solids[i].part.parent, scene.solids[j].part.parent) for i, j in scene.self_pairs)
    counts = {names: sum(names in found for found in touching) for names in pairs}
    return SelfContacts(
        at_home=home,
        always=frozenset(names for names, count in counts.items() if count >= ALWAYS * SAMPLES),
        never=frozenset(names for names, count in counts.items() if count == 0 and names not in home),
    )
