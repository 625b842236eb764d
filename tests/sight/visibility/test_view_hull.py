"""The view hull of a box that must be seen whole, against coal with a hull made by others, for every form of solid."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import BOX_SIGNS, Array, look_at, pose, transform
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Shape, Sphere
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.sight_scene import SKIN
from sqrp_cli.sight.solids import Solid, load_solid
from tests.coal_geometry import coal_geometry
from tests.conftest import TABLETOP
from tests.sight.views import look, make_box, make_camera, random_pose, random_rotation

VIEWS = 400


def shapes_and_links() -> list[Solid]:
    shapes: list[Shape] = [Box((0.2, 0.03, 0.1)), Sphere(0.06), Cylinder(0.04, 0.2), Capsule(0.03, 0.15)]
    links = [part for part in load_workspace(TABLETOP).robot.parts if part.parent == "wrist_1_link"]
    return [load_solid(Part(f"part{i}", "world", shape, pose())) for i, shape in enumerate(shapes)] + [
        load_solid(Part(f"link{i}", "world", part.shape, pose())) for i, part in enumerate(links)
    ]


@pytest.mark.parametrize("half", [(0.0005, 0.04, 0.01), (0.04, 0.04, 0.04), (0.01, 0.01, 0.04)])
@pytest.mark.parametrize("solid", shapes_and_links(), ids=lambda solid: solid.name)
def test_a_solid_hides_what_must_be_seen_whole_where_coal_says_that_it_meets_the_hull(
    solid: Solid, half: tuple[float, ...]
) -> None:
    rng = np.random.default_rng(4)
    X_WB = np.stack([random_pose(rng, (-0.1,) * 3, (0.1,) * 3) for _ in range(VIEWS)])
    way = rng.normal(size=(VIEWS, 3))
    eyes = way / np.linalg.norm(way, axis=1)[:, None] * rng.uniform(0.3, 1.5, (VIEWS, 1))
    X_WC = np.stack([look_at(eye, X[:3, 3]) for eye, X in zip(eyes, X_WB, strict=True)])
    places = eyes * rng.uniform(0.0, 1.0, (VIEWS, 1)) + rng.uniform(-0.1, 0.1, (VIEWS, 3))
    X_WP = np.stack([pose(random_rotation(rng), place) for place in places])
    camera = make_camera(frame="hand", focal=(60.0, 60.0))
    box = make_box(tuple(2 * (side + SKIN) for side in half), frame="thing")
    found = look(camera, box, [solid], {"world": X_WP, "thing": X_WB, "hand": X_WC})
    meets = [_meets(solid, *at, np.array(half)) for at in zip(X_WP, eyes, X_WB, strict=True)]
    assert set(found.cause[:, 0].tolist()) == {Cause.NONE, Cause.HIDDEN}
    assert (found.cause[:, 0] == Cause.HIDDEN).tolist() == meets
    assert 20 < sum(meets) < VIEWS - 20


def _meets(solid: Solid, X_WP: Array, eye: Array, X_WB: Array, half: Array) -> bool:
    """Whether coal, asked with a mesh of the hull's triangles and a point inside the solid, finds a contact."""
    points = np.vstack([transform(X_WB, half * BOX_SIGNS), eye])
    hull = ConvexHull(points)
    vectors = coal.StdVec_Vec3s()
    vectors.extend(list(points[hull.vertices]))
    shape = coal.Convex.convexHull(vectors, True, "Qt")
    X = X_WP @ solid.part.X_PG
    at = coal.Transform3s(X[:3, :3], X[:3, 3])
    result = coal.CollisionResult()
    return coal.collide(shape, coal.Transform3s(), coal_geometry(solid), at, coal.CollisionRequest(), result) > 0
