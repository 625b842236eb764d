"""Coverage of targets by cameras over a batch of states.

The full verdict matrix, or just what is covered, as fast as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.culprit import find_culprits
from sqrp_cli.programming.sensing.limits import LimitVerdicts, check_limits
from sqrp_cli.programming.sensing.occlusion import HullTester, SightLines, SolidPoses, near_pairs, shrink
from sqrp_cli.programming.sensing.projection import Projection
from sqrp_cli.programming.sensing.scene import SceneStates, relative, rows_of
from sqrp_cli.programming.sensing.visible_share import visible_shares
from sqrp_cli.programming.solids import Solid
from sqrp_cli.programming.targets import Target, TargetBox

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
class Observer:
    """The cameras of a cell with everything solid in it."""

    cameras: tuple[Camera, ...]
    solids: tuple[Solid, ...]
    _projections: tuple[Projection, ...] = field(init=False)
    _tester: HullTester = field(init=False, default_factory=HullTester)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_projections", tuple(Projection.of(camera) for camera in self.cameras))

    def verdicts(self, target: Target, states: SceneStates) -> tuple[BoxVerdicts, ...]:
        """The full matrix of a target: every box, state and camera, with causes."""
        return tuple(self._box_verdicts(box, states) for box in target.boxes)

    def coverage(self, target: Target, states: SceneStates, rows: Rows) -> TargetCoverage:
        """Whether a target is covered in the states `rows`, asking no more cameras than needed.

        Cameras are asked fastest response first, so that the response found is that of the best k cameras.
        """
        response = np.full(len(rows), np.nan)
        count = np.zeros(len(rows), dtype=np.int64)
        within = np.stack(
            [self._within_limits(index, target.boxes, states, rows) for index in range(len(self.cameras))]
        )
        open_rows = within.sum(axis=0) >= target.cameras
        for tier in self._tiers(within):
            partial: list[tuple[int, Rows]] = []
            for index in tier:
                here = np.flatnonzero(open_rows & within[index])
                clear, part = self._clear(index, target.boxes, states, rows[here])
                count[here[clear]] += 1
                open_rows &= count < target.cameras
                partial.append((index, here[part]))
            for index, candidates in partial:
                here = candidates[open_rows[candidates]]
                count[here[self._enough_visible(index, target.boxes, states, rows[here])]] += 1
                open_rows &= count < target.cameras
            reached = (count >= target.cameras) & np.isnan(response)
            response[reached] = self.cameras[tier[0]].response
        return TargetCoverage(count >= target.cameras, response)

    def _tiers(self, within: Mask) -> list[list[int]]:
        """Cameras grouped by response, fastest first.

        Within a group the one with most states inside its limits first.
        """
        order = sorted(range(len(self.cameras)), key=lambda i: (self.cameras[i].response, -int(within[i].sum()), i))
        tiers: list[list[int]] = []
        for index in order:
            if tiers and self.cameras[tiers[-1][0]].response == self.cameras[index].response:
                tiers[-1].append(index)
            else:
                tiers.append([index])
        return tiers

    def _limits(self, index: int, box: TargetBox, X_WC: Array, X_WB: Array) -> LimitVerdicts:
        X_CB = relative(X_WC, X_WB)
        normal = None if box.normal is None else X_CB[:, :3, :3] @ np.asarray(box.normal)
        return check_limits(self._projections[index], box.detector, transform(X_CB, box_corners(box.size)), normal)

    def _within_limits(self, index: int, boxes: Sequence[TargetBox], states: SceneStates, rows: Rows) -> Mask:
        """Whether every box passes every limit of a camera that needs no scene, shape (rows,)."""
        X_WC = states.camera_poses(self.cameras[index])
        passed = np.ones(len(rows), dtype=bool)
        for box in boxes:
            X_WB = states.box_poses(box)
            moving = len(X_WC) > 1 or len(X_WB) > 1
            limits = self._limits(
                index, box, rows_of(X_WC, rows) if moving else X_WC, rows_of(X_WB, rows) if moving else X_WB
            )
            passed &= limits.cause == Cause.NONE
        return passed

    def _sight_lines(self, index: int, box: TargetBox, states: SceneStates, rows: Rows) -> SightLines:
        corners, _ = shrink(box.size, box.normal)
        eye = rows_of(states.camera_poses(self.cameras[index])[:, :3, 3], rows)
        return SightLines(rows, eye, rows_of(transform(states.box_poses(box), corners), rows))

    def _hits(
        self, index: int, box: TargetBox, states: SceneStates, rows: Rows, *, first_only: bool
    ) -> tuple[Rows, NDArray[np.int64]]:
        """Pairs (position in rows, solid) whose solid reaches into the view hull of a box."""
        poses = states.solid_poses(self.solids)
        solids = self._opaque(box)
        fixed_view = len(states.camera_poses(self.cameras[index])) == 1 and len(states.box_poses(box)) == 1
        fixed = [i for i in solids if fixed_view and len(poses.pose(i)) == 1]
        pairs = self._hull_hits(self._sight_lines(index, box, states, rows[:1]), poses, fixed, first_only=first_only)
        line = np.repeat(np.arange(len(rows)), len(pairs[1]))
        solid = np.tile(pairs[1], len(rows))
        if len(line) and first_only:
            return line, solid
        others = [i for i in solids if i not in fixed]
        moving = self._hull_hits(self._sight_lines(index, box, states, rows), poses, others, first_only=first_only)
        line, solid = np.concatenate([line, moving[0]]), np.concatenate([solid, moving[1]])
        order = np.lexsort((solid, line))
        return line[order], solid[order]

    def _hull_hits(
        self, lines: SightLines, poses: SolidPoses, solids: Sequence[int], *, first_only: bool
    ) -> tuple[Rows, NDArray[np.int64]]:
        pairs = near_pairs(lines, poses, solids)
        hit = self._tester.hits(lines, poses, pairs, first_only=first_only)
        return pairs[0][hit], pairs[1][hit]

    def _opaque(self, box: TargetBox) -> list[int]:
        """Indices of the solids that can hide a box."""
        parts = [solid.part for solid in self.solids]
        return [i for i, part in enumerate(parts) if part.parent not in box.encloses and part.name not in box.encloses]

    def _clear(self, index: int, boxes: Sequence[TargetBox], states: SceneStates, rows: Rows) -> tuple[Mask, Mask]:
        """Which rows see all boxes through empty view hulls, and which may still see enough of them."""
        clear, part = np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool)
        for box in boxes:
            asked = np.flatnonzero(part)
            lines, _ = self._hits(index, box, states, rows[asked], first_only=True)
            clear[asked[lines]] = False
            if box.detector.min_visible >= 1:
                part[asked[lines]] = False
        return clear, part & ~clear

    def _enough_visible(self, index: int, boxes: Sequence[TargetBox], states: SceneStates, rows: Rows) -> Mask:
        """Which rows see the least share of every box that its detector needs."""
        enough = np.ones(len(rows), dtype=bool)
        for box in boxes:
            asked = np.flatnonzero(enough)
            pairs = self._hits(index, box, states, rows[asked], first_only=False)
            enough[asked] = self._shares(index, box, states, rows[asked], pairs) >= box.detector.min_visible
        return enough

    def _shares(
        self, index: int, box: TargetBox, states: SceneStates, rows: Rows, pairs: tuple[Rows, NDArray[np.int64]]
    ) -> Array:
        """Visible shares of a box, shape (rows,); 1 where nothing reaches into its view hull."""
        shares = np.ones(len(rows))
        blocked, position = np.unique(pairs[0], return_inverse=True)
        if len(blocked):
            at = rows[blocked]
            X_WC = rows_of(states.camera_poses(self.cameras[index]), at)
            X_WB = rows_of(states.box_poses(box), at)
            corners, _ = shrink(box.size, box.normal)
            poses = states.solid_poses(self.solids)
            shares[blocked] = visible_shares(X_WC, X_WB, corners, at, poses, (position, pairs[1]))
        return shares

    def _box_verdicts(self, box: TargetBox, states: SceneStates) -> BoxVerdicts:
        shape = (states.count, len(self.cameras))
        cause, by = np.zeros(shape, dtype=np.int8), np.full(shape, -1, dtype=np.int64)
        figure, visible = np.zeros(shape), np.full(shape, np.nan)
        X_WB = states.box_poses(box)
        for index, camera in enumerate(self.cameras):
            limits = self._limits(index, box, states.camera_poses(camera), X_WB)
            cause[:, index], by[:, index], figure[:, index] = limits.cause, limits.side, limits.figure
            rows = np.flatnonzero(cause[:, index] == Cause.NONE)
            if not len(rows):
                continue
            pairs = self._hits(index, box, states, rows, first_only=False)
            shares = self._shares(index, box, states, rows, pairs)
            visible[rows, index] = shares
            hidden = np.zeros(len(rows), dtype=bool)
            hidden[pairs[0]] = True
            if box.detector.min_visible < 1:
                hidden = shares < box.detector.min_visible
            cause[rows[hidden], index] = Cause.HIDDEN
            of_hidden = hidden[pairs[0]]
            lines = self._sight_lines(index, box, states, rows)
            center = rows_of(X_WB[:, :3, 3], rows)
            culprits = find_culprits(
                lines, center, states.solid_poses(self.solids), (pairs[0][of_hidden], pairs[1][of_hidden])
            )
            by[rows[hidden], index] = culprits[hidden]
        return BoxVerdicts(cause, by, figure, visible)
