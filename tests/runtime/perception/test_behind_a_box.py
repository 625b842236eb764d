"""What of a gripper stands before a part: pieces against a box, by rays from the lens."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import Array, inverse, pose, rpy_to_matrix, transform
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.runtime.perception.projected import TOUCH, PosedCamera, ProjectedBox
from sqrp_cli.runtime.robot_body import Surface
from tests.runtime.cell.scenes import camera

SIZE = np.array([0.04, 0.05, 0.06])
EYE = camera("near", (4.3, 0.4, 0.5), (4.0, 0.0, 0.02))
VIEW = PosedCamera(Projection.of(EYE), EYE.X_FC)


def box_at(X_WB: Array) -> ProjectedBox:
    box = VIEW.outline(X_WB, SIZE.tolist())
    assert box is not None
    return box


def hidden_by(box: ProjectedBox, triangle_W: Array) -> bool:
    """Whether perception takes a piece, (3, 3) [m], to be before the box."""
    parts = VIEW.silhouette([Surface("finger", triangle_W, np.array([[0, 1, 2]]))], {"finger": np.eye(4)}).parts
    return bool(box.is_hidden_by(parts[0])[0])


def hides_some(points_B: Array, eye_B: Array) -> bool:
    """Whether a ray from the lens through one of some points, (n, 3) [m], goes on into the box, less what may touch."""
    along, half = points_B - eye_B, SIZE / 2 - TOUCH
    at_faces = (np.stack([-half, half]) - eye_B)[:, None] / along
    first, last = at_faces.min(axis=0).max(axis=1), at_faces.max(axis=0).min(axis=1)
    return bool((last > np.maximum(first, 1.0)).any())


@pytest.mark.parametrize("seed", range(20))
def test_what_is_taken_to_be_behind_a_box_hides_none_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    X_WB = pose(rpy_to_matrix(random.uniform(-np.pi, np.pi, 3)), np.array([4.0, 0.0, 0.05]))
    box, eye_B = box_at(X_WB), transform(inverse(X_WB), VIEW.X_WC[:3, 3])
    shares = random.dirichlet(np.ones(3), size=200)
    mended = 0
    for _ in range(100):
        middle = random.uniform(-0.06, 0.06, 3)
        corners_B = middle + random.uniform(-0.03, 0.03, (3, 3))
        corners_W = transform(X_WB, corners_B)
        if hidden_by(box, corners_W):
            continue
        nearer = transform(inverse(VIEW.X_WC), corners_W)[:, 2].mean() < box.depth
        mended += nearer
        if nearer:  # a piece that is farther with its middle may still reach before the box
            assert not hides_some(shares @ corners_B, eye_B)
    assert mended > 0


def test_a_finger_that_stands_up_behind_a_part_is_not_before_it() -> None:
    X_WB = pose(position=np.array([4.0, 0.0, 0.05]))
    box, away = box_at(X_WB), np.sign(X_WB[0, 3] - VIEW.X_WC[0, 3])
    x = X_WB[0, 3] + away * SIZE[0] / 2
    finger = np.array([[x, -0.02, 0.04], [x, 0.02, 0.04], [x, 0.0, 0.25]])
    other_side = finger - [away * SIZE[0], 0.0, 0.0]
    assert not hidden_by(box, finger)
    assert hidden_by(box, other_side)
