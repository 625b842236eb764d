"""Line of sight, exactly: which solids reach into the view hull of a box.

The hull decides for the whole box at once; rays to its corners would miss thin occluders. coal's answer against the
meshes is exact; only what `culling` leaves is handed to it.
"""

from __future__ import annotations

import coal
import numpy as np

from sqrp_cli.geometry import BOX_SIGNS
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines, SolidPoses
from sqrp_cli.programming.sensing.solids import BOX_TRIANGLES, Solid


class HullTester:
    """Tests view hulls against solids with coal; holds one convex shape whose points are overwritten for each hull."""

    def __init__(self) -> None:
        faces = coal.StdVec_Triangle()
        for triangle in BOX_TRIANGLES.tolist():
            faces.append(coal.Triangle(*triangle))
        points = coal.StdVec_Vec3s()
        points.extend([*BOX_SIGNS, np.array([0.0, 0.0, 3.0])])
        # Only the points matter to the support function; the faces are there because coal asks for some.
        self._hull = coal.Convex(points, faces)
        self._points = self._hull.points()
        self._at_origin = coal.Transform3s.Identity()
        self._placement = coal.Transform3s.Identity()
        self._request = coal.CollisionRequest()
        self._result = coal.CollisionResult()

    def met(self, lines: SightLines, poses: SolidPoses, pairs: Pairs, *, first_only: bool) -> Pairs:
        """Those of the pairs whose solid reaches into its view hull; only the first of each line if `first_only`.

        A hull that is not finite counts as met.
        """
        found = np.zeros(len(pairs[0]), dtype=bool)
        if not len(found):
            return pairs
        hulls = np.concatenate([lines.corners, lines.eyes[:, None]], axis=1)
        hull_of = lines.hull.tolist()
        still: dict[tuple[int, int], bool] = {}
        placements = {}
        for index in np.unique(pairs[1]).tolist():
            X_WG = poses.pose(index) @ poses.solids[index].part.X_PG
            placements[index] = (np.ascontiguousarray(X_WG[:, :3, :3]), np.ascontiguousarray(X_WG[:, :3, 3]))
        states, finite = lines.state.tolist(), lines.finite.tolist()
        current, done, loaded = -1, False, -1
        for row, (line, index) in enumerate(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True)):
            if line != current:
                current, done = line, False
            elif done:
                continue
            rotations, translations = placements[index]
            hull, fixed = hull_of[line], len(translations) == 1
            hit = still.get((hull, index)) if fixed else None
            if hit is None:
                if hull != loaded:
                    self._points[:] = hulls[hull]
                    loaded = hull
                at = 0 if fixed else states[line]
                self._placement.setRotation(rotations[at])
                self._placement.setTranslation(translations[at])
                hit = not finite[hull] or self._meets(poses.solids[index])
                if fixed:
                    still[hull, index] = hit
            found[row] = hit
            done = hit and first_only
        return pairs[0][found], pairs[1][found]

    def _meets(self, solid: Solid) -> bool:
        self._result.clear()
        contacts: int = coal.collide(
            self._hull, self._at_origin, solid.geometry, self._placement, self._request, self._result
        )
        return contacts > 0
