"""Poses over a batch of robot states: of cameras, target boxes, and solids that may occlude them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, check_finite, pose
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.programming.solids import Solids


@dataclass(frozen=True, eq=False)
class SolidPoses:
    """Solids with the world poses of their parents over a batch of m states."""

    solids: Solids
    """In the order of their indices."""
    X_WP: Mapping[str, Array]
    """Pose of each parent by name, shape (m, 4, 4), or (1, 4, 4) where it never moves."""

    @cached_property
    def moves(self) -> Mask:
        """Whether each solid ever moves, shape (s,)."""
        return np.array([len(self.X_WP[parent]) > 1 for parent in self.solids.parents], dtype=bool)

    def pose(self, index: int) -> Array:
        """World poses of a solid's parent, shape (m or 1, 4, 4)."""
        return self.X_WP[self.solids.parents[index]]

    def at(self, solid: Indices, state: Indices) -> Array:
        """World poses of the parents of solids in states, both by index and of shape (n,); shape (n, 4, 4)."""
        found = np.empty((len(solid), 4, 4))
        for index in np.flatnonzero(np.bincount(solid)).tolist():
            here, poses = np.flatnonzero(solid == index), self.pose(index)
            found[here] = poses[state[here]] if len(poses) > 1 else poses
        return found


@dataclass(frozen=True, eq=False)
class SceneStates:
    """World poses of every frame over m states."""

    count: int
    """m."""
    X_WF: Mapping[str, Array]
    """Pose of `world`, every link, object and `OBJECT@start`, shape (m, 4, 4), or (1, 4, 4) where it never moves."""

    def __post_init__(self) -> None:
        """Raises ValueError if a pose is not finite."""
        frames = list(self.X_WF.values())
        resting = [X_WF for X_WF in frames if len(X_WF) == 1]  # together, because there may be hundreds
        if resting and np.isfinite(np.concatenate(resting)).all():
            frames = [X_WF for X_WF in frames if len(X_WF) != 1]
        if all(np.isfinite(X_WF).all() for X_WF in frames):
            return
        for name, X_WF in self.X_WF.items():
            check_finite(f"the poses of `{name}`", X_WF)

    def camera_poses(self, camera: Camera) -> Array:
        """World poses of a camera's optical frame, shape (m or 1, 4, 4)."""
        return self.X_WF[camera.frame] @ camera.X_FC

    def box_poses(self, box: TargetBox) -> Array:
        """World poses of a target box, shape (m or 1, 4, 4)."""
        return self.X_WF[box.frame] @ box.X_FB

    def solid_poses(self, solids: Solids) -> SolidPoses:
        """World poses of solids."""
        return SolidPoses(solids, self.X_WF)


def fixed_frame(X_WF: Array | None = None) -> Array:
    """A frame that never moves, as an entry of `SceneStates.X_WF`; the world's origin by default."""
    return (pose() if X_WF is None else X_WF)[None]


def poses_at(X: Sequence[Array], which: Indices, state: Indices) -> Array:
    """Poses of frames in states, both by index and of shape (n,); shape (n, 4, 4).

    X: poses of each frame over all states, shape (m, 4, 4), or (1, 4, 4) where it never moves.
    """
    found: Array = np.array([poses[0] for poses in X]).reshape(-1, 4, 4)[which]
    for index, poses in enumerate(X):
        if len(poses) > 1:
            here = np.flatnonzero(which == index)
            found[here] = poses[state[here]]
    return found
