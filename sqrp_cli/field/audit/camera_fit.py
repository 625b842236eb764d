"""How far a camera is from where the workspace says, and how far its clock is from the robot's, by edges in its images.

Each point of an expected edge is looked for in the image along its normal. The pose of the camera (six numbers) and the
offset of its clock (one) are those for which the points meet the edges best: least squares with Tukey's weights, which
leave out points that meet other edges. Estimated with them is what else may be a little wrong: the place of each
object, and the width of all edges. The offset is told from a turn of the camera by what moves and what stands, and by
motions to and fro.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.projection import Projection
from sqrp_cli.field.audit.expected_edges import ExpectedEdges
from sqrp_cli.geometry import Array, Indices, Mask, displacement
from sqrp_cli.records import dataclass

TURN = 0.016
"""Largest turn of a camera that is looked for [rad]: edges are sought within as many pixels as it moves them."""
LEAST_REACH, MOST_REACH = 10.0, 48.0  # Limits of that distance [pixels]
GRAIN = 0.5  # Between samples along a normal [pixels]
FAINT = 2.5  # An edge with less contrast is none [of 255, per pixel]
TUKEY = 4.685
"""Width of Tukey's weights in standard deviations: 95 % as efficient as least squares where nothing is wrong."""
SHARPEST = 0.2  # Least standard deviation of edges [pixels]: better they are not known
FAST = 20.0  # A point that moves faster than this along its normal is one that moves [pixels/s]
LEAST_POINTS = 60  # Points that must meet an edge: less tell nothing of a camera
WIDTHS = (5.0, 3.0, 2.0, 1.5, 1.2, 1.2, 1.2, 1.2)
"""How far from where a point is expected edges count, one iteration after the other [pixels]."""
PRIOR = (0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.2)
"""Standard deviations of turns [rad], shifts [m] and offset [s] before anything is seen."""
FRINGE = 0.2
"""Standard deviation of how far all edges may be outside of what they are of, as by light and lens [pixels]."""
ALIKE = 4.0
"""Edges beside each other are wrong alike: so many count as one. Those of objects do so in all images together."""
BLUR = 1.0  # Standard deviation of the blur of images before their edges are sought [pixels]


@dataclass(frozen=True, eq=False)
class CameraFit:
    """The pose error of a camera and the offset of its clock, as its images show them.

    change: turn [rad] and shift [m] of the camera in its optical frame, and how far its clock is ahead [s], (7,).
    covariance: of that, (7, 7). residual: standard deviation of edges from where they should be then [pixels].
    points: that met an edge. cost: mean loss per point, 0 all meet, 1 none does. moving_cost: the same of the points
    that move, by which wrong offsets of the clock are told; of all where few do.
    pixels: root mean square of how far the turn and the shift move the points in the image [pixels].
    """

    change: Array
    covariance: Array
    residual: float
    points: int
    cost: float
    moving_cost: float
    pixels: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenEdges:
    """What images of a camera show along the normals of n points of expected edges, those of all images together.

    points, speeds, levers, body: as in `ExpectedEdges`. pixels: where the points are expected, (n, 2). normals: in the
    image, (n, 2). contrast: size of the slope of brightness along each normal, (n, samples) [of 255, per pixel].
    R_CW: the world's axes in the optical frame, (n, 3, 3). alike: as how many points that are wrong alike each counts,
    (n,). owned: by which object each point is, (n, objects). deviations: standard deviations of the numbers of a change
    (see `away`) before anything is seen. reach: how far the samples go along the normals [pixels].
    """

    projection: Projection
    points: Array
    speeds: Array
    levers: Array
    body: Indices
    pixels: Array
    normals: Array
    contrast: Array
    R_CW: Array
    alike: Array
    owned: Mask
    deviations: Array
    reach: float

    @classmethod
    def of(cls, images: Iterable[tuple[ExpectedEdges, NDArray[np.uint8]]], projection: Projection) -> SeenEdges | None:
        """What images in grey, (height, width), show of the points that are in them; None where none is."""
        camera = projection.camera
        reach, size = float(np.clip(TURN * camera.matrix[0, 0], LEAST_REACH, MOST_REACH)), [camera.width, camera.height]
        steps = np.arange(-reach, reach + GRAIN / 2, GRAIN)
        found: list[dict[str, Array]] = []
        for edges, image in images:
            (pixels, inside), (beside, _) = projection.pixels(edges["points"]), projection.pixels(edges["beside"])
            normals = beside - pixels
            lengths = np.linalg.norm(normals, axis=1)
            kept = inside & (lengths > 0.2) & ((pixels > 3) & (pixels < np.array(size) - 4)).all(axis=1)
            if not kept.any():
                continue
            pixels, normals = pixels[kept], normals[kept] / lengths[kept, None]
            gray = cv2.GaussianBlur(image, (0, 0), BLUR).astype(np.float32)
            x, y = ((pixels[:, None, axis] + steps * normals[:, None, axis]).astype(np.float32) for axis in (0, 1))
            values = cv2.remap(gray, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            outside = (x < 1) | (x > size[0] - 2) | (y < 1) | (y > size[1] - 2)
            contrast = np.where(outside, 0.0, np.abs(np.gradient(values, GRAIN, axis=1)))
            seen = {"pixels": pixels, "normals": normals, "contrast": contrast}
            found.append({name: points[kept] for name, points in edges.items() if name != "beside"} | seen)
        if not found:
            return None
        known = {name: np.concatenate([one[name] for one in found]) for name in found[0]}
        owner, freedom = known.pop("owner"), known.pop("freedom")
        objects, first = np.unique(owner[owner >= 0], return_index=True)
        return cls(
            projection=projection,
            **known,
            alike=np.where(owner >= 0, ALIKE * len(found), ALIKE),
            owned=owner[:, None] == objects,
            deviations=np.array([*PRIOR, FRINGE, *freedom[owner >= 0][first].ravel()]),
            reach=(len(steps) - 1) * GRAIN / 2,
        )

    def away(self, change: Array) -> Array:
        """How far along their normals points are from where they were expected, after a change [pixels], (n,).

        change: the seven numbers of `CameraFit`, the fringe of all edges [pixels], and for each object its shift [m]
        and its turn [rad].
        """
        away: Array = self._beside(self._placed(change) @ displacement(np.zeros(3), change[:3])[:3, :3]) + change[7]
        return away

    def slopes(self, change: Array) -> Array:
        """The derivative of `away`, shape (n, numbers of the change)."""
        R, h = displacement(np.zeros(3), change[:3])[:3, :3], 1e-5
        points = self._placed(change) @ R
        steps = [self._beside(points + step) - self._beside(points - step) for step in h * np.eye(3)]
        by_point = np.stack(steps, axis=1) / (2 * h)
        # R(turn + d) = R(turn) exp([J d]), with the right Jacobian J of SO(3), here to the third order.
        X = np.cross(np.eye(3), change[:3])
        by_turn = np.cross(by_point, points) @ (np.eye(3) - X / 2 + X @ X / 6)
        g = by_point @ R.T
        by_clock = -(g * self.speeds).sum(axis=1)
        by_place = np.column_stack([np.einsum("ni,nij->nj", g, self.R_CW), (g * self.levers).sum(axis=1)])
        by_object = (self.owned[:, :, None] * by_place[:, None, :]).reshape(len(g), -1)
        return np.column_stack([by_turn, -g, by_clock, np.ones(len(g)), by_object])

    def _placed(self, change: Array) -> Array:
        """The points with objects where they are, seen from the camera before it turns, (n, 3)."""
        places = self.owned @ change[8:].reshape(-1, 4)
        shifts = np.einsum("nij,nj->ni", self.R_CW, places[:, :3]) + places[:, 3:] * self.levers
        placed: Array = self.points + shifts - change[6] * self.speeds - change[3:6]
        return placed

    def _beside(self, points: Array) -> Array:
        """How far points of the optical frame (n, 3) are in the image from where they were expected, (n,) [pixels]."""
        ahead = np.column_stack([points[:, :2], np.maximum(points[:, 2], 1e-3)])
        pixels, _ = self.projection.pixels(ahead)
        away: Array = ((pixels - self.pixels) * self.normals).sum(axis=1)
        return away

    def nearest(self, away: Array, width: float) -> tuple[Array, Mask]:
        """The edge for each point that is near and clear, from where it was expected [pixels], and if there is one."""
        count = self.contrast.shape[1]
        middle = np.rint((away + self.reach) / GRAIN).astype(np.int64)
        half = int(np.ceil(2.5 * width / GRAIN))
        near = middle[:, None] + np.arange(-half, half + 1)
        inside = (near >= 1) & (near < count - 1)
        values = np.where(inside, np.take_along_axis(self.contrast, np.clip(near, 0, count - 1), axis=1), 0.0)
        distance = (near * GRAIN - self.reach) - away[:, None]
        best = np.argmax(values * np.exp(-0.5 * (distance / width) ** 2), axis=1)
        rows = np.arange(len(away))
        at = np.clip(near[rows, best], 1, count - 2)
        a, b, c = (self.contrast[rows, at + d] for d in (-1, 0, 1))
        peak = np.clip(0.5 * (a - c) / np.minimum(a - 2 * b + c, -1e-6), -1.0, 1.0)
        found = (b >= FAINT) & inside[rows, best] & (b >= a) & (b >= c)
        return (at + peak) * GRAIN - self.reach, found


def fitted(points: SeenEdges, start: Array) -> CameraFit | None:
    """The change of a camera that fits its images best, from a first guess (7,); None where too little is seen."""
    prior = np.diag(points.deviations**-2.0)
    change = np.append(start, np.zeros(len(prior) - len(start)))
    for width in WIDTHS:
        edges, found = points.nearest(points.away(change), width)
        if found.sum() < LEAST_POINTS:
            return None
        for _ in range(2):
            J, r = points.slopes(change)[found], (edges - points.away(change))[found]
            w, sigma = _weights(r)
            JtW = (J * (w / points.alike[found] / sigma**2)[:, None]).T
            change = change + np.linalg.solve(JtW @ J + prior, JtW @ r - prior @ change)
    away = points.away(change)
    edges, found = points.nearest(away, WIDTHS[-1])
    slopes = points.slopes(change)
    J, r = slopes[found], (edges - away)[found]
    w, sigma = _weights(r)
    pulls = J * (w / points.alike[found] / sigma**2)[:, None]
    covariance = np.linalg.inv(pulls.T @ J + prior)
    # Points of one body are wrong together, also in all images: sums over bodies tell how much.
    _, cluster = np.unique(points.body[found], return_inverse=True)
    sums = np.zeros((cluster.max() + 1, len(change)))
    np.add.at(sums, cluster, pulls * r[:, None])
    covariance = covariance + covariance @ (sums.T @ sums) @ covariance
    still = np.where(np.arange(len(change)) < 6, change, 0.0)
    moved = (points.away(still) - points.away(np.zeros_like(change)))[found]
    moving = np.abs(slopes[:, 6]) > FAST
    loss = np.ones(len(found))
    loss[found] = 1.0 - np.maximum(1.0 - (r / (TUKEY * sigma)) ** 2, 0.0) ** 3
    return CameraFit(
        change=change[:7],
        covariance=covariance[:7, :7],
        residual=sigma,
        points=int((w > 0).sum()),
        cost=float(loss.mean()),
        moving_cost=float(loss[moving].mean() if moving.sum() >= LEAST_POINTS else loss.mean()),
        pixels=float(np.sqrt(np.mean(moved**2))),
    )


def _weights(r: Array) -> tuple[Array, float]:
    """Tukey's weights of residuals, and their standard deviation by the median."""
    sigma = max(1.4826 * float(np.median(np.abs(r))), SHARPEST)
    return np.maximum(1.0 - (r / (TUKEY * sigma)) ** 2, 0.0) ** 2, sigma


def first_guess(points: SeenEdges, offsets: Sequence[float]) -> Array:
    """The turn of a camera and the offset of its clock for which most points meet edges, on a coarse grid, (7,).

    offsets: of the clock that are tried [s].
    """
    rows = np.random.default_rng(0).permutation(len(points.pixels))[:2500]
    strength = np.minimum(points.contrast[rows] / 10.0, 1.0)
    strength = cv2.GaussianBlur(strength.astype(np.float32), (0, 0), sigmaX=2.0, sigmaY=1e-6)
    by_offset = points.slopes(np.zeros(len(points.deviations)))[rows, 6]
    reach = points.reach - 2.0
    sides = np.arange(-reach, reach + 1e-9, 2.0)
    best, guess = -1.0, np.zeros(7)
    fx, fy = np.diag(points.projection.camera.matrix)[:2]
    normals = points.normals[rows]
    for offset in offsets:
        still = by_offset * offset
        for dx in sides:
            away = still[:, None] + normals[:, :1] * dx + normals[:, 1:] * sides
            at = np.rint((away + points.reach) / GRAIN).astype(np.int64)
            inside = (at >= 0) & (at < strength.shape[1])
            met = np.where(inside, np.take_along_axis(strength, np.clip(at, 0, strength.shape[1] - 1), axis=1), 0.0)
            scores = met.mean(axis=0)
            if scores.max() > best:
                dy = float(sides[int(np.argmax(scores))])
                best, guess = float(scores.max()), np.array([dy / fy, -dx / fx, 0.0, 0.0, 0.0, 0.0, offset])
    return guess
