"""The triangles of a solid one by one, with what rays and view hulls are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.geometry import Array, cross
from sqrp_cli.programming.sensing.solids import Solid


@dataclass(frozen=True, eq=False)
class Facets:
    """F triangles of a solid in its parent's frame.

    points: their corners, shape (F, 3, 3) [m]. normals, offsets: n . p = o for the points p of each one's plane, shapes
    (F, 3), not of length 1, and (F,). edges: Plücker coordinates of the line along each of the three edges, moment
    before direction, shape (6, F) each. middles, radii: a sphere around each, shapes (F, 3) and (F,) [m].
    """

    points: Array
    normals: Array
    offsets: Array
    edges: tuple[Array, Array, Array]
    middles: Array
    radii: Array

    @staticmethod
    def of(solid: Solid) -> Facets:
        """The facets of a solid; made once."""
        if solid not in _facets:
            _facets[solid] = Facets._of_points(solid.vertices[solid.triangles])
        return _facets[solid]

    @staticmethod
    def _of_points(points: Array) -> Facets:
        a, b, c = points.swapaxes(0, 1)
        normals, middles = cross(b - a, c - a), points.mean(axis=1)
        reach = points - middles[:, None]
        return Facets(
            points=points,
            normals=normals,
            offsets=np.einsum("fi,fi->f", normals, a),
            edges=(_line(a, b), _line(b, c), _line(c, a)),
            middles=middles,
            radii=np.sqrt(np.einsum("fki,fki->fk", reach, reach).max(axis=1, initial=0.0)),
        )


def _line(start: Array, end: Array) -> Array:
    """Plücker coordinates of lines through points (F, 3), shape (6, F)."""
    return np.ascontiguousarray(np.concatenate([cross(start, end), end - start], axis=1).T)


_facets: WeakKeyDictionary[Solid, Facets] = WeakKeyDictionary()
"""What was made of solids that are still in use."""
