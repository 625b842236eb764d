"""View hulls as half spaces: the same as the convex hull of eye and corners; witnesses say what coal says."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sqrp_cli.geometry import BOX_SIGNS, Array, pose, quaternion_to_matrix
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import half_spaces, witnessed
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester
from sqrp_cli.programming.solids import Solid, Solids, load_solid
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Shape, Sphere

TABLETOP = Path(__file__).parents[4] / "workspaces" / "tabletop"


def random_lines(rng: np.random.Generator, count: int) -> SightLines:
    """Views of boxes from all around, from near and far, one state each."""
    X_WB = np.stack([pose(quaternion_to_matrix(rng.normal(size=4)), rng.uniform(-0.1, 0.1, 3)) for _ in range(count)])
    way = rng.normal(size=(count, 3))
    X_WC = np.tile(np.eye(4), (count, 1, 1))
    X_WC[:, :3, 3] = way / np.linalg.norm(way, axis=1)[:, None] * rng.uniform(0.15, 1.5, (count, 1))
    return SightLines(
        state=np.arange(count),
        hull=np.arange(count),
        box=np.zeros(count, dtype=np.int64),
        X_WC=X_WC,
        X_WB=X_WB,
        half_size=rng.choice([0.0005, 0.01, 0.04], (count, 3)),
        offset=np.zeros((count, 3)),
    )


def inside(spaces: Array, points: Array) -> Array:
    return (points @ spaces[:, :3].T <= spaces[:, 3]).all(axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_the_half_spaces_of_a_view_hull_hold_what_the_convex_hull_of_eye_and_corners_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines = random_lines(rng, 100)
    corners = lines.corners - lines.eyes[:, None]
    for spaces, box in zip(half_spaces(corners), corners, strict=True):
        hull = ConvexHull(np.vstack([box, np.zeros(3)])).equations
        shares = rng.dirichlet(np.full(9, 0.3), 500)
        points = shares @ np.vstack([box, np.zeros(3)]) * rng.uniform(0.8, 1.2, (500, 1))
        height = (points @ hull[:, :3].T + hull[:, 3]).max(axis=1)
        clear = np.abs(height) > 1e-9
        np.testing.assert_array_equal(inside(spaces, points)[clear], height[clear] < 0)


def test_from_within_a_box_its_faces_alone_are_the_hull() -> None:
    (spaces,) = half_spaces(0.1 * BOX_SIGNS[None])
    points = np.array([[0.09, 0.0, 0.0], [0.0, 0.0, -0.11], [0.11, 0.0, 0.0]])
    assert inside(spaces, points).tolist() == [True, False, False]


def shapes_and_links() -> list[Solid]:
    shapes: list[Shape] = [Box((0.2, 0.03, 0.1)), Sphere(0.06), Cylinder(0.04, 0.2), Capsule(0.03, 0.15)]
    links = [part for part in load_workspace(TABLETOP).robot.parts if part.parent == "wrist_1_link"]
    return [load_solid(Part(f"part{i}", "world", shape, pose())) for i, shape in enumerate(shapes)] + [
        load_solid(Part(f"link{i}", "world", part.shape, pose())) for i, part in enumerate(links)
    ]


@pytest.mark.parametrize("solid", shapes_and_links(), ids=lambda solid: solid.name)
def test_a_solid_with_a_witness_in_the_hull_meets_it_says_coal(solid: Solid) -> None:
    rng = np.random.default_rng(4)
    lines = random_lines(rng, 400)
    places = lines.eyes * rng.uniform(0.0, 1.0, (400, 1)) + rng.uniform(-0.1, 0.1, (400, 3))
    X_WP = np.stack([pose(quaternion_to_matrix(rng.normal(size=4)), place) for place in places])
    poses = SolidPoses(Solids((solid,)), {"world": X_WP})
    found = witnessed(lines, poses, Pairs(np.arange(400), np.zeros(400, dtype=np.int64)))
    meets = np.array([_meets(solid, X, lines, line) for line, X in enumerate(X_WP)])
    assert found.sum() > 5
    assert 20 < meets.sum() < 380
    assert not (found & ~meets).any()
    both = HullTester().met(lines, poses, Pairs(np.arange(400), np.zeros(400, dtype=np.int64)), first_only=False)
    np.testing.assert_array_equal(both.line, np.flatnonzero(meets))


def _meets(solid: Solid, X_WP: Array, lines: SightLines, line: int) -> bool:
    """Whether coal, asked with a mesh of the hull's triangles and a point inside the solid, finds a contact."""
    points = np.vstack([lines.corners[line], lines.eyes[line]])
    hull = ConvexHull(points)
    shape = coal.Convex.convexHull(_vectors(points[hull.vertices]), True, "Qt")
    X = X_WP @ solid.part.X_PG
    at = coal.Transform3s(X[:3, :3], X[:3, 3])
    result = coal.CollisionResult()
    return coal.collide(shape, coal.Transform3s(), solid.geometry, at, coal.CollisionRequest(), result) > 0


def _vectors(points: Array) -> coal.StdVec_Vec3s:
    vectors = coal.StdVec_Vec3s()
    vectors.extend(list(points))
    return vectors
