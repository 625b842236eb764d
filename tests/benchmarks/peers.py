"""What one would use instead of view hulls: rays to points of the boxes, cast by Embree.

It gets what it is fastest with: one scene per moving part and one for all that stands, occlusion queries only, rays
moved into the part's frame; only views within the limits, which it is given; a view is dropped at the first part that
hides it, and where coverage alone is asked, a box at the first camera that sees it.
"""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from sqrp_cli.geometry import Array, inverse, transform
from tests.benchmarks.scene import BenchmarkScene


class EmbreePeer:
    """Embree 4 through embreex. Matrices are boolean, of shape (boxes, cameras, states)."""

    def __init__(self, scene: BenchmarkScene) -> None:
        self._scene = scene
        parts: dict[str, list[tuple[Array, Array]]] = {}
        for solid in scene.observer.solids:
            X_WP = scene.states.X_WF[solid.part.parent]
            still = len(X_WP) == 1
            vertices = transform(X_WP[0], solid.vertices) if still else solid.vertices
            parts.setdefault("world" if still else solid.part.parent, []).append((vertices, solid.triangles))
        self._parts = {}
        for frame, meshes in parts.items():
            embree = EmbreeScene()
            for vertices, triangles in meshes:
                TriangleMesh(embree, vertices.astype(np.float32), triangles.astype(np.int32))
            self._parts[frame] = (embree, inverse(scene.states.X_WF[frame]))

    def hidden(self, within: Array, lattice: Array) -> Array:
        """Which views within the limits are hidden."""
        found = np.zeros(within.shape, dtype=bool)
        for number, box in enumerate(self._scene.boxes):
            points = self._scene.points(box, lattice)
            camera, state = np.nonzero(within[number])
            eyes = np.array([self._scene.eye(index) for index in range(within.shape[1])])[camera]
            found[number, camera, state] = self._blocked(eyes, points[state], state)
        return found

    def covered(self, within: Array, lattice: Array) -> Array:
        """Which boxes are seen by any camera, shape (boxes, states)."""
        seen = np.zeros((within.shape[0], within.shape[2]), dtype=bool)
        for number, box in enumerate(self._scene.boxes):
            points = self._scene.points(box, lattice)
            for camera in range(within.shape[1]):
                state = np.flatnonzero(within[number, camera] & ~seen[number])
                eyes = np.broadcast_to(self._scene.eye(camera), (len(state), 3))
                seen[number, state] = ~self._blocked(eyes, points[state], state)
        return seen

    def _blocked(self, eyes: Array, points: Array, state: Array) -> Array:
        """Whether any ray from each eye (v, 3) to its points (v, n, 3) is blocked, shape (v,)."""
        blocked = np.zeros(len(eyes), dtype=bool)
        for embree, X_PW in self._parts.values():
            left = np.flatnonzero(~blocked)
            X = X_PW[state[left] if len(X_PW) > 1 else 0].astype(np.float32)
            R = np.swapaxes(X[..., :3, :3], -1, -2)
            rays = (points[left] - eyes[left, None]).astype(np.float32) @ R
            origin = (eyes[left, None].astype(np.float32) @ R)[:, 0] + X[..., :3, 3]
            origins = np.repeat(origin, points.shape[1], axis=0)
            hit = embree.run(origins, rays.reshape(-1, 3), np.ones(len(origins), dtype=np.float32), query="OCCLUDED")
            blocked[left] = (hit >= 0).reshape(len(left), points.shape[1]).any(axis=1)
        return blocked
