"""Collision checks, against pairwise coal at a finer step than the check ever used."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, permutations
from pathlib import Path

import coal
import numpy as np
import pytest

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, axis_rotation, pose, transform
from sqrp_cli.motion.collision import (
    CLEARANCE,
    RESOLUTION,
    CollisionScene,
    Contact,
    PlacedScene,
    find_self_contacts,
    pair,
)
from sqrp_cli.motion.ground_primitives import _contact_share
from sqrp_cli.motion.tool_path import tool_line
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Mesh, Part, Sphere
from sqrp_cli.sight.solids import load_solid, load_solids
from sqrp_cli.trajectory import JointPath
from tests.coal_geometry import coal_geometry
from tests.motion.cells import thing
from tests.task.robots import LINKAGES, joint, robot, written_urdf

READY = np.array([0.3, -1.6, 1.9, -1.9, -1.6, 0.2])


TABLE = thing("table", (1.4, 1.8, 0.04), pose(position=(0.35, 0, -0.02)))
CUBE = thing("cube", (0.04, 0.04, 0.04), pose(position=(0.45, -0.25, 0.02)), fixed=False)
POST = thing("post", (0.03, 0.03, 0.6), pose(axis_rotation(2, 0.4), (0.45, 0.3, 0.3)))
SHELF = thing("shelf", (0.3, 0.5, 0.01), pose(axis_rotation(0, 0.2), (-0.1, 0.5, 0.5)))
THINGS = (TABLE, CUBE, POST, SHELF)


def world(things: Iterable[SceneObject] = THINGS, held: str | None = None, X_TO: Array | None = None) -> World:
    return World(frozenset(), {t.name: t.X_WO for t in things if t.X_WO is not None}, held, X_TO, {})


@pytest.fixture(scope="module")
def scene(ur5: RobotModel) -> CollisionScene:
    return CollisionScene(ur5, THINGS)


class BruteForce:
    """Every pair of parts, one after the other, with the meshes themselves."""

    def __init__(self, model: RobotModel, state: World, margin: float) -> None:
        self.model = model
        self.request = coal.CollisionRequest()
        self.request.security_margin = margin
        depth = CollisionScene(model, ()).depth
        parts = [(part, coal_geometry(load_solid(part)), None) for part in model.parts]
        for t in THINGS:
            frame = state.X_TO if t.name == state.held else state.X_WO[t.name]
            parts += [(part, coal_geometry(load_solid(part)), frame) for part in t.parts]
        self.parts, self.held = parts, state.held
        rigid = {part.parent: depth.get(part.parent, 0) for part, *_ in parts}
        if state.held is not None:
            rigid[state.held] = 99
        ignored = model.adjacent_pairs | {pair(state.held or "", link) for link in model.tool_links}
        self.pairs = [
            (i, j)
            for (i, (a, *_)), (j, (b, *_)) in combinations(enumerate(parts), 2)
            if rigid[a.parent] != rigid[b.parent] and pair(a.parent, b.parent) not in ignored
        ]

    def contacts(self, q: Array) -> set[tuple[str, str]]:
        links, found = self.model.link_poses(q[None]), set()
        placements = []
        for part, _, frame in self.parts:
            if frame is None:
                X = links[part.parent][0]
            else:
                X = links[self.model.tool_frame][0] @ frame if part.parent == self.held else frame
            X = X @ part.X_PG
            placements.append(coal.Transform3s(X[:3, :3], X[:3, 3]))
        for i, j in self.pairs:
            result = coal.CollisionResult()
            if coal.collide(self.parts[i][1], placements[i], self.parts[j][1], placements[j], self.request, result):
                found.add(pair(self.parts[i][0].parent, self.parts[j][0].parent))
        return found


def test_single_configurations_agree_with_every_pair_tried(ur5, scene):
    placed, brute = scene.placed(world()), BruteForce(ur5, world(), CLEARANCE)
    rng = np.random.default_rng(0)
    q = READY + rng.uniform(-1, 1, (150, 6)) * [3, 0.8, 0.9, 2, 2, 3]
    contacts = placed.check_all(q)
    hits = 0
    for at, contact in zip(q, contacts, strict=True):
        truth = brute.contacts(at)
        assert (contact is None) == (not truth)
        if contact is not None:
            assert pair(contact.first, contact.second) in truth
            hits += 1
    assert 20 < hits < 130


@pytest.mark.parametrize("kind", ["straight", "held", "curved"])
def test_motions_agree_with_a_fine_step(ur5, scene, kind):
    state = world(held="cube", X_TO=pose(position=(0, 0, 0.02))) if kind == "held" else world()
    placed = scene.placed(state)
    touching, near = BruteForce(ur5, state, CLEARANCE), BruteForce(ur5, state, CLEARANCE + 2 * RESOLUTION)
    rng, kinds = np.random.default_rng(1), {True: 0, False: 0}
    for _ in range(12 if kind == "curved" else 25):
        path = JointPath.line(READY, READY + rng.uniform(-1, 1, 6) * [1.5, 0.6, 0.8, 1, 1, 2])
        if kind == "curved":  # of two pieces
            coefficients = rng.uniform(-0.5, 0.5, (2, 5, 6)) * [1.2, 0.5, 0.6, 0.8, 0.8, 1]
            path = JointPath(np.array([0.0, 0.3, 1.0]), coefficients / (1 + np.arange(5))[:, None]).shifted(READY)
        contact = placed.check_path(path)
        s = np.linspace(0, 1, 200)
        before = s if contact is None else s[s < contact.s - 2e-3]
        assert not any(touching.contacts(q) for q in path.positions(before))
        if contact is not None:
            assert pair(contact.first, contact.second) in near.contacts(path.positions([contact.s])[0])
        kinds[contact is None] += 1
    assert min(kinds.values()) >= 3


def test_a_plate_far_thinner_than_any_sampling_step_is_found(ur5):
    """Swing the shoulder through a plate of 0.1 mm in the way of the tool; names and place are worked out by hand."""
    swing = np.array([1.2, 0, 0, 0, 0, 0])
    tip = ur5.tool_pose(READY + swing / 2)[:3, 3]
    across = axis_rotation(2, float(np.arctan2(tip[1], tip[0])))
    plate = thing("plate", (0.02, 0.0001, 0.02), pose(across, tip))
    contact = CollisionScene(ur5, [plate]).placed(world([plate])).check_path(JointPath.line(READY, READY + swing))
    assert str(contact) == "suction_cup hits plate"
    radius = np.linalg.norm(tip[:2])
    assert contact.s == pytest.approx(0.5 - (0.016 + CLEARANCE) / radius / 1.2, abs=0.005)


def test_the_clearance_is_kept_and_padding_adds_to_it_for_fixed_objects_only(ur5):
    tip = ur5.tool_pose(READY)[:3, 3]

    def hits(gap: float, fixed: bool, padding: float) -> bool:
        block = thing("block", (0.1, 0.1, 0.1), pose(position=tip - [0, 0, 0.05 + gap]), fixed)
        X_down = ur5.tool_pose(READY)
        assert X_down[2, 2] < -0.9
        flat = CollisionScene(ur5, [block], padding=padding).placed(world([block]))
        return flat.check(READY) is not None

    lowest = lowest_of_the_tool(ur5) - tip[2]
    assert not hits(-lowest + 1.2e-3, True, 0.0)
    assert hits(-lowest + 0.8e-3, True, 0.0)
    assert hits(-lowest + 5.8e-3, True, 5e-3)
    assert not hits(-lowest + 6.2e-3, True, 5e-3)
    assert not hits(-lowest + 1.2e-3, False, 5e-3)


def lowest_of_the_tool(model: RobotModel) -> float:
    """Height of the lowest point of the suction cup's rim at READY [m]."""
    X = model.tool_pose(READY)
    angles = np.linspace(0, 2 * np.pi, 2000)
    rim = np.column_stack([0.016 * np.cos(angles), 0.016 * np.sin(angles), np.zeros(len(angles))])
    return float(transform(X, rim)[:, 2].min())


def test_allowed_pairs_and_unknown_objects_do_not_count(ur5, scene):
    inside = thing("cube", CUBE.size, pose(position=ur5.tool_pose(READY)[:3, 3]), fixed=False)
    state = world([TABLE, inside])
    contact = scene.placed(state).check(READY)
    assert contact.second == "cube"
    allowed = frozenset(pair(link, "cube") for link in ur5.tool_links)
    assert scene.placed(state, allowed).check(READY) is None
    assert scene.placed(world([TABLE])).check(READY) is None


def test_a_held_object_collides_with_what_the_tool_would_miss(ur5):
    rod = thing("rod", (0.02, 0.02, 0.6), None, fixed=False)
    scene = CollisionScene(ur5, [TABLE, rod])
    state = world([TABLE], held="rod", X_TO=pose(position=(0, 0, 0.3)))
    contact = scene.placed(state).check(READY)
    assert (contact.first, contact.second) == ("rod", "table")
    assert scene.placed(world([TABLE])).check(READY) is None


def test_what_carries_an_object_is_reported_from_what_stands_beside_it(ur5):
    beside = thing("beside", CUBE.size, pose(position=(0.49, -0.25, 0.02)), fixed=False)
    scene = CollisionScene(ur5, [TABLE, CUBE, beside])
    assert scene.supports("cube", CUBE.X_WO, world([TABLE, CUBE, beside])) == {"table"}
    assert scene.supports("cube", pose(position=(0, 0, 0.002)) @ CUBE.X_WO, world([TABLE, CUBE, beside])) == frozenset()


def test_disabled_pairs_are_not_checked(ur5):
    folded = np.array([0.0, -1.6, 3.0, -1.6, -1.6, 0.0])
    assert CollisionScene(ur5, []).placed(world([])).check(folded) is not None
    skipped = [pair(a, b) for a, b in combinations(ur5.links, 2)]
    assert CollisionScene(ur5, [], skipped).placed(world([])).check(folded) is None


def test_a_contact_says_whether_it_is_one_or_only_too_close():
    assert str(Contact("forearm_link", "table")) == "forearm_link hits table"
    assert str(Contact("cup", "table", 0.5, 0.051)) == "cup comes closer to table than 0.051 m"


def arm(folder: Path, home: float) -> RobotModel:
    """Three joints about z, 0.3 m apart; a long bar on the last link, and a disc around the first joint on the third.

    The bar of `l3` sweeps over the post of `base` only where the arm is folded; the disc of `l2` always covers the
    block on the base, whichever way it turns.
    """
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    chain = zip(("base", "l1", "l2", "l3"), ("0 0 0.2", "0 0 0.1", "0.3 0 0.1"), strict=False)
    joints = [
        joint(f"j{k}", parent, f"l{k}", "revolute", at, "0 0 1", limit) for k, (parent, at) in enumerate(chain, 1)
    ]

    def link(name: str, shape: str, xyz: str) -> str:
        return f'<link name="{name}"><collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision></link>'

    links = [
        link("base", '<box size="0.1 0.1 0.29"/>', "0 0 0.145"),
        link("l1", '<sphere radius="0.02"/>', "0 0 0.5"),
        link("l2", '<cylinder radius="0.2" length="0.05"/>', "0 0 0"),
        link("l3", '<box size="0.3 0.02 0.02"/>', "0.15 0 -0.15"),
    ]
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(links)}{"".join(joints)}</robot>')
    return RobotModel.load(robot(path, "l3", home={"j1": 0.0, "j2": 0.0, "j3": home}))


def test_pairs_that_always_touch_or_touch_at_home_are_reported_from_those_that_never_do(tmp_path):
    always, never = find_self_contacts(arm(tmp_path, home=0.0), seed=0)
    assert (always, never) == ({("base", "l2")}, {("l1", "l3")})
    assert find_self_contacts(arm(tmp_path, home=3.0), seed=0)[0] == {("base", "l2"), ("base", "l3")}


def test_a_move_onto_a_mesh_ends_at_its_nearest_triangles(ur5, tmp_path):
    """A stand is a small sheet above a large one, the arm holds a sheet; the surfaces meet after 10 cm of 28."""

    def sheets(name: str, *heights_and_halves: tuple[float, float]) -> Mesh:
        lines = [
            f"v {x * half} {y * half} {z}"
            for z, half in heights_and_halves
            for x, y in [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        ]
        lines += [f"f {k} {k + 1} {k + 2}\nf {k} {k + 2} {k + 3}" for k in range(1, len(lines), 4)]
        (tmp_path / name).write_text("\n".join(lines))
        return Mesh(tmp_path / name)

    def of(name: str, mesh: Mesh, X_WO: Array | None) -> SceneObject:
        part = Part(name, name, mesh, np.eye(4))
        return SceneObject(name=name, type="thing", size=(1.0, 1.0, 1.0), pose=X_WO, fixed=True, parts=(part,))

    stand = of("stand", sheets("stand.obj", (0.0, 0.05), (-0.2, 0.5)), pose(position=(0.4, 0.0, 0.3)))
    scene = CollisionScene(ur5, [stand, of("held", sheets("held.obj", (0.0, 0.02)), None)])
    world = World(frozenset(), {"stand": stand.X_WO}, "held", pose(position=(0.0, 0.0, 0.2)), {})
    down = np.diag([1.0, -1.0, -1.0])
    line = tool_line(pose(down, (0.4, 0.0, 0.6)), pose(down, (0.4, 0.0, 0.32)))
    assert _contact_share(scene, world, line, "stand") == pytest.approx(0.1 / 0.28, abs=1e-4)


WORLD, RADIUS = "world", 0.1


class Balls:
    """A ball around the origin of each of some links and of the world, and the bounds of every pair's motion."""

    def __init__(self, model: RobotModel, links: list[str]) -> None:
        self.model, self.links, whole = model, [*links, WORLD], CollisionScene(model, ())
        mounts, depth = {**model.tree.mounts, WORLD: (-1, pose())}, {**whole.depth, WORLD: -1}
        ordered = permutations(range(len(self.links)), 2)
        self.pairs = [(i, j) for i, j in ordered if depth[self.links[i]] < depth[self.links[j]]]  # the inner one first
        inner, outer = np.array(self.pairs).T
        balls = load_solids([Part(link, link, Sphere(RADIUS), pose()) for link in self.links])
        self.scene = PlacedScene(
            model=model, spine=whole.spine, rods=whole.rods, radii=whole.radii, solids=balls,
            clearance=np.zeros(len(inner)), fingers=np.zeros(0),
            frame=np.array([mounts[link][0] for link in self.links]), inner=inner, outer=outer,
            X_FP=np.array([mounts[link][1] for link in self.links]),
            depth=tuple(max(0, depth[link]) for link in self.links),
        )  # fmt: skip

    def poses(self, q: Array) -> dict[str, Array]:
        found = self.model.link_poses(q)
        return {link: found[link] if link != WORLD else np.broadcast_to(pose(), (len(q), 4, 4)) for link in self.links}

    def tightest(self, q: Array, variation: Array, rng: np.random.Generator) -> float:
        """The largest share of its bound that a pair's motion takes, at random positions within the variation."""
        before, after = self.poses(q[None]), self.poses(q + rng.choice([-1.0, 1.0], (50, len(q))) * variation)
        directions = rng.normal(size=(30, 3))
        points = RADIUS * directions / np.linalg.norm(directions, axis=1)[:, None]
        shares = [0.0]
        for (i, j), bound in zip(self.pairs, self.scene._kernel.motion_bounds(q, variation), strict=True):
            inner, outer = self.links[i], self.links[j]
            here, there = (
                np.linalg.norm(transform(X[outer], points) - transform(X[inner], points[::-1]), axis=-1)
                for X in (before, after)
            )
            change = np.abs(there - here).max()
            assert change <= bound + 1e-12, (inner, outer)
            shares.append(change / max(bound, 1e-12))
        return max(shares)


@pytest.mark.parametrize("size", [0.01, 0.3, 1.5])
def test_no_two_points_of_an_arm_or_the_world_come_closer_than_their_bound_says(ur5, size):
    balls, rng = Balls(ur5, ["upper_arm_link", "forearm_link", "wrist_2_link", "suction_tip"]), np.random.default_rng(0)
    tightest = max(balls.tightest(rng.uniform(-3, 3, 6), rng.uniform(0, size, 6), rng) for _ in range(40))
    assert tightest > (0.5 if size < 1 else 0.2)


@pytest.mark.parametrize("linkage", LINKAGES)
def test_no_two_points_of_a_linkage_come_closer_than_their_bound_says(linkage, tmp_path):
    model = RobotModel.load(robot(written_urdf(tmp_path / "arm.urdf", *LINKAGES[linkage]), "tool0"))
    balls, rng = Balls(model, [link for link in model.links if link != "base"]), np.random.default_rng(0)
    n = len(model.arm)
    assert max(balls.tightest(rng.uniform(-1, 1, n), rng.uniform(0, 0.2, n), rng) for _ in range(30)) > 0.5


def test_rods_of_a_linkage_hit_things_as_a_fine_step_says(tmp_path):
    """A rod that reaches out behind the arm, and a post there; the contact is where the first fine step finds it."""
    urdf = written_urdf(tmp_path / "arm.urdf", *LINKAGES["rods beside the arm"])
    box = '<collision><origin xyz="-0.3 0 0"/><geometry><box size="0.5 0.04 0.04"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace('<link name="rod"/>', f'<link name="rod">{box}</link>'))
    model = RobotModel.load(robot(urdf, "tool0"))
    start, end = np.zeros(6), np.array([0.0, 0.9, -0.9, 0, 0, 0])
    middle = model.link_poses((start + 0.6 * (end - start))[None])["rod"][0] @ pose(position=(-0.5, 0, 0))
    post = thing("post", (0.05, 0.05, 0.05), middle)
    placed = CollisionScene(model, [post]).placed(world([post]))
    contact = placed.check_path(JointPath.line(start, end))
    steps = np.linspace(0, 1, 2001)
    touching = [found is not None for found in placed.check_all(start + steps[:, None] * (end - start))]
    assert {contact.first, contact.second} == {"rod", "post"}
    assert contact.s == pytest.approx(steps[touching.index(True)], abs=2e-3)
