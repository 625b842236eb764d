"""What one would use instead of view hulls: rays to points of the boxes, cast by MuJoCo or by Embree.

Both get what they are fastest with: MuJoCo all rays of a camera in one `mj_multiRay`, with its own bounding volumes;
Embree one scene per moving part and one for all that stands, occlusion queries only, rays moved into the part's frame.
Both ask only for views within the limits, drop a view at the first part that hides it, and, where coverage alone is
asked, stop at the first camera that sees the box.
"""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from sqrp_cli.geometry import Array, inverse, transform
from tests.benchmarks.scene import BenchmarkScene


class Peer(Protocol):
    """Casts rays for a scene. Matrices are boolean, of shape (boxes, cameras, states)."""

    name: str

    def hidden(self, within: Array, lattice: Array) -> Array:
        """Which views within the limits are hidden."""

    def covered(self, within: Array, lattice: Array) -> Array:
        """Which boxes are seen by any camera, shape (boxes, states)."""


class EmbreePeer:
    """Embree 4 through embreex."""

    name = "Embree"

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
        found = np.zeros(within.shape, dtype=bool)
        for number, box in enumerate(self._scene.boxes):
            points = self._scene.points(box, lattice)
            camera, state = np.nonzero(within[number])
            eyes = np.array([self._scene.eye(index) for index in range(within.shape[1])])[camera]
            found[number, camera, state] = self._blocked(eyes, points[state], state)
        return found

    def covered(self, within: Array, lattice: Array) -> Array:
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


class MujocoPeer:
    """MuJoCo's `mj_multiRay`."""

    name = "MuJoCo"

    def __init__(self, scene: BenchmarkScene) -> None:
        self._scene = scene
        spec = mujoco.MjSpec()
        frames = list(dict.fromkeys(solid.part.parent for solid in scene.observer.solids))
        bodies = {frame: spec.worldbody.add_body(name=f"part {frame}", mocap=True) for frame in frames}
        for number, solid in enumerate(scene.observer.solids):
            spec.add_mesh(
                name=str(number), uservert=solid.vertices.reshape(-1), userface=solid.triangles.reshape(-1),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )  # fmt: skip
            bodies[solid.part.parent].add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=str(number))
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._poses = [
            (
                self._model.body(f"part {frame}").mocapid[0],
                np.broadcast_to(scene.states.X_WF[frame], (scene.states.count, 4, 4)),
            )
            for frame in frames
        ]
        self._quaternion = np.zeros(4)

    def hidden(self, within: Array, lattice: Array) -> Array:
        found = np.zeros(within.shape, dtype=bool)
        points = np.stack([self._scene.points(box, lattice) for box in self._scene.boxes])
        for state in range(within.shape[2]):
            self._place(state)
            for camera in range(within.shape[1]):
                boxes = np.flatnonzero(within[:, camera, state])
                if len(boxes):
                    found[boxes, camera, state] = self._blocked(self._scene.eye(camera), points[boxes, state])
        return found

    def covered(self, within: Array, lattice: Array) -> Array:
        seen = np.zeros((within.shape[0], within.shape[2]), dtype=bool)
        points = np.stack([self._scene.points(box, lattice) for box in self._scene.boxes])
        for state in range(within.shape[2]):
            self._place(state)
            for camera in range(within.shape[1]):
                boxes = np.flatnonzero(within[:, camera, state] & ~seen[:, state])
                if len(boxes):
                    seen[boxes, state] = ~self._blocked(self._scene.eye(camera), points[boxes, state])
        return seen

    def _place(self, state: int) -> None:
        for body, X_WP in self._poses:
            mujoco.mju_mat2Quat(self._quaternion, X_WP[state, :3, :3].reshape(-1))
            self._data.mocap_pos[body], self._data.mocap_quat[body] = X_WP[state, :3, 3], self._quaternion
        mujoco.mj_kinematics(self._model, self._data)

    def _blocked(self, eye: Array, points: Array) -> Array:
        """Whether any ray to the points (b, n, 3) of each box is blocked, shape (b,)."""
        rays = (points - eye).reshape(-1, 3)
        lengths = np.linalg.norm(rays, axis=1)
        geom, distance = np.zeros(len(rays), dtype=np.int32), np.zeros(len(rays))
        directions = (rays / lengths[:, None]).reshape(-1)
        mujoco.mj_multiRay(
            self._model, self._data, eye, directions, None, True, -1, geom, distance, None, len(rays), lengths.max()
        )
        return ((distance >= 0) & (distance < lengths)).reshape(len(points), -1).any(axis=1)
