"""Coverage of targets by cameras over a batch of states: the full verdict matrix, or only the coverage.

What cameras see is computed by the compiled kernel, see `sqrp_cli.kernel`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, fields
from functools import cached_property

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import Light
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.kernel.kernel import BoxVerdicts, Items, Loss
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import SIDES, Cause, HidingPart
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.sight_scene import SightScene
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox, Target


def sees_all(boxes: Sequence[BoxVerdicts]) -> Mask:
    """Whether each camera sees all boxes of a target, shape (m, c)."""
    sees: Mask = np.all([box.cause == Cause.NONE for box in boxes], axis=0)
    return sees


def first_failing(boxes: Sequence[BoxVerdicts], rows: Indices | list[int]) -> tuple[BoxVerdicts, Indices]:
    """The verdict on the first box that each camera does not see, for each of the m samples `rows`.

    The second is the index of that box, 0 where all are seen, shape (m, c).
    """
    of_boxes = [np.stack([getattr(box, part.name)[rows] for box in boxes]) for part in fields(BoxVerdicts)]
    first = (of_boxes[0] != Cause.NONE).argmax(axis=0)[None]
    cause, by, figure, visible = (np.take_along_axis(values, first, axis=0)[0] for values in of_boxes)
    return BoxVerdicts(cause=cause, by=by, figure=figure, visible=visible), first[0]


@dataclass(frozen=True, eq=False)
class Observer:
    """The cameras of a cell with all its solids."""

    cameras: tuple[Camera, ...]
    solids: tuple[Solid, ...]
    lights: Mapping[str, Light] = field(default_factory=dict)
    """By name; if there are none, cameras see everything brightly enough."""

    def verdicts(
        self,
        targets: Sequence[Target],
        states: SceneStates,
        *,
        rows: Sequence[Indices] | None = None,
        shares: bool = True,
        culprits: bool = True,
    ) -> tuple[tuple[BoxVerdicts, ...], ...]:
        """The full matrix of targets: every box, state and camera, with causes.

        What is usually seen is asked of `coverage`: here, what the image's edge cuts does not add to what is hidden.

        rows: the states of each target, m of them, by index; all by default. shares: whether to measure the visible
        shares; without, `visible` stays NaN, and only the verdicts are valid. culprits: whether to find out `by`.
        """
        boxes = [box for target in targets for box in target.boxes]
        if not boxes:
            return tuple(() for _ in targets)
        everywhere = [np.arange(states.count)] * len(targets) if rows is None else rows
        asked = [at for target, at in zip(targets, everywhere, strict=True) for _ in target.boxes]
        counts = list(map(len, asked))
        request = self._scene.request(self.projections, boxes, states)
        found = request.judge(
            np.repeat(np.arange(len(boxes)), counts), np.concatenate(asked), shares=shares, culprits=culprits
        )
        of_boxes = map(BoxVerdicts, *(np.split(values, np.cumsum(counts)[:-1]) for values in vars(found).values()))
        return tuple(tuple(next(of_boxes) for _ in target.boxes) for target in targets)

    def coverage(
        self, targets: Sequence[Target], states: SceneStates, rows: Sequence[Indices], loss: Loss | None = None
    ) -> list[Mask]:
        """Whether enough cameras see each target in its m states `rows`, (m,); no more are tested than needed.

        loss: after which nothing more is looked at, and counts as uncovered.
        """
        counts = list(map(len, rows))
        needed = np.repeat([target.cameras for target in targets], counts)
        of_each, state = np.array([len(target.boxes) for target in targets]), np.concatenate([np.arange(0), *rows])
        items = Items(state, np.repeat(np.cumsum(of_each) - of_each, counts), np.repeat(of_each, counts))
        request = self._scene.request(self.projections, [box for one in targets for box in one.boxes], states)
        sees = request.cover(items, needed, loss)
        return np.split(sees.sum(axis=0) >= needed, np.cumsum(counts)[:-1]) if counts else []

    def occluders(
        self, boxes: Sequence[SoughtBox], states: SceneStates, box: Indices, camera: Indices, state: Indices
    ) -> list[tuple[HidingPart, ...]]:
        """Which parts hide how much of boxes in v views, largest share first, ties by name; for each view.

        box, camera, state: what is seen by which one when, by index, shape (v,) each.
        All corners of the boxes must lie in front of the cameras. The shares of a view add up to what is not visible.
        """
        names = self._scene.parts
        request = self._scene.request(self.projections, boxes, states)
        shares, alone = request.occluders(box, camera, state, len(names))
        found = []
        for first, only in zip(shares, alone, strict=True):
            some = [
                HidingPart(name=names[part], share=float(first[part]), alone=float(only[part]))
                for part in np.flatnonzero(first)
            ]
            found.append(tuple(sorted(some, key=lambda one: (-one.share, one.name))))
        return found

    def by_name(self, cause: Cause, by: int) -> str | None:
        """The name of a cause's culprit in output; by: see `BoxVerdicts`."""
        match cause:
            case Cause.HIDDEN | Cause.SAME_COLOUR | Cause.TOO_DARK:
                return None if by < 0 else self.solids[by].name
            case Cause.TOO_BRIGHT:
                return list(self.lights)[by]
            case Cause.OUT_OF_IMAGE:
                return SIDES[by]
            case _:
                return None

    def aspects(self, boxes: Sequence[SoughtBox], states: SceneStates) -> Array:
        """How every camera faces b boxes: distance [m], incidence [rad] and size [pixels], shape (b, 3, m, c).

        See `Request.measure`.
        """
        box, state = np.repeat(np.arange(len(boxes)), states.count), np.tile(np.arange(states.count), len(boxes))
        found = self._scene.request(self.projections, boxes, states).measure(box, state)
        return found.reshape(3, len(self.cameras), len(boxes), states.count).transpose(2, 0, 3, 1)

    def seen_from(
        self,
        lenses: Sequence[Camera],
        X_FC: Array,
        targets: Sequence[Target],
        states: SceneStates,
        state: Indices,
        target: Indices,
        *,
        decisive: Mask | None = None,
        limits_only: bool = False,
    ) -> Mask:
        """Whether one camera with each of l lenses sees all boxes of targets in states from each of p poses, (l, p, n).

        state, target: the n items, by index, shape (n,) each. lenses: cameras of one frame; their own poses do not
        count. X_FC: poses of the optical frame in that frame, (p, 4, 4). decisive: items, shape (n,), without which a
        pose is given up: all that follow come out unseen. limits_only: whether what hides boxes, is behind them or
        lights them does not count, which is some ten times as fast. Raises ValueError for lenses of several frames.
        """
        if len({lens.frame for lens in lenses}) > 1:
            raise ValueError("the lenses of one camera must have one frame")
        boxes = [box for target in targets for box in target.boxes]
        counts = np.array([len(one.boxes) for one in targets], dtype=np.int64)
        first = np.cumsum(counts) - counts
        request = self._scene.request([Projection(lens) for lens in lenses], boxes, states)
        return request.look_from(X_FC, Items(state, first[target], counts[target]), decisive, limits_only=limits_only)

    @cached_property
    def projections(self) -> list[Projection]:
        """Of each camera."""
        return [Projection(camera) for camera in self.cameras]

    @cached_property
    def _scene(self) -> SightScene:
        return SightScene(self.solids, self.lights)
