"""What there is to see and what is in the way, over a batch of robot states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sqrp_cli.geometry import Array, check_finite, pose
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.programming.sensing.sight_lines import SolidPoses
from sqrp_cli.programming.sensing.solids import Solid

WORLD = "world"


@dataclass(frozen=True, eq=False)
class SceneStates:
    """World poses of every frame over m states.

    count: m. X_WF: pose of `world`, every link, object and `OBJECT@start`, shape (m, 4, 4), or (1, 4, 4) where it never
    moves.
    """

    count: int
    X_WF: Mapping[str, Array]

    def __post_init__(self) -> None:
        """Raises ValueError if a pose is not finite."""
        for name, X_WF in self.X_WF.items():
            check_finite(f"the poses of `{name}`", X_WF)

    def camera_poses(self, camera: Camera) -> Array:
        """World poses of a camera's optical frame, shape (m or 1, 4, 4)."""
        poses: Array = self.X_WF[camera.frame] @ camera.X_FC
        return poses

    def box_poses(self, box: TargetBox) -> Array:
        """World poses of a target box, shape (m or 1, 4, 4)."""
        poses: Array = self.X_WF[box.frame] @ box.X_FB
        return poses

    def solid_poses(self, solids: tuple[Solid, ...]) -> SolidPoses:
        """World poses of solids."""
        return SolidPoses(solids, self.X_WF)


def fixed_frame(X_WF: Array | None = None) -> Array:
    """A frame that never moves, as an entry of `SceneStates.X_WF`; the world's origin by default."""
    return (pose() if X_WF is None else X_WF)[None]
