"""Bounds of motion, against random small motions."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.geometry import Array, pose, transform
from sqrp_cli.motion.collision import CollisionScene, MotionBound, PlacedScene
from sqrp_cli.robot.joint_tree import Mount
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Part, Sphere
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.trajectory import JointPath
from tests.motion.test_collision import thing, world
from tests.task.robots import LINKAGES, robot, written_urdf

WORLD = "world"


def test_depth_counts_the_joints_that_move_a_link(ur5: RobotModel) -> None:
    depth = MotionBound(ur5).depth
    chain = [
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "suction_tip",
    ]
    assert [depth[link] for link in chain] == list(range(7))


RADIUS = 0.1


class Balls:
    """A ball around the origin of each of some links and of the world, and the bounds of every pair's motion."""

    def __init__(self, model: RobotModel, links: list[str]) -> None:
        self.model, self.links, bound = model, [*links, WORLD], MotionBound(model)
        mounts, self.depth = {**model.tree.mounts, WORLD: Mount(-1, pose())}, {**bound.depth, WORLD: 0}
        shape = Sphere(RADIUS)
        self.pairs = [(i, j) for i, j in permutations(range(len(self.links)), 2) if self._is_inner(i, j)]
        inner, outer = np.array(self.pairs).T
        self.scene = PlacedScene(
            model=model,
            bound=bound,
            solids=load_solids([Part(link, link, shape, pose()) for link in self.links]),
            mounts=tuple(mounts[link] for link in self.links),
            depth=tuple(self.depth[link] for link in self.links),
            inner=inner,
            outer=outer,
            clearance=np.zeros(len(inner)),
            fingers=np.zeros(0),
        )

    def _is_inner(self, i: int, j: int) -> bool:
        return self.links[i] == WORLD or (
            self.links[j] != WORLD and self.depth[self.links[i]] < self.depth[self.links[j]]
        )

    def poses(self, q: Array) -> dict[str, Array]:
        found = self.model.link_poses(q)
        return {link: found[link] if link != WORLD else np.broadcast_to(pose(), (len(q), 4, 4)) for link in self.links}

    def tightest(self, q: Array, variation: Array, rng: np.random.Generator) -> float:
        """The largest share of its bound that a pair's motion takes, at random positions within the variation."""
        before, after = self.poses(q[None]), self.poses(q + rng.choice([-1.0, 1.0], (50, len(q))) * variation)
        directions = rng.normal(size=(30, 3))
        points = RADIUS * directions / np.linalg.norm(directions, axis=1)[:, None]
        shares = [0.0]
        for (i, j), bound in zip(self.pairs, self.scene.motion_bounds(q, variation), strict=True):
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
def test_no_two_points_of_an_arm_or_the_world_come_closer_than_their_bound_says(ur5: RobotModel, size: float) -> None:
    balls, rng = Balls(ur5, ["upper_arm_link", "forearm_link", "wrist_2_link", "suction_tip"]), np.random.default_rng(0)
    tightest = max(balls.tightest(rng.uniform(-3, 3, 6), rng.uniform(0, size, 6), rng) for _ in range(40))
    assert tightest > (0.5 if size < 1 else 0.2)


@pytest.mark.parametrize("linkage", LINKAGES)
def test_no_two_points_of_a_linkage_come_closer_than_their_bound_says(linkage: str, tmp_path: Path) -> None:
    model = RobotModel.load(robot(written_urdf(tmp_path / "arm.urdf", *LINKAGES[linkage]), "tool0"))
    balls, rng, n = (
        Balls(model, [link for link in model.links if link != "base"]),
        np.random.default_rng(0),
        len(model.arm),
    )
    assert max(balls.tightest(rng.uniform(-1, 1, n), rng.uniform(0, 0.2, n), rng) for _ in range(30)) > 0.5


def test_rods_of_a_linkage_hit_things_as_a_fine_step_says(tmp_path: Path) -> None:
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
    assert contact is not None
    assert {contact.first, contact.second} == {"rod", "post"}
    assert contact.s == pytest.approx(steps[touching.index(True)], abs=2e-3)
