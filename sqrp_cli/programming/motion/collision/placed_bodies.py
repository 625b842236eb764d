"""Placed bodies, and the pairs of them that must not touch, as arrays for culling."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, Indices, transform
from sqrp_cli.knowledge.robot.joint_tree import Mount
from sqrp_cli.programming.motion.collision.collision_body import SPHERES, Body, CoalPlacement, NamePairs, placement_at
from sqrp_cli.programming.motion.collision.motion_bound import LowBodies


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """S bodies, with their bounds in the frames of their parents P as arrays; the fields are those of `Body`."""

    bodies: tuple[Body, ...]
    X_PG: Array
    center: Array
    radius: Array
    centers: Array
    radii: Array
    X_PB: Array
    half: Array

    @staticmethod
    def of(bodies: Sequence[Body]) -> BodyArrays:
        """The arrays of some bodies."""

        def rows(values: Iterable[Array | float], *shape: int) -> Array:
            return np.array(list(values)).reshape(len(bodies), *shape)

        return BodyArrays(
            bodies=tuple(bodies),
            X_PG=rows((body.X_PG for body in bodies), 4, 4),
            center=rows((body.center for body in bodies), 3),
            radius=rows(body.radius for body in bodies),
            centers=rows((body.centers for body in bodies), SPHERES, 3),
            radii=rows((body.radii for body in bodies), SPHERES),
            X_PB=rows((body.X_PB for body in bodies), 4, 4),
            half=rows((body.half for body in bodies), 3),
        )


@dataclass(frozen=True, eq=False)
class PlacedBodies:
    """S bodies, each fixed in a frame F: that of a joint, or the world."""

    bodies: tuple[Body, ...]
    frame: Indices
    """Index of the joint, -1 for the world, shape (S,)."""
    depth: Indices
    """How many joints of the spine move it, (S,); see `MotionBound`."""
    X_FG: Array
    """Pose of the geometry, (S, 4, 4)."""
    center: Array
    radius: Array
    """Sphere around it, (S, 3) and (S,)."""
    centers: Array
    radii: Array
    """Spheres that cover its surface, (S, k, 3) and (S, k)."""
    X_FB: Array
    half: Array
    """Pose and half extents of a box around it, (S, 4, 4) and (S, 3)."""
    moving: Indices
    """Those that the arm moves, by index."""
    rods: tuple[tuple[int, tuple[int, ...]], ...]
    """Those of a linkage, by index among `moving`, with the joints beside the spine that move them."""

    @staticmethod
    def of(
        arrays: BodyArrays,
        rows: Sequence[int],
        depth: Sequence[int],
        mounts: Sequence[Mount],
        rods: Mapping[int, tuple[int, ...]],
    ) -> PlacedBodies:
        """Some of the bodies, by row, with the number of joints of the spine that move each, and its mount.

        rods: the joints beside the spine that move a body, by its index among those; see `MotionBound`.
        """
        X_FP = np.array([mount.X_JL for mount in mounts]).reshape(-1, 4, 4)
        chosen = np.array(rows, dtype=np.intp)
        moving = np.array([k for k, joints in enumerate(depth) if joints or k in rods], dtype=np.intp)
        return PlacedBodies(
            bodies=tuple(arrays.bodies[row] for row in rows),
            frame=np.array([mount.joint for mount in mounts], dtype=np.intp),
            depth=np.array(depth, dtype=np.intp),
            X_FG=X_FP @ arrays.X_PG[chosen],
            center=transform(X_FP, arrays.center[chosen, None])[:, 0],
            radius=arrays.radius[chosen],
            centers=transform(X_FP, arrays.centers[chosen]),
            radii=arrays.radii[chosen],
            X_FB=X_FP @ arrays.X_PB[chosen],
            half=arrays.half[chosen],
            moving=moving,
            rods=tuple((int(np.searchsorted(moving, k)), joints) for k, joints in rods.items()),
        )

    def world_centers(self, X_WF: Array) -> Array:
        """Centres of the spheres around the bodies, (m, S, 3), where the frames are at X_WF, (m, N + 1, 4, 4)."""
        X = X_WF[:, self.frame]
        return (X[..., :3, :3] @ self.center[:, :, None])[..., 0] + X[..., :3, 3]

    def gap(self, X_WF: Array, at: Indices, boxed: Indices, covered: Indices) -> Array:
        """A lower bound of the distance [m] of pairs, from a box around one and spheres around the other, shape (k,).

        at: which of the m rows of X_WF, (m, N + 1, 4, 4). boxed, covered: which bodies. Shape (k,) each.
        """
        X_WB = X_WF[at, self.frame[boxed]] @ self.X_FB[boxed]
        centers = transform(X_WF[at, self.frame[covered]], self.centers[covered])
        in_box = (centers - X_WB[:, None, :3, 3]) @ X_WB[:, :3, :3]
        outside = np.maximum(np.abs(in_box) - self.half[boxed][:, None], 0.0)
        gap: Array = (np.sqrt(np.einsum("kci,kci->kc", outside, outside)) - self.radii[covered]).min(axis=-1)
        return gap

    def placements(self, X_WF: Array, at: Indices, body: Indices) -> Iterator[CoalPlacement]:
        """Where geometries are, for coal, by row of X_WF, (m, N + 1, 4, 4), and body; both of shape (k,)."""
        return map(placement_at, X_WF[at, self.frame[body]] @ self.X_FG[body])


@dataclass(frozen=True, eq=False)
class BodyPairs:
    """P pairs of bodies that must not touch, by index, the outer one of the arm in `outer`, shape (P,) each."""

    inner: Indices
    outer: Indices
    clearance: Array
    """Distance that they have to keep [m]."""
    boxed: Indices
    covered: Indices
    """The larger of the two, bounded by a box in culling, and the other one, covered by spheres."""
    mover: Indices
    """Index of the outer one among `PlacedBodies.moving`."""
    inner_mover: Indices
    """That of the inner one, -1 if it rests."""
    reach: Array
    """Distance of the centres of their spheres from which the clearance is certain [m]."""
    low: Indices
    """Which of `LowBodies` the outer one is if the inner one is larger and rests; -1 otherwise."""

    @staticmethod
    def of(inner: Indices, outer: Indices, clearance: Array, bodies: PlacedBodies, low: LowBodies) -> BodyPairs:
        """low: those of the robot's bodies, with which `bodies` begins."""
        size = bodies.radii.max(axis=1)
        inner_is_larger = size[inner] >= size[outer]
        movers = np.full(len(bodies.bodies), -1)
        movers[bodies.moving] = np.arange(len(bodies.moving))
        low_row = np.full(len(bodies.bodies), -1)
        low_row[: len(low.row)] = low.row
        return BodyPairs(
            inner=inner,
            outer=outer,
            clearance=clearance,
            boxed=np.where(inner_is_larger, inner, outer),
            covered=np.where(inner_is_larger, outer, inner),
            mover=np.searchsorted(bodies.moving, outer),
            inner_mover=movers[inner],
            reach=bodies.radius[inner] + bodies.radius[outer] + clearance,
            low=np.where(inner_is_larger & (bodies.frame[inner] < 0), low_row[outer], -1),
        )

    def without(self, allowed: NamePairs, bodies: PlacedBodies) -> BodyPairs:
        """Those whose names are not of an allowed pair."""
        names = np.array([body.name for body in bodies.bodies])
        kept = np.ones(len(self.inner), dtype=bool)
        for first, second in sorted(allowed):
            is_first, is_second = names == first, names == second
            kept &= ~(is_first[self.inner] & is_second[self.outer] | is_second[self.inner] & is_first[self.outer])
        return BodyPairs(**{name: array[kept] for name, array in vars(self).items()})
