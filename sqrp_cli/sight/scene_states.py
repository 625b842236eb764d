"""Poses of everything over a batch of robot states."""

from __future__ import annotations

from collections.abc import Mapping

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass
from sqrp_cli.skill.target_box import TargetBox


@dataclass(frozen=True, eq=False)
class SceneStates:
    """World poses of every frame over m states."""

    count: int  # m
    X_WF: Mapping[str, Array]
    """Pose of `world`, every link, object and `OBJECT@start`, shape (m, 4, 4), or (1, 4, 4) where it never moves."""

    def camera_poses(self, camera: Camera) -> Array:
        """World poses of a camera's optical frame, shape (m or 1, 4, 4)."""
        return self.X_WF[camera.frame] @ camera.X_FC

    def box_poses(self, box: TargetBox) -> Array:
        """World poses of a target box, shape (m or 1, 4, 4)."""
        return self.X_WF[box.frame] @ box.X_FB
