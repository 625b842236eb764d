"""What one camera would see from many poses: for searches that move it, where cheap tests rule out most poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, box_corners, inverse, transform
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.light import Light
from sqrp_cli.programming.sensing.limits import Cause, check_limits
from sqrp_cli.programming.sensing.observer import needed_shares, unseen
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.sensing.sight_lines import SightLines, WatchedBoxes, shrink
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester, near_pairs
from sqrp_cli.programming.solids import Solid, Solids
from sqrp_cli.programming.targets import SoughtBox


class MovedCamera:
    """A camera that looks at n boxes in states, from poses that are not known yet."""

    def __init__(
        self,
        projection: Projection,
        boxes: Sequence[SoughtBox],
        solids: tuple[Solid, ...],
        states: SceneStates,
        *,
        box: Indices,
        state: Indices,
        lights: Sequence[Light] = (),
    ) -> None:
        """box, state: the n looks, by index, shape (n,) each."""
        self._lights = lights
        self._projection, self._boxes = projection, boxes
        self._box, self._state = box, state
        self._X_WF = states.X_WF[projection.camera.frame]
        self._watched = WatchedBoxes(boxes, (projection,), Solids(solids), states)
        self._tester = HullTester()
        poses = [states.box_poses(entry) for entry in boxes]
        still = np.array([len(X_WB) == 1 for X_WB in poses], dtype=bool) & (len(self._X_WF) == 1)
        self.X_WB: Array = np.stack([poses[b][s if len(poses[b]) > 1 else 0] for b, s in zip(box, state, strict=True)])
        """World pose of the box of each look, shape (n, 4, 4)."""
        self.corners: Array = transform(self.X_WB, box_corners([entry.size for entry in boxes])[box])
        """Corners of the boxes in the world, shape (n, 8, 3)."""
        # Boxes that never move in the image are checked against the limits once.
        keys = np.where(still[box], -1 - box, np.arange(len(box)))
        _, self._first, self._same = np.unique(keys, return_index=True, return_inverse=True)
        shrunk = [shrink(entry.size, entry.normal) for entry in boxes]
        self._half_size = np.array([entry.half_size for entry in shrunk])
        self._offset = np.array([entry.offset for entry in shrunk])

    def world_poses(self, X_FC: Array, look: Indices) -> Array:
        """World poses (v, 4, 4) of the optical frame at poses (v, 4, 4) in its frame, in the states of some looks."""
        still = len(self._X_WF) == 1
        return (self._X_WF if still else self._X_WF[self._state[look]]) @ X_FC

    def within(self, X_FC: Array) -> Mask:
        """Whether each look passes the limits of camera and detector from each of p poses (p, 4, 4); shape (p, n)."""
        p, u = len(X_FC), len(self._first)
        look = np.tile(self._first, p)
        X_CW = inverse(self.world_poses(np.repeat(X_FC, u, axis=0), look))
        normals = np.array([entry.normal or (0.0, 0.0, 0.0) for entry in self._boxes], dtype=float)[self._box[look]]
        R_CB = X_CW[:, :3, :3] @ self.X_WB[look, :3, :3]
        found = check_limits(
            [self._projection],
            [entry.limits for entry in self._boxes],
            detector=self._box[look],
            corners_C=np.ascontiguousarray(transform(X_CW, self.corners[look]).transpose(2, 1, 0))[:, :, None],
            normal_C=np.ascontiguousarray((R_CB @ normals[:, :, None])[..., 0].T)[:, None],
        )
        good: Mask = (found.cause[0] == Cause.NONE).reshape(p, u)[:, self._same]
        return good

    def unhidden(self, X_FC: Array, look: Indices) -> Mask:
        """Whether enough of the boxes of v looks is visible from poses (v, 4, 4) that are within the limits; (v,)."""
        box = self._box[look]
        lines = SightLines(
            state=self._state[look],
            hull=np.arange(len(look)),
            box=box,
            X_WC=self.world_poses(X_FC, look),
            X_WB=self.X_WB[look],
            half_size=self._half_size[box],
            offset=self._offset[box],
        )
        watched, gain = self._watched, np.full(len(look), self._projection.camera.brightness)
        needed = needed_shares(watched, lines, gain, self._lights)
        visible: Mask = needed <= 1.0
        near = near_pairs(lines, watched.solid_poses, watched.opaque)
        visible[unseen(watched, lines, near, needed, self._tester)] = False
        return visible
