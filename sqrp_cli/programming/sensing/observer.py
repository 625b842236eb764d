"""Coverage of targets by cameras over a batch of states.

The full verdict matrix, or just what is covered, as fast as possible.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, box_corners, inverse, transform
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.projection import Projection
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.culprit import find_culprits
from sqrp_cli.programming.sensing.limits import LimitVerdicts, check_limits
from sqrp_cli.programming.sensing.occlusion import HullTester, Pairs, SightLines, near_pairs, shrink
from sqrp_cli.programming.sensing.scene import SceneStates, rows_of
from sqrp_cli.programming.sensing.visible_share import visible_shares
from sqrp_cli.programming.solids import Solid
from sqrp_cli.programming.targets import Target, TargetBox

_TOGETHER = 100
"""Views that are tested at once even if fewer might do: below this the calls cost more than what they compute."""

Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class BoxVerdicts:
    """Verdicts of one box over m states and c cameras, each array of shape (m, c).

    cause: codes of `Cause`. by: index of the occluding solid where hidden, of the image side where out of the image,
    else -1.
    figure: by how much the limit that failed first is missed (see `LimitVerdicts`). visible: share of the silhouette
    that is seen, NaN where an earlier limit failed.
    """

    cause: NDArray[np.int8]
    by: NDArray[np.int64]
    figure: Array
    visible: Array


@dataclass(frozen=True, eq=False)
class TargetCoverage:
    """Whether a target is covered in m states, and how soon after an event the images show it.

    covered: shape (m,). response: [s], shape (m,): the k-th smallest response among the cameras that cover it; NaN if
    uncovered.
    """

    covered: Mask
    response: Array


@dataclass(frozen=True, eq=False)
class Views:
    """Pairs of a camera and a state, by index, shape (v,) each."""

    camera: NDArray[np.int64]
    state: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Observer:
    """The cameras of a cell with everything solid in it."""

    cameras: tuple[Camera, ...]
    solids: tuple[Solid, ...]
    _projections: tuple[Projection, ...] = field(init=False)
    _tester: HullTester = field(init=False, default_factory=HullTester)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_projections", tuple(Projection.of(camera) for camera in self.cameras))

    def verdicts(self, target: Target, states: SceneStates, *, shares: bool = True) -> tuple[BoxVerdicts, ...]:
        """The full matrix of a target: every box, state and camera, with causes.

        shares: whether to measure the visible shares; without, `visible` stays NaN, and only verdicts are right.
        """
        return tuple(self._box_verdicts(box, states, shares=shares) for box in target.boxes)

    def coverage(self, target: Target, states: SceneStates, rows: Rows) -> TargetCoverage:
        """Whether a target is covered in the states `rows`, asking no more cameras than needed.

        Cameras are asked fastest response first, so that the response found is that of the best k cameras.
        """
        response = np.full(len(rows), np.nan)
        count = np.zeros(len(rows), dtype=np.int64)
        if not len(rows):
            return TargetCoverage(count >= target.cameras, response)
        within = np.logical_and.reduce([self.limits(box, states, rows).cause == Cause.NONE for box in target.boxes])
        possible = within.sum(axis=0) >= target.cameras
        for tier in self._tiers():
            order, row = np.nonzero(within[tier] & possible & (count < target.cameras))
            if len(row):
                self._count_seeing(target, states, Views(tier[order], rows[row]), row, count)
            reached = (count >= target.cameras) & np.isnan(response)
            response[reached] = self.cameras[tier[0]].response
        return TargetCoverage(count >= target.cameras, response)

    def _tiers(self) -> list[NDArray[np.int64]]:
        """Indices of cameras grouped by response, fastest first."""
        responses = np.array([camera.response for camera in self.cameras])
        return [np.flatnonzero(responses == response) for response in np.unique(responses)]

    def _count_seeing(
        self, target: Target, states: SceneStates, views: Views, row: Rows, count: NDArray[np.int64]
    ) -> None:
        """Add to `count` of each row how many of its views see the target, at least up to the number it needs.

        Views whose hulls nothing is near see it without further tests. The others of a row are tested one after the
        other, those with the fewest solids near first, until enough of them see it.
        """
        poses = states.solid_poses(self.solids)
        lines = [self._sight_lines(box, states, views) for box in target.boxes]
        near = [near_pairs(line, poses, self._opaque(box)) for line, box in zip(lines, target.boxes, strict=True)]
        pending = np.bincount(np.concatenate([line for line, _ in near]), minlength=len(row))
        np.add.at(count, row[pending == 0], 1)
        unsettled = np.flatnonzero(pending)
        order = unsettled[np.lexsort((pending[unsettled], row[unsettled]))]
        for asked in _one_per_row(order, row, count, target.cameras):
            enough = np.ones(len(row), dtype=bool)
            for box, line, pairs in zip(target.boxes, lines, near, strict=True):
                left = _of_lines(pairs, asked[enough[asked]])
                if box.detector.min_visible < 1:  # the shares tell of empty hulls as well, and faster
                    enough &= self._shares(box, states, views, line, left) >= box.detector.min_visible
                else:
                    blocked, _ = self._tester.met(line, poses, left, first_only=True)
                    enough[blocked] = False
            np.add.at(count, row[asked[enough[asked]]], 1)

    def limits(self, box: TargetBox, states: SceneStates, rows: Rows) -> LimitVerdicts:
        """Limits of every camera in the states `rows`, each array of shape (c, rows)."""
        shape = (len(self.cameras), len(rows))
        cause, side, figure = np.empty(shape, dtype=np.int8), np.empty(shape, dtype=np.int8), np.empty(shape)
        corners_B, X_WB = box_corners(box.size), states.box_poses(box)
        moving = np.array([len(states.X_WF[camera.frame]) > 1 for camera in self.cameras], dtype=bool)
        for group in (np.flatnonzero(~moving), np.flatnonzero(moving)):
            if not len(group):
                continue
            X_WC = np.stack([states.camera_poses(self.cameras[index]) for index in group])
            at = rows if len(X_WB) > 1 or X_WC.shape[1] > 1 else rows[:1]
            X_CB = inverse(X_WC[:, at] if X_WC.shape[1] > 1 else X_WC) @ (X_WB[at] if len(X_WB) > 1 else X_WB)
            normal_C = None if box.normal is None else X_CB[..., :3, :3] @ np.asarray(box.normal)
            projections = [self._projections[index] for index in group]
            limits = check_limits(projections, box.detector, transform(X_CB, corners_B), normal_C)
            cause[group], side[group], figure[group] = limits.cause, limits.side, limits.figure
        return LimitVerdicts(cause, side, figure)

    def _sight_lines(self, box: TargetBox, states: SceneStates, views: Views) -> SightLines:
        """One sight line per view; views of a camera and box that both stand still share a hull."""
        corners_B, _ = shrink(box.size, box.normal)
        corners_W = transform(states.box_poses(box), corners_B)
        moving = np.array([len(states.X_WF[camera.frame]) > 1 for camera in self.cameras], dtype=bool)
        if len(corners_W) > 1 or moving[views.camera].any():
            first = hull = np.arange(len(views.camera))
        else:
            _, first, hull = np.unique(views.camera, return_index=True, return_inverse=True)
        X_WC = self._camera_poses(states, Views(views.camera[first], views.state[first]))
        return SightLines(views.state, hull, X_WC[:, :3, 3], rows_of(corners_W, views.state[first]))

    def _camera_poses(self, states: SceneStates, views: Views) -> Array:
        """World poses of the optical frame of each view, shape (v, 4, 4)."""
        poses = [states.camera_poses(camera) for camera in self.cameras]
        X_WC = np.stack([X[0] for X in poses])[views.camera]
        for index, X in enumerate(poses):
            if len(X) > 1:
                here = np.flatnonzero(views.camera == index)
                X_WC[here] = X[views.state[here]]
        return X_WC

    def _opaque(self, box: TargetBox) -> list[int]:
        """Indices of the solids that can hide a box."""
        parts = [solid.part for solid in self.solids]
        return [i for i, part in enumerate(parts) if part.parent not in box.encloses and part.name not in box.encloses]

    def _shares(self, box: TargetBox, states: SceneStates, views: Views, lines: SightLines, near: Pairs) -> Array:
        """Visible shares of a box, shape (v,), of solids that may reach into its view hulls; 1 where there are none."""
        shares = np.ones(len(views.camera))
        blocked, position = np.unique(near[0], return_inverse=True)
        if len(blocked):
            _, first, hull = np.unique(lines.hull[blocked], return_index=True, return_inverse=True)
            one_each = Views(views.camera[blocked[first]], views.state[blocked[first]])
            X_WC, X_WB = self._camera_poses(states, one_each), rows_of(states.box_poses(box), one_each.state)
            corners, _ = shrink(box.size, box.normal)
            poses = states.solid_poses(self.solids)
            state = views.state[blocked]
            shares[blocked] = visible_shares(X_WC, X_WB, corners, hull, state, poses, (position, near[1]))
        return shares

    def _box_verdicts(self, box: TargetBox, states: SceneStates, *, shares: bool) -> BoxVerdicts:
        limits = self.limits(box, states, np.arange(states.count))
        cause, by, figure = limits.cause.T.copy(), limits.side.T.astype(np.int64), limits.figure.T.copy()
        visible = np.full(cause.shape, np.nan)
        views = Views(*np.nonzero(limits.cause == Cause.NONE))
        poses = states.solid_poses(self.solids)
        lines = self._sight_lines(box, states, views)
        met = self._tester.met(lines, poses, near_pairs(lines, poses, self._opaque(box)), first_only=False)
        hidden = np.zeros(len(views.camera), dtype=bool)
        hidden[met[0]] = True
        if shares or box.detector.min_visible < 1:
            share = self._shares(box, states, views, lines, met)
            if shares:
                visible[views.state, views.camera] = share
            hidden &= (share < box.detector.min_visible) | (box.detector.min_visible >= 1)
        of_hidden = hidden[met[0]]
        center = rows_of(states.box_poses(box)[:, :3, 3], views.state)
        culprits = find_culprits(lines, center, poses, (met[0][of_hidden], met[1][of_hidden]))
        state, camera = views.state[hidden], views.camera[hidden]
        cause[state, camera], by[state, camera] = Cause.HIDDEN, culprits[hidden]
        return BoxVerdicts(cause, by, figure, visible)


def _one_per_row(order: Rows, row: Rows, count: NDArray[np.int64], needed: int) -> Iterator[Rows]:
    """Rounds over views that are ordered by row: in each, the next view of every row that has not got enough yet.

    A few views make one round.
    """
    order = order[count[row[order]] < needed]
    if len(order) <= _TOGETHER:
        if len(order):
            yield order
        return
    _, first, counts = np.unique(row[order], return_index=True, return_counts=True)
    for turn in range(int(counts.max())):
        asked = order[first[counts > turn] + turn]
        asked = asked[count[row[asked]] < needed]
        if len(asked):
            yield asked


def _of_lines(pairs: Pairs, lines: Rows) -> Pairs:
    """The pairs of some of the sight lines."""
    wanted = np.zeros(pairs[0].max(initial=-1) + 1, dtype=bool)
    wanted[lines[lines < len(wanted)]] = True
    kept = wanted[pairs[0]]
    return pairs[0][kept], pairs[1][kept]
