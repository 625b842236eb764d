"""The camera model: from points in the optical frame to pixels, with lens distortion.

The models are those of ROS `sensor_msgs/CameraInfo` and OpenCV: `plumb_bob` (k1, k2, p1, p2, k3), `rational_polynomial`
(k1, k2, p1, p2, k3, k4, k5, k6) and `equidistant` (k1, k2, k3, k4).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.records import dataclass

CLOSE = 1e-2  # Greatest distance from a pixel at which what the camera sees there is shown [pixels]
_ITERATIONS, _STEP = 25, 1e-5


@dataclass(frozen=True, eq=False)
class Projection:
    """Where a camera shows points.

    Results say where they are in pixels or in the plane z = 1, shape (..., 2), and whether the lens shows them: within
    the radius, shape (...).
    """

    camera: Camera

    @cached_property
    def radius(self) -> float:
        """Largest distance from the optical axis, in the plane z = 1, up to which the distortion is monotonic.

        Beyond it the polynomial folds back and shows points that the lens does not; infinite if it never does.
        """
        model, distortion = self.camera.distortion_model, self.camera.distortion
        if model == "none":
            return float("inf")
        if model == "equidistant":
            k1, k2, k3, k4 = distortion
            angle = _smallest_root([1, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
            return float(np.tan(angle)) if angle < np.pi / 2 else float("inf")
        k1, k2, _, _, k3, k4, k5, k6 = np.pad(distortion, (0, 8 - len(distortion)))
        numerator, denominator = np.array([1, k1, k2, k3]), np.array([1, k4, k5, k6])
        # With u = r^2: d(r N/D)/dr = (N D + 2u (N' D - N D')) / D^2, and a zero of D is a pole.
        slope = np.convolve(numerator, denominator)
        orders = np.arange(4)
        change = np.convolve(orders * numerator, denominator) - np.convolve(numerator, orders * denominator)
        return min(_smallest_root(slope + 2 * change), _smallest_root(denominator))

    @cached_property
    def view_angles(self) -> tuple[float, float, float, float]:
        """Up to which angles from the axis the right, left, top and bottom of the image show, by half degrees [rad]."""
        angles, sides = np.radians(np.arange(0.0, 90.0, 0.5)), np.array([(1, 0), (-1, 0), (0, -1), (0, 1)])
        away, ahead = np.sin(angles), np.tile(np.cos(angles), (4, 1))
        shown = self.shows(np.dstack([sides[:, :1] * away, sides[:, 1:] * away, ahead]))
        right, left, top, bottom = angles[np.maximum(np.minimum.accumulate(shown, axis=1).sum(axis=1) - 1, 0)].tolist()
        return right, left, top, bottom

    def pixels(self, points_C: Array) -> tuple[Array, Mask]:
        """Pixels (..., 2) of points (..., 3) in the optical frame with z > 0, and whether they are within the radius.

        A point beyond the radius gets the pixel of the undistorted camera, which is on the right side at least.
        """
        return self._pixels_of(points_C[..., :2] / points_C[..., 2:])

    def _pixels_of(self, plane: Array) -> tuple[Array, Mask]:
        K = self.camera.matrix
        bent, inside = self.bent(plane)
        return bent @ K[:2, :2].T + K[:2, 2], inside

    def plane(self, pixels: Array) -> tuple[Array, Mask]:
        """Where in the plane z = 1 the camera looks at pixels (n, 2), and whether the lens shows anything there.

        Found by Newton's method from the point without distortion.
        """

        def within(plane: Array, share: float) -> Array:
            length = np.maximum(np.linalg.norm(plane, axis=1, keepdims=True), 1e-12)
            shorter: Array = plane * np.minimum(1.0, share * self.radius / length)
            return shorter

        K = self.camera.matrix
        plane = (pixels - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T
        if self.camera.distortion_model == "none":
            return plane, np.ones(len(plane), dtype=bool)
        plane = within(plane, 0.98)
        for _ in range(_ITERATIONS):
            error = self._pixels_of(plane)[0] - pixels
            slopes = [(self._pixels_of(plane + d)[0] - pixels - error) / _STEP for d in np.eye(2) * _STEP]
            (a, c), (b, d) = (slope.T for slope in slopes)
            safe = np.where(np.abs(a * d - b * c) > 1e-9, a * d - b * c, np.inf)[:, None]
            change = np.column_stack([d * error[:, 0] - b * error[:, 1], a * error[:, 1] - c * error[:, 0]]) / safe
            plane = within(plane - change, 0.9999)
            if float(np.abs(change).max(initial=0.0)) < _STEP:
                break
        found, inside = self._pixels_of(plane)
        return plane, inside & (np.abs(found - pixels).max(axis=1, initial=0.0) < CLOSE)

    def shows(self, directions_C: Array) -> Mask:
        """Which of some directions (..., 3) in the optical frame with z > 0 are within the image."""
        pixels, inside = self.pixels(directions_C)
        beyond = (pixels < -0.5) | (pixels > np.array([self.camera.width, self.camera.height]) - 0.5)
        return inside & ~beyond.any(axis=-1)

    def bent(self, plane: Array) -> tuple[Array, Mask]:
        """Where the lens moves points (..., 2) of the plane z = 1, and whether they are within the radius.

        Points beyond the radius stay where they are; so does NaN.
        """
        x, y = plane[..., 0], plane[..., 1]
        square = x * x + y * y
        inside = np.einsum("...i,...i", plane, plane) <= self.radius**2
        if self.camera.distortion_model == "none":
            return plane, inside
        if self.camera.distortion_model == "equidistant":
            k1, k2, k3, k4 = self.camera.distortion
            radius = np.sqrt(square)
            angle = np.arctan(radius)
            u = angle * angle
            bent = angle * (1 + u * (k1 + u * (k2 + u * (k3 + u * k4))))
            moved = plane * np.where(radius > 1e-9, bent / np.maximum(radius, 1e-9), 1.0)[..., None]
        else:
            k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(self.camera.distortion, (0, 8 - len(self.camera.distortion)))
            radial = 1 + square * (k1 + square * (k2 + square * k3))
            radial = radial / (1 + square * (k4 + square * (k5 + square * k6)))
            across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
            down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
            moved = np.stack([across, down], axis=-1)
        return np.where(inside[..., None], moved, plane), inside


_NEVER = 1e-12  # 1 / u below it means infinite u: the radius 1e6 is within 1e-6 rad of 90 degrees off the axis


def _smallest_root(coefficients: Array | list[float]) -> float:
    """Square root of the smallest positive real root of a polynomial 1 + ... in u = r^2, lowest order first.

    Infinite if none.
    """
    # As a polynomial in 1 / u, with reversed coefficients, the leading one is 1 even if all others are tiny.
    roots = np.roots(np.asarray(coefficients, dtype=float))
    real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))].real
    largest = float(np.max(real, initial=0.0))
    return largest**-0.5 if largest > _NEVER else float("inf")
