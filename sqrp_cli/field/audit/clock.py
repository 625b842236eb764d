"""How far the clock of a camera is from the robot's, roughly: when its images change, and when the robot moves in them.

Good to some hundredths of a second, where the edges of the robot (`camera_fit`) take over.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.field.audit.footage import Footage
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, inverse
from sqrp_cli.records import dataclass
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.robot_body import RobotBody

FARTHEST = 3.0
"""Largest offset of a clock that is looked for [s]."""

SPACING = 0.01
"""Between offsets that are tried, and between instants at which the robot's motion is known [s]."""

CANDIDATES = 3
"""Offsets that are handed on, at most."""

APART = 0.15
"""Least distance between those [s]."""

FASTEST = 0.5
"""A point that moves faster than this share of the image's width per second changes no more pixels than that."""

_WIDTH, _MOST_CHANGE = 160, 30
_VERTICES = 40
"""Points of each solid part of the robot whose motion is followed."""


@dataclass
class ImageChanges:
    """By how much the images of a camera change, one after the other."""

    times: list[float]
    """Of the images [s]."""
    changes: list[float]
    """Between each image and the next one: mean over the pixels, small changes only [of 255]."""
    _last: NDArray[np.uint8] | None = None

    def at(self, times: Sequence[float]) -> Array:
        """The changes around some of the times, (n,)."""
        middles = (np.array(self.times[1:]) + np.array(self.times[:-1])) / 2
        return np.interp(times, middles, self.changes) if len(middles) else np.zeros(len(times))

    def add(self, t: float, gray: NDArray[np.uint8]) -> None:
        """The next image, (height, width)."""
        small = cv2.resize(
            gray, (_WIDTH, max(1, round(_WIDTH * gray.shape[0] / gray.shape[1]))), interpolation=cv2.INTER_AREA
        )
        small = cv2.GaussianBlur(small, (0, 0), 1.0)
        if self._last is not None:
            self.changes.append(float(np.minimum(cv2.absdiff(small, self._last), _MOST_CHANGE).mean()))
        self.times.append(t)
        self._last = small


def rough_offsets(seen: ImageChanges, expected: MotionInImage) -> list[float]:
    """Offsets of the clock at which images change when the robot moves in them, the best one first [s].

    What counts is the correlation of what changes with what moves.
    """
    t, changes = np.array(seen.times), np.array(seen.changes)
    gaps = np.diff(t)
    usable = (gaps > 1e-6) & (gaps < 3.0 * np.median(gaps)) if len(gaps) else np.zeros(0, dtype=bool)
    offsets = np.arange(-FARTHEST, FARTHEST + SPACING / 2, SPACING)
    scores = np.zeros(len(offsets))
    for index, offset in enumerate(offsets):
        inside = usable & expected.knows(t[:-1] - offset) & expected.knows(t[1:] - offset)
        if inside.sum() >= 8:
            way = np.interp(t - offset, expected.t, expected.way)
            a, b = np.sqrt(changes[inside]), np.sqrt(np.maximum(np.diff(way), 0.0)[inside])
            a, b = a - a.mean(), b - b.mean()
            size = float(np.sqrt((a @ a) * (b @ b)))
            scores[index] = float(a @ b) / size if size > 1e-9 else 0.0
    found: list[float] = []
    for index in np.argsort(-scores):
        if scores[index] <= max(0.2, 0.6 * scores.max()) or len(found) == CANDIDATES:
            break
        if all(abs(offsets[index] - other) >= APART for other in found):
            found.append(float(offsets[index]))
    return found


@dataclass(frozen=True, eq=False)
class MotionInImage:
    """How much moves in the image of a camera."""

    t: Array
    """Times of the robot's clock [s], (m,)."""
    way: Array
    """What all points that are followed have moved until then [widths of the image], (m,)."""

    def knows(self, t: Array) -> Mask:
        """Whether the motion is known at times t (m,) [s]."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        within = (t >= self.t[0]) & (t <= self.t[-1])
        known: Mask = within & (self.t[after] - self.t[after - 1] < 2 * SPACING)
        return known

    @classmethod
    def of(cls, camera: Camera, body: RobotBody, footage: Footage, t: Array) -> MotionInImage:
        """Of the robot, at times t (m,) [s]; and of what stands, for a camera that moves."""
        projection = Projection.of(camera)
        X_WL = body.poses_over(footage.joints(t))
        X_WC = X_WL[camera.frame] @ camera.X_FC if camera.frame != WORLD else camera.X_FC[None]
        X_CW = np.array([inverse(X) for X in X_WC])
        total, rng = np.zeros(len(t) - 1), np.random.default_rng(0)
        for surface in body.surfaces:
            chosen = surface.vertices[rng.permutation(len(surface.vertices))[:_VERTICES]]
            points = np.column_stack([chosen, np.ones(len(chosen))])
            in_camera = np.einsum("mij,mjk,nk->mni", X_CW, X_WL[surface.parent], points)
            ahead = in_camera[..., 2] > 0.02
            pixels, inside = projection.pixels(np.where(ahead[..., None], in_camera[..., :3], (0.0, 0.0, 1.0)))
            shown = ahead & inside & ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=-1)
            moved = np.linalg.norm(np.diff(pixels, axis=0), axis=-1) / camera.width
            total += (np.minimum(moved, FASTEST * SPACING) * (shown[1:] & shown[:-1])).sum(axis=1)
        return cls(t, np.append(0.0, np.cumsum(total)))


def brightness(image: ImageArray) -> NDArray[np.uint8]:
    """An image in grey, (height, width)."""
    gray: NDArray[np.uint8] = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return gray
