"""Collisions of the arm, its tool and the held object with themselves and the cell, proven continuously along paths.

Two solids are proven apart over a stretch of a path if their distance in its middle exceeds a bound of their relative
motion within it. Other stretches are halved until a contact is found. The kernel does this: `kernel/collision.hpp`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import chain, compress
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, Indices, inverse, pose, transform
from sqrp_cli.kernel import kernel
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel, positions_of
from sqrp_cli.sight.solids import Solid, distance, load_solid, load_solids, scale_doubt
from sqrp_cli.trajectory import JointPath

CLEARANCE = 1e-3
"""Distance that the arm keeps from everything [m]; the workspace's padding adds to it for fixed objects."""
SAMPLES = 200  # joint positions that are tried, spread over the limits of the joints
ALWAYS = 0.95  # share of the positions in which a pair must touch to count as always touching
RESOLUTION = 0.5e-3  # two solids that may violate the clearance within a motion of less than this [m] count as touching
FIRST_LOOK = 9  # positions along a path that `PlacedScene.is_free` checks before the proof
NamePairs = frozenset[tuple[str, str]]  # pairs of names of links or objects, each in alphabetical order


@dataclass(frozen=True)
class Contact:
    """Two links or objects that come closer than the clearance (or could, by less than a resolution of motion)."""

    first: str
    second: str  # Names of links or objects, the outer one of the arm first
    s: float = 0.0  # position on the path, in [0, 1]
    clearance: float = CLEARANCE  # distance that they have to keep [m]
    doubt: str = ""  # what makes the size of one of them doubtful, if anything does

    def __str__(self) -> str:
        hits = f"{self.first} hits {self.second}"
        if self.clearance > CLEARANCE:
            hits = f"{self.first} comes closer to {self.second} than {self.clearance:.3g} m"
        return f"{hits} ({self.doubt})" if self.doubt else hits


def pair(first: str, second: str) -> tuple[str, str]:
    """Two names in alphabetical order."""
    return (first, second) if first < second else (second, first)


@dataclass(frozen=True, eq=False)
class PlacedScene:
    """A collision scene with every object in its place: B solids, and P pairs of them that must not touch."""

    model: RobotModel
    spine: Sequence[int]
    rods: Mapping[str, tuple[int, ...]]
    radii: Array  # What moves each link, as `CollisionScene` says
    solids: tuple[Solid, ...]
    frame: Indices  # the joint that carries the parent of each, -1 for none, shape (B,)
    X_FP: Array  # pose of the parent of each on that, shape (B, 4, 4)
    depth: tuple[int, ...]  # how many joints of the spine move each
    inner: Indices
    outer: Indices  # Indices of the solids of each pair, the outer one of the arm in `outer`, shape (P,)
    clearance: Array  # distance that each pair has to keep [m], shape (P,)
    fingers: Array  # positions of the fingers' joints, shape (f,)
    doubts: Mapping[str, str] = field(default_factory=dict)  # what makes the sizes of some objects doubtful, by name

    def check(self, q: Array) -> Contact | None:
        """A contact at joint positions q, shape (n,), or None when everything keeps its clearance."""
        return self.check_all(q[None])[0]

    def check_all(self, q: Array) -> tuple[Contact | None, ...]:
        """A contact, or None, at each of m joint positions, shape (m, n); of several, that of the last pair."""
        touching = self._kernel.touching(self.model.with_fingers(q, self.fingers), every=False)
        return tuple(self._contact(int(row.nonzero()[0][-1])) if row.any() else None for row in touching)

    def is_free(self, path: JointPath, spare: float = RESOLUTION) -> bool:
        """Whether a path keeps every clearance at all times, as `check_path` proves; blocked ones are found sooner.

        spare: what the proof may require beyond the clearance [m]; a larger value is faster.
        """
        samples = path.positions(np.linspace(0.0, 1.0, FIRST_LOOK))
        return not any(self.check_all(samples)) and self.check_path(path, spare) is None

    def check_fingers(self, q: Array, fingers: Array) -> Contact | None:
        """The first contact while the fingers move evenly to positions (f,) and the arm stands at q, shape (n,).

        The fingers are checked at steps of at most `RESOLUTION`.
        """
        share = np.linspace(0.0, 1.0, 1 + finger_steps(self.model, self.fingers, fingers, RESOLUTION))
        positions = self.fingers + share[:, None] * (fingers - self.fingers)
        found = self._kernel.touching(np.concatenate([np.tile(q, (len(share), 1)), positions], axis=1), every=True)
        if not found.any():
            return None
        step, k = (int(index[0]) for index in found.nonzero())
        return self._contact(k, float(share[step]))

    def check_path(self, path: JointPath, resolution: float = RESOLUTION) -> Contact | None:
        """The first contact along a path; None proves that there is none, not only at samples.

        None: all pairs keep their clearance everywhere. A contact: there a pair is closer than its clearance plus
        `resolution` [m]; the path keeps the clearance up to there.
        """
        pieces = path.breaks, path.coefficients, path.derivative_bounds()
        found = self._kernel.first_contact(*pieces, self.fingers, resolution)
        return None if found is None else self._contact(*found)

    def _contact(self, k: int, s: float = 0.0) -> Contact:
        """That of a pair, by its index."""
        first, second = (self.solids[index[k]].part.parent for index in (self.outer, self.inner))
        doubt = self.doubts.get(first) or self.doubts.get(second, "")
        return Contact(first, second, s, float(self.clearance[k]), doubt)

    @cached_property
    def _kernel(self) -> kernel.Collisions:
        """The scene as the kernel reads it."""
        tree = self.model.tree
        rods = [self.rods.get(solid.part.parent, ()) for solid in self.solids]
        whole = {
            "parents": tree.parents, "turns": tree.turns, "spine": self.spine, "depth": self.depth,
            "frame": self.frame, "rods_from": np.cumsum([0, *map(len, rods)]),
            "rods": [joint for joints in rods for joint in joints], "inner": self.inner, "outer": self.outer,
        }  # fmt: skip
        real = {
            "axes": tree.axes, "terms": tree.terms, "ratios": tree.ratios, "offsets": tree.offsets,
            "radii": self.radii, "X_FP": self.X_FP, "clearance": self.clearance,
        }  # fmt: skip
        return kernel.Collisions([solid.compiled for solid in self.solids], whole, real)


def finger_steps(model: RobotModel, start: Array, end: Array, step: float) -> int:
    """Number of equal steps of the fingers from start to end, (f,) each, so that no point moves over `step` [m].

    At least 1. Measured at the boxes around the solids, along 33 positions.
    """
    fingers = start + np.linspace(0.0, 1.0, 33)[:, None] * (end - start)
    poses = model.link_poses(np.concatenate([np.tile(model.home, (33, 1)), fingers], axis=1))
    parts = [part for part in model.parts if part.parent in model.fingers.links]
    corners = [transform(poses[part.parent], load_solid(part).corners) for part in parts]
    longest = max((float(np.linalg.norm(np.diff(c, axis=0), axis=-1).max()) for c in corners), default=0.0)
    return max(1, int(np.ceil(32 * longest / step)))


class CollisionScene:
    """The solids of robot, tool and objects; `placed` puts the objects at their poses in a world.

    What moves each link follows from the axes of the joints; the kernel computes the bounds themselves
    (`Places::bound`). The spine are the joints on the way to the tool frame, those included that follow others. Rods,
    as those of a parallel linkage, hang on joints beside it that follow joints of the arm.

    spine: index of each joint of the spine among all of the robot, s of them.
    depth: for every link of robot and tool, how many joints of the spine move it: the first `depth` ones.
    rods: the joints beside the spine that move a link with the arm, from the spine outwards, by link; most have none.
    radii: distance [m] of the outermost link from the axis of each of the arm's n joints at one configuration, shape
    (n,); 1 for a prismatic joint. A measure of size, not a bound.
    """

    def __init__(
        self,
        model: RobotModel,
        objects: Iterable[SceneObject],
        disabled_pairs: Iterable[tuple[str, str]] = (),
        padding: float = 0.0,
    ) -> None:
        """Find what moves each link, and load every solid.

        disabled_pairs: pairs of links that are not checked, beside those that are fixed to each other or neighbours
        across one joint. padding: extra clearance from fixed objects [m]. Raises InputError for an unusable mesh.
        """
        self.model, tree, n = model, model.tree, len(model.arm)
        ratios = np.abs(tree.ratios[:, :n])  # how far each joint moves with each of the arm's
        driven = set(np.flatnonzero(ratios.any(axis=1)).tolist())
        self.spine = [joint for joint in tree.chain(model.tool_frame) if joint in driven]
        moved_by = {link: [joint for joint in tree.chain(link) if joint in driven] for link in tree.mounts}
        depth = self.depth = {link: sum(joint in self.spine for joint in by) for link, by in moved_by.items()}
        beside = {link: tuple(joint for joint in by if joint not in self.spine) for link, by in moved_by.items()}
        rods = self.rods = {link: joints for link, joints in beside.items() if joints}
        q = np.asarray(model.home) + 0.1 * np.arange(1, n + 1)
        frames = tree.poses(tree.positions(model.with_fingers(q[None])))[0, self.spine]
        origins = np.stack([X_WL[0, :3, 3] for X_WL in model.link_poses(q[None]).values()])
        axes = (frames[:, :3, :3] @ tree.axes[self.spine][:, :, None])[..., 0]
        distances = np.linalg.norm(np.cross(origins - frames[:, None, :3, 3], axes[:, None]), axis=-1).max(axis=1)
        self.radii: Array = ratios[self.spine].T @ np.where(tree.turns[self.spine], distances, 1.0)
        # The solids, and which pairs of the robot's own must not touch.
        self.solids = load_solids(model.parts)
        objects = tuple(objects)
        self.objects = {obj.name: obj for obj in objects}
        self.object_solids = {obj.name: load_solids(obj.parts) for obj in objects}
        skipped = {pair(*names) for names in (*disabled_pairs, *model.adjacent_pairs)}
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
        self._reach = {
            name: max((float(np.linalg.norm(one.center)) + one.radius for one in solids), default=0.0)
            for name, solids in self.object_solids.items()
        }
        """How far each object reaches from its origin at most [m]."""
        self._placed: WeakKeyDictionary[World, PlacedScene] = WeakKeyDictionary()
        self._contacts: WeakKeyDictionary[World, str] = WeakKeyDictionary()

    def placed(self, world: World, allowed: NamePairs = frozenset()) -> PlacedScene:
        """The scene with every object where `world` has it; contacts of `allowed` pairs do not count.

        The held object moves with the tool and may touch it. Objects of unknown pose are left out.
        """
        if world not in self._placed:
            tree = self.model.tree
            solids, clearance = list(self.solids), [CLEARANCE] * len(self.solids)
            names = [solid.part.parent for solid in solids]
            mounts, depth = [tree.mounts[name] for name in names], [self.depth[name] for name in names]
            moving = [i for i, name in enumerate(names) if self.depth[name] or name in self.rods]
            for name, X_WO in world.X_WO.items():
                if name != world.held:
                    of_object = self.object_solids[name]
                    solids += of_object
                    mounts += [(-1, X_WO)] * len(of_object)
                    clearance += [self._clearance[name]] * len(of_object)
            depth += [0] * (len(solids) - len(depth))
            # Every object against every solid that moves: hundreds times dozens.
            fixed, own = np.arange(len(names), len(solids)), np.reshape(self.self_pairs, (-1, 2)).astype(np.int64)
            inner = np.concatenate([own[:, 0], np.repeat(fixed, len(moving))])
            outer = np.concatenate([own[:, 1], np.tile(moving, len(fixed)).astype(np.int64)])
            if world.held is not None and world.X_TO is not None:
                held, hand = self.object_solids[world.held], self.model.hand_links
                partners = [i for i, solid in enumerate(solids) if solid.part.parent not in hand]
                inner = np.concatenate([inner, np.tile(partners, len(held)).astype(np.int64)])
                outer = np.concatenate([outer, np.repeat(np.arange(len(held)) + len(solids), len(partners))])
                solids += held
                carrier, X_JT = tree.mounts[self.model.tool_frame]
                mounts += [(carrier, X_JT @ world.X_TO)] * len(held)
                depth += [self.depth[self.model.tool_frame]] * len(held)
            self._placed[world] = PlacedScene(
                model=self.model,
                spine=self.spine,
                rods=self.rods,
                radii=self.radii,
                solids=tuple(solids),
                frame=np.array([joint for joint, _ in mounts], dtype=np.int64),
                X_FP=np.array([X_JP for _, X_JP in mounts]).reshape(-1, 4, 4),
                depth=tuple(depth),
                inner=inner,
                outer=outer,
                clearance=np.array(clearance)[inner],
                fingers=positions_of(self.model.fingers.joints, world.joints),
                doubts=self._doubts,
            )
        scene = self._placed[world]
        if not allowed:
            return scene
        names, named = [solid.part.parent for solid in scene.solids], set(chain.from_iterable(allowed))
        some = np.array([name in named for name in names], dtype=bool)
        kept = ~(some[scene.inner] & some[scene.outer])
        for k in np.flatnonzero(~kept).tolist():
            kept[k] = pair(names[scene.inner[k]], names[scene.outer[k]]) not in allowed
        return replace(scene, inner=scene.inner[kept], outer=scene.outer[kept], clearance=scene.clearance[kept])

    def contact_in(self, world: World) -> str:
        """A contact in a world before anything moves; empty when everything keeps its clearance.

        An object of a doubtful size counts as touching an arm that is inside it, too: it is everywhere, so that paths
        would be searched in vain, or around a few of its faces.
        """
        if world not in self._contacts:
            q = positions_of(self.model.arm, world.joints)
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
        places = np.array([X[:3, 3] for X in world.X_WO.values()]) - X_WO[:3, 3]
        reach = np.array([self._reach[other] for other in world.X_WO]) + self._reach[name] + CLEARANCE
        return frozenset(
            other
            for other in compress(world.X_WO, (np.linalg.norm(places, axis=1) <= reach).tolist())
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


def find_self_contacts(model: RobotModel, seed: int) -> tuple[NamePairs, NamePairs]:
    """Pairs of links, neither neighbours nor rigidly connected, that touch by design, and those that do in no position.

    By design touch those that come closer than the clearance at home, or in `ALWAYS` of the positions tried: they
    belong to the robot and are not checked. That others never did proves little, so they are still checked. `SAMPLES`
    positions are tried, which depend on `seed` alone; joints without limits turn once, slide 1 m either way.
    """
    scene = CollisionScene(model, ())
    fingers = dict(zip(model.fingers.joints, model.fingers.open.tolist(), strict=True))
    placed = scene.placed(World(facts=frozenset(), X_WO={}, held=None, X_TO=None, joints=fingers))
    half = np.where(model.turns, np.pi, 1.0)
    lower = np.where(np.isfinite(model.lower), model.lower, model.home - half)
    upper = np.where(np.isfinite(model.upper), model.upper, model.home + half)
    drawn = lower + (upper - lower) * np.random.default_rng(seed).random((SAMPLES, len(model.arm)))
    q = placed.model.with_fingers(np.concatenate([model.home[None], drawn]), placed.fingers)
    names = [solid.part.parent for solid in placed.solids]
    each = [pair(names[i], names[j]) for i, j in zip(placed.inner.tolist(), placed.outer.tolist(), strict=True)]
    home, *touching = (frozenset(compress(each, row.tolist())) for row in placed._kernel.touching(q, every=True))
    pairs = frozenset(pair(scene.solids[i].part.parent, scene.solids[j].part.parent) for i, j in scene.self_pairs)
    counts = {names: sum(names in found for found in touching) for names in pairs}
    always = frozenset(names for names, count in counts.items() if count >= ALWAYS * SAMPLES)
    return home | always, frozenset(names for names, count in counts.items() if count == 0 and names not in home)
