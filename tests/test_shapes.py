"""What shapes say of themselves, against points that are drawn at random on and in them."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import Array, axis_rotation, pose, transform
from sqrp_cli.shapes import Box, Capsule, Convex, Cylinder, Sphere, contains, half_extents, shrunk, surface

SHAPES = [Box((0.1, 0.2, 0.3)), Sphere(0.1), Cylinder(0.1, 0.3), Capsule(0.05, 0.2)]


def turned() -> Array:
    return axis_rotation(0, 0.7) @ axis_rotation(2, 0.4) @ axis_rotation(1, -1.1)


def points_on(shape: Convex) -> Array:
    """Points on it in its own frame, shape (n, 3)."""
    return surface(shape, 360, enclosing=False).vertices


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_extents_are_those_of_its_surface(shape: Convex) -> None:
    points = transform(pose(turned()), points_on(shape))
    assert np.abs(points).max(axis=0) == pytest.approx(half_extents(shape, turned()), abs=1e-5)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_what_contains_a_point_is_what_its_triangles_go_around(shape: Convex) -> None:
    triangles = surface(shape, 96, enclosing=False)
    rng, found = np.random.default_rng(1), {True: 0, False: 0}
    for point in rng.uniform(-1.3, 1.3, (100, 3)) * half_extents(shape, np.eye(3)):
        inside = contains(shape, point)
        turns = triangles.turns_around(point)
        assert turns == pytest.approx(round(turns), abs=1e-6)
        if contains(shape, 1.02 * point) != contains(shape, 0.98 * point):
            continue  # between the surface and its triangles
        assert round(turns) == inside
        found[inside] += 1
    assert min(found.values()) > 10


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_triangles_enclose_it_or_are_in_it(shape: Convex) -> None:
    inner, outer = (surface(shape, 48, enclosing=enclosing) for enclosing in (False, True))
    for point in inner.vertices:
        assert contains(shape, 0.999 * point)
    dips = 0.996 if isinstance(shape, Sphere | Capsule) else 0.9999
    for point in points_on(shape)[::193]:
        assert round(outer.turns_around(dips * point)) == 1


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_it_is_shrunk_on_every_side_and_never_to_nothing(shape: Convex) -> None:
    assert half_extents(shrunk(shape, 0.01), np.eye(3)) == pytest.approx(half_extents(shape, np.eye(3)) - 0.01)
    assert (half_extents(shrunk(shape, 10.0), np.eye(3)) > 0).all()


def test_the_straight_part_of_a_capsule_is_seen_to_both_its_ends() -> None:
    outline = surface(Capsule(0.05, 0.2), 24, enclosing=False).vertices
    widest = np.linalg.norm(outline[:, :2], axis=1) > 0.05 - 1e-12
    assert sorted(set(np.round(outline[widest, 2], 12))) == [-0.1, 0.1]
