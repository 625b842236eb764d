"""What one camera would see from many poses: for searches that move it, where cheap tests rule out most poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, box_corners, transform
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.light import Light
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.sensing.sight_scene import SightScene
from sqrp_cli.programming.solids import Solid, Solids
from sqrp_cli.programming.targets import SoughtBox
from sqrp_cli.sight.kernel import Items


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
        scene = SightScene(Solids(solids), {str(number): light for number, light in enumerate(lights)})
        self._request = scene.request([projection], boxes, states)
        self._looks = Items(state, box, np.ones(len(box), dtype=np.int64))
        X_WB = [states.box_poses(entry) for entry in boxes]
        own = np.stack([X_WB[b][s if len(X_WB[b]) > 1 else 0] for b, s in zip(box, state, strict=True)])
        self.corners: Array = transform(own, box_corners([entry.size for entry in boxes])[box])
        """Corners of the boxes in the world, shape (n, 8, 3)."""

    def within(self, X_FC: Array) -> Mask:
        """Whether each look passes the limits of camera and detector from each of p poses (p, 4, 4); shape (p, n)."""
        within: Mask = self._request.look_from(X_FC, self._looks, limits_only=True)[0]
        return within

    def unhidden(self, X_FC: Array, look: Indices) -> Mask:
        """Whether each of v looks shows its box from a pose (v, 4, 4) of its own; grouped by pose; (v,)."""
        begins = np.ones(len(X_FC), dtype=bool)
        begins[1:] = np.any(X_FC[1:] != X_FC[:-1], axis=(1, 2))
        pose = np.cumsum(begins) - 1
        asked = np.zeros((int(begins.sum()), len(self._looks.state)), dtype=bool)
        asked[pose, look] = True
        visible: Mask = self._request.look_from(X_FC[begins], self._looks, asked)[0][pose, look]
        return visible
