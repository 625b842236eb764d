"""Which solid reaches into a view hull nearest to the camera, against points strewn over the triangles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sqrp_cli.geometry import Array, look_at, pose, quaternion_to_matrix, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.culprit import nearest_inside
from sqrp_cli.programming.solids import Solid, Solids
from tests.programming.sensing.solids import solid_of

POINTS = 6_000
"""Points strewn over each triangle."""

SURE = 0.004
"""By how much nearer the nearest solid must be for the points to tell [m]."""

LINES, SOLIDS = 12, 4


def soup(generator: np.random.Generator) -> Solid:
    """Six triangles about the way from the eye to the box, some larger than the hull is wide."""
    corners = generator.uniform([0.4, -0.12, -0.12], [0.8, 0.12, 0.12], (6, 1, 3)) + generator.normal(
        scale=generator.choice([0.02, 0.06, 0.12]), size=(6, 3, 3)
    )
    return solid_of(corners.reshape(-1, 3), np.arange(18).reshape(6, 3))


def strewn_distance(solid: Solid, X_WP: Array, eye: Array, half_spaces: Array) -> float:
    """Distance from the eye of the nearest of many points of a solid that lie in a hull."""
    shares = np.random.default_rng(3).dirichlet((1.0, 1.0, 1.0), POINTS)
    corners = transform(X_WP, solid.vertices)[solid.triangles]
    points = np.concatenate([shares @ triangle for triangle in corners])
    inside = points[(points @ half_spaces[:, :3].T + half_spaces[:, 3] <= 0).all(axis=1)]
    return float(np.linalg.norm(inside - eye, axis=1).min(initial=np.inf))


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_of_a_line_is_the_one_with_the_nearest_point_inside(seed):
    generator = np.random.default_rng(seed)
    solids = [soup(generator) for _ in range(SOLIDS)]
    X_WP = np.stack(
        [
            pose(quaternion_to_matrix(generator.normal(size=4) * [0.1, 0.1, 0.1, 1.0]), generator.normal(size=3) * 0.03)
            for _ in range(LINES)
        ]
    )
    poses = SolidPoses(Solids(solids), {"world": X_WP})
    eyes = generator.normal(scale=0.05, size=(LINES, 3))
    X_WC = np.stack([look_at(eye, (1.0, 0.0, 0.0)) for eye in eyes])
    X_WB = np.stack([pose(quaternion_to_matrix(generator.normal(size=4)), (1.0, 0.0, 0.0)) for _ in range(LINES)])
    every = np.arange(LINES)
    half_sizes = generator.uniform(0.03, 0.15, (LINES, 3))
    lines = SightLines(every, every, every, X_WC, X_WB, half_sizes, np.zeros((LINES, 3)))

    hulls = [ConvexHull(np.vstack([eye, corners])).equations for eye, corners in zip(eyes, lines.corners, strict=True)]
    expected = np.array(
        [[strewn_distance(solid, X_WP[at], eyes[at], hulls[at]) for solid in solids] for at in range(LINES)]
    )
    reach_in = np.isfinite(expected)
    found = np.full(expected.shape, np.inf)
    found[reach_in] = nearest_inside(lines, poses, Pairs(*np.nonzero(reach_in)))

    first, second = np.sort(expected, axis=1)[:, :2].T
    sure = np.isfinite(second) & (second > first + SURE)
    assert sure.sum() >= 3
    np.testing.assert_array_equal(found[sure].argmin(axis=1), expected[sure].argmin(axis=1))
