"""Poses, rotations and boxes as NumPy arrays, and ranges of indices.

`X_AB` is the pose of frame B in frame A, a 4x4 matrix that maps coordinates in B to coordinates in A. Quaternions are
ordered x, y, z, w. All functions of poses and quaternions broadcast over leading dimensions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BOX_SIGNS: Array = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Corners of the box [-1, 1]^3, shape (8, 3), x slowest and z fastest."""
_PARALLEL = 1e-9  # Sine of the angle below which two directions count as parallel
_ORTHONORMAL = 1e-9  # Tolerance of R^T R = I for a rotation matrix, per entry
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


def read_only(array: ArrayLike) -> Array:
    """A read-only float copy of `array`, for fields of frozen records."""
    copy = np.array(array, dtype=float)
    copy.setflags(write=False)
    return copy


def pose(rotation: ArrayLike | None = None, position: ArrayLike | None = None) -> Array:
    """The 4x4 pose with a rotation matrix (3x3, default identity) and a position [m] (default origin)."""
    X = np.eye(4)
    if rotation is not None:
        X[:3, :3] = rotation
    if position is not None:
        X[:3, 3] = position
    return X


def check_poses(what: str, *poses: Array | None) -> None:
    """Raises ValueError unless all arrays (..., 4, 4) are poses: finite, with orthonormal axes.

    what: name of the object with these poses, for the message. None, an unknown pose, passes.
    """
    for X in poses:
        if X is None:
            continue
        R = X[..., :3, :3]
        # Comparisons with NaN are false, so it does not pass.
        orthonormal = (np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)) <= _ORTHONORMAL).all()
        right_handed = (np.linalg.det(R) > 0.0).all()
        affine = (X[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
        if not (np.isfinite(X).all() and orthonormal and right_handed and affine):
            raise ValueError(f"the pose of {what} is none: {X.tolist()}")


def check_finite(what: str, *figures: ArrayLike | None) -> None:
    """Raises ValueError unless all figures are finite; None (undefined) passes."""
    for figure in figures:
        if figure is not None and not np.isfinite(figure).all():
            raise ValueError(f"a figure of {what} is not finite: {figure}")


def finite_or_none(value: float) -> float | None:
    """A figure as documents have it: None for one that is infinite or not a number."""
    return float(value) if np.isfinite(value) else None


def inverse(X_AB: Array) -> Array:
    """X_BA of X_AB, shape (..., 4, 4)."""
    R_BA = X_AB[..., :3, :3].swapaxes(-1, -2)
    X_BA = np.empty(X_AB.shape)
    X_BA[..., :3, :3] = R_BA
    np.negative((R_BA @ X_AB[..., :3, 3:])[..., 0], out=X_BA[..., :3, 3])
    X_BA[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
    return X_BA


def transform(X_AB: Array, points_B: Array) -> Array:
    """Coordinates in A of points given in B.

    X_AB: poses, shape (..., 4, 4); points_B: shape (..., n, 3), leading dimensions broadcast against those of X_AB.
    """
    return points_B @ X_AB[..., :3, :3].swapaxes(-1, -2) + X_AB[..., None, :3, 3]


def cross(a: Array, b: Array) -> Array:
    """The cross product of vectors (..., 3); several times faster than `np.cross` on small arrays."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        product[..., axis] = a[..., second] * b[..., third] - a[..., third] * b[..., second]
    return product


def quaternion_to_matrix(quaternion: ArrayLike) -> Array:
    """Rotation matrix of a quaternion (x, y, z, w) of any non-zero length."""
    x, y, z, w = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def wrong_length(quaternion: ArrayLike) -> str:
    """What is wrong with the length of a stated quaternion (x, y, z, w), in words; empty if it is 1, to 1 %."""
    length = float(np.linalg.norm(quaternion))
    return "" if abs(length - 1.0) <= 0.01 else f"has length {length:.3g}, expected 1 (order x, y, z, w)"


def matrix_to_quaternion(rotation: Array) -> Array:
    """The quaternion (x, y, z, w) of length 1 with w >= 0 of a rotation matrix (3, 3)."""
    R = rotation
    # Row i holds the quaternion times 4 q_i: dividing by the largest is the most exact.
    outer = np.array(
        [
            [1 + R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[1, 0] + R[0, 1], 1 - R[0, 0] + R[1, 1] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1 + R[0, 0] + R[1, 1] + R[2, 2]],
        ]
    )
    row = outer[int(np.argmax(np.diag(outer)))]
    quaternion: Array = row / np.linalg.norm(row)
    return -quaternion if quaternion[3] < 0 else quaternion


def axis_rotation(axis: int, angle: float) -> Array:
    """Rotation matrix about coordinate axis 0, 1 or 2 by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation[first, first] = rotation[second, second] = cosine
    rotation[second, first], rotation[first, second] = sine, -sine
    return rotation


def rpy_to_matrix(rpy: ArrayLike) -> Array:
    """Rotation matrix of roll, pitch, yaw [rad] about the fixed axes x, y, z in this order (as in URDF)."""
    roll, pitch, yaw = np.asarray(rpy, dtype=float)
    return axis_rotation(2, yaw) @ axis_rotation(1, pitch) @ axis_rotation(0, roll)


def matrix_to_rpy(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of a rotation matrix, as `rpy_to_matrix` takes them; yaw is 0 where pitch is 90 deg."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:
        return float(np.copysign(1.0, pitch) * np.arctan2(rotation[0, 1], rotation[1, 1])), float(pitch), 0.0
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    second = rotation[:2, 1:] @ [np.cos(roll), -np.sin(roll)]  # exact beside that pitch, too, where the roll is not
    return float(roll), float(pitch), float(np.arctan2(-second[0], second[1]))


def displacement(position: Array, rotation: Array) -> Array:
    """The pose at a position [m] turned by a rotation vector [rad], shape (3,) each (Rodrigues' formula)."""
    angle = float(np.linalg.norm(rotation))
    if angle == 0.0:
        return pose(position=position)
    x, y, z = rotation / angle
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return pose(np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * (turn @ turn), position)


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Pose of an optical frame (x right, y down, z forward) at `eye` [m] that looks at `target` [m].

    The image's upward direction is as close to `up` as the viewing direction allows; when the two are parallel, it is
    the world's x axis, or its z axis for a camera that looks along x. Raises ValueError where `eye` and `target`
    are one point, and for an `up` without length.
    """
    eye = np.asarray(eye, dtype=float)
    directions = [np.asarray(target, dtype=float) - eye, np.asarray(up, dtype=float)]
    for direction in directions:
        length = np.linalg.norm(direction)
        if not 0.0 < length < np.inf:
            raise ValueError(f"{direction.tolist()} has no direction")
    forward, upwards = (direction / np.linalg.norm(direction) for direction in directions)
    ways_up = (upwards, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    right = next(across for way in ways_up if np.linalg.norm(across := cross(forward, way)) >= _PARALLEL)
    right = right - (right @ forward) * forward  # nearly parallel vectors have an inexact product
    right = right / np.linalg.norm(right)
    return pose(np.column_stack([right, cross(forward, right), forward]), eye)


def side_pose(size: tuple[float, float, float], side: str) -> Array:
    """The pose X_OT of a tool frame at yaw 0 in the centre of a side of a box of full extents `size` [m], shape (4, 4).

    side: the side's outward axis, one of `+x -x +y -y +z -z`. The tool's z axis points into the box; its x axis lies
    along the box's x axis, or y axis for the sides +x and -x.
    """
    axis = "xyz".index(side[1])
    outward = np.zeros(3)
    outward[axis] = 1.0 if side[0] == "+" else -1.0
    x = np.eye(3)[1 if axis == 0 else 0]
    return pose(np.stack([x, cross(-outward, x), -outward], axis=1), 0.5 * np.asarray(size) * outward)


def grasp_pose(
    size: tuple[float, float, float], side: str, yaw: float, depth: float, beside: float | None = None
) -> Array:
    """The pose X_OT of a tool frame that grasps a box of full extents `size` [m] by a side, shape (4, 4).

    It is `side_pose`, turned by yaw about its z axis [rad] and moved by depth along it [m]. beside: the gap [m] to the
    jaw that stands still, on whose face the frame then lies: the box is as far along its y axis.
    """
    X_OT = side_pose(size, side) @ pose(axis_rotation(2, yaw), (0.0, 0.0, depth))
    if beside is None:
        return X_OT
    return X_OT @ pose(position=(0.0, -0.5 * float(np.abs(X_OT[:3, 1]) @ np.asarray(size)) - beside, 0.0))


def box_corners(size: ArrayLike) -> Array:
    """The 8 corners [m] of a box of full extents `size` (..., 3) in its own frame, shape (..., 8, 3)."""
    return 0.5 * np.asarray(size, dtype=float)[..., None, :] * BOX_SIGNS


def ranges(first: NDArray[Any], last: NDArray[Any]) -> tuple[Indices, Indices]:
    """The integers of each range from `first`, included, to `last`, excluded: whose range each is in, and each.

    Shape (k,) both.
    """
    first = first.astype(np.int64)
    count = np.maximum(last.astype(np.int64) - first, 0)
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) + np.repeat(first - np.cumsum(count) + count, count)
