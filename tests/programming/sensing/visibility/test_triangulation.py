"""How the triangles of a solid hang together."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import BOX_SIGNS, Array, axis_rotation, pose, transform
from sqrp_cli.programming.sensing.visibility.silhouette import Triangulation
from sqrp_cli.shapes import BOX_TRIANGLES

X_WO = pose(axis_rotation(0, 0.4) @ axis_rotation(2, 1.1), [0.3, -2.0, 1.0])
BOX = transform(X_WO, BOX_SIGNS * [0.02, 0.5, 1.0])


def prism(count: int) -> tuple[Array, Array]:
    """An upright prism over a regular polygon, with a vertex in the middle of either end."""
    turn = 2 * np.pi * np.arange(count) / count
    ring = np.stack([0.016 * np.cos(turn), 0.016 * np.sin(turn), np.zeros(count)], axis=1)
    low, high = np.arange(count), np.arange(count) + count
    after = np.roll(low, -1)
    sides = [[low, after, high], [after, after + count, high]]
    ends = [[after, low, np.full(count, 2 * count)], [high, after + count, np.full(count, 2 * count + 1)]]
    triangles = np.concatenate([np.stack(corners, axis=1) for corners in (*sides, *ends)])
    return np.concatenate([ring, np.add(ring, [0, 0, 0.02]), [[0, 0, 0]], [[0, 0, 0.02]]]), triangles


@pytest.mark.parametrize("count", [3, 4, 32, 33])
def test_boxes_and_prisms_are_convex_and_not_any_more_once_dented(count: int) -> None:
    assert Triangulation.of_triangles(BOX, BOX_TRIANGLES).is_convex
    vertices, triangles = prism(count)
    assert Triangulation.of_triangles(transform(X_WO, vertices), triangles).is_convex
    vertices[-1, 2] -= 1e-4
    assert not Triangulation.of_triangles(transform(X_WO, vertices), triangles).is_convex


def test_what_is_open_inside_out_or_in_two_pieces_is_not_convex() -> None:
    assert not Triangulation.of_triangles(BOX, BOX_TRIANGLES[:-1]).is_convex
    assert not Triangulation.of_triangles(BOX, BOX_TRIANGLES[:, ::-1]).is_convex
    both = np.concatenate([BOX, np.add(BOX, [0.0, 0.0, 5.0])]), np.concatenate([BOX_TRIANGLES, BOX_TRIANGLES + 8])
    assert not Triangulation.of_triangles(*both).is_convex


def test_it_is_not_tried_whether_a_large_surface_is_convex() -> None:
    assert not Triangulation.of_triangles(*prism(2000)).is_convex
