"""A calibrated camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sqrp_cli.geometry import Array, check_finite, check_poses

DistortionModel = Literal["none", "plumb_bob", "rational_polynomial", "equidistant"]

DISTORTION_LENGTHS: dict[DistortionModel, int] = {
    "none": 0,
    "plumb_bob": 5,
    "rational_polynomial": 8,
    "equidistant": 4,
}
"""Number of coefficients of each distortion model, in the order of ROS camera calibration files."""


MAX_PIXELS = 200_000_000
"""Most pixels of an image; industrial cameras have up to 150 million."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with its calibration, place and sensing range.

    width, height: image size [pixels]; pixel (0, 0) is the centre of the first pixel.
    matrix: the intrinsic matrix K [pixels], shape (3, 3).
    distortion_model, distortion: as in ROS `sensor_msgs/CameraInfo` (k1, k2, p1, p2, k3, ...).
    frame: `world`, or the link that carries the camera.
    X_FC: pose of the optical frame (x right, y down, z forward) in `frame`, shape (4, 4).
    near, far: range of optical z in which the camera sees [m].
    rate: images per second [Hz]. latency: from exposure to the image being available [s].
    """

    name: str
    width: int
    height: int
    matrix: Array
    distortion_model: DistortionModel
    distortion: Array
    frame: str
    X_FC: Array
    near: float
    far: float
    rate: float
    latency: float

    def __post_init__(self) -> None:
        """Raises ValueError for a pose that is none and for figures that are not finite; `far` may be infinite."""
        what = f"camera `{self.name}`"
        check_poses(what, self.X_FC)
        check_finite(what, self.matrix, self.distortion, self.near, self.rate, self.latency)

    @property
    def response(self) -> float:
        """Longest time from an event until an image that shows it is available [s].

        That is one frame period and the latency.
        """
        return 1.0 / self.rate + self.latency
