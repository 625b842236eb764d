"""Which bodies must not touch each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.programming.motion.collision.contact import Pairs
from sqrp_cli.programming.motion.collision.low_bodies import LowBodies
from sqrp_cli.programming.motion.collision.placed_bodies import Indices, PlacedBodies


@dataclass(frozen=True, eq=False)
class BodyPairs:
    """P pairs of bodies that must not touch, by index, the outer one of the arm in `outer`, shape (P,) each.

    clearance: distance that they have to keep [m].
    boxed, covered: the larger of the two, around which culling puts a box, and the other one, which it covers by
    spheres.
    mover: index of the outer one among `PlacedBodies.moving`.
    reach: distance of the centres of the spheres around them from which they keep it for sure [m].
    low: which of `LowBodies` the outer one is if the inner one is larger and rests; -1 otherwise.
    """

    inner: Indices
    outer: Indices
    clearance: Array
    boxed: Indices
    covered: Indices
    mover: Indices
    reach: Array
    low: Indices

    @staticmethod
    def of(inner: Indices, outer: Indices, clearance: Array, bodies: PlacedBodies, low: LowBodies) -> BodyPairs:
        """low: those of the robot's bodies, with which `bodies` begins."""
        size = bodies.radii.max(axis=1)
        inner_is_larger = size[inner] >= size[outer]
        low_row = np.full(len(bodies.bodies), -1)
        low_row[: len(low.row)] = low.row
        return BodyPairs(
            inner=inner,
            outer=outer,
            clearance=clearance,
            boxed=np.where(inner_is_larger, inner, outer),
            covered=np.where(inner_is_larger, outer, inner),
            mover=np.searchsorted(bodies.moving, outer),
            reach=bodies.radius[inner] + bodies.radius[outer] + clearance,
            low=np.where(inner_is_larger & (bodies.frame[inner] < 0), low_row[outer], -1),
        )

    def without(self, allowed: Pairs, bodies: PlacedBodies) -> BodyPairs:
        """Those whose names are not of an allowed pair."""
        names = np.array([body.name for body in bodies.bodies])
        kept = np.ones(len(self.inner), dtype=bool)
        for first, second in sorted(allowed):
            is_first, is_second = names == first, names == second
            kept &= ~(is_first[self.inner] & is_second[self.outer] | is_second[self.inner] & is_first[self.outer])
        return self._chosen(kept)

    def _chosen(self, kept: NDArray[np.bool_]) -> BodyPairs:
        return BodyPairs(
            inner=self.inner[kept],
            outer=self.outer[kept],
            clearance=self.clearance[kept],
            boxed=self.boxed[kept],
            covered=self.covered[kept],
            mover=self.mover[kept],
            reach=self.reach[kept],
            low=self.low[kept],
        )
