"""A thing in an image: what its own parts cover of the outline of its box.

What a part leaves empty of its box, such as the hole of a ring, shows what is behind whether the part is there or not:
it is evidence of neither.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.runtime.perception.silhouettes import Outline, Silhouette
from sqrp_cli.runtime.perception.vision import Corners, Mask, corners_of, filled, middle

FINEST = 512.0
"""Pixels along the longer side of the picture in which a figure is measured, at most."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A thing at a pose in an image.

    box: the outline of its box. parts: the silhouette of its parts. area: that the parts cover of the outline [pixels],
    also beyond the image's edges. offset: from the middle of the outline to that of the parts, (2,) [pixels]; 0 for a
    thing that is a box.
    """

    box: Outline
    parts: Silhouette
    area: float
    offset: Array

    @classmethod
    def of(cls, box: Outline, parts: Silhouette) -> Figure:
        """The figure of a thing whose box and parts are there."""
        first, extent = corners_of(box.polygon.min(axis=0)), np.ptp(box.polygon, axis=0)
        scale = min(1.0, FINEST / float(extent.max()))
        width, height = (np.ceil(extent * scale).astype(int) + 1).tolist()

        def drawn(polygons: Iterable[Corners]) -> Mask:
            scaled = (np.rint((corners - first) * scale).astype(np.int32) for corners in polygons)
            return filled((height, width), (0, 0), scaled)

        outline = drawn([box.corners])
        covered = outline & drawn(piece.corners for piece in parts.parts)
        if not covered.any():
            return cls(box, parts, 0.0, np.zeros(2))
        area = box.area * float(covered.sum() / outline.sum())
        return cls(box, parts, area, (middle(covered) - middle(outline)) / scale)

    def mask(self, shape: tuple[int, int], origin: tuple[int, int]) -> Mask:
        """The pixels of a crop, `origin` (x, y) its first one, that the parts cover."""
        return self.outline(shape, origin) & self.parts.mask(shape, origin, np.inf)

    def outline(self, shape: tuple[int, int], origin: tuple[int, int]) -> Mask:
        """The pixels of a crop that the box covers."""
        return filled(shape, origin, [self.box.corners])
