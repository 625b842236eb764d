"""Poses of robot and objects at any instant of a motion: the geometric side of skill states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.frames import Stay, carried_poses, frame_poses
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.pieces import Piece
from sqrp_cli.programming.sensing.scene_states import SceneStates, fixed_frame


@dataclass(frozen=True, eq=False)
class Samples:
    """Instants of a motion: the piece that each belongs to, non-decreasing, and its time [s]; both of shape (m,)."""

    piece: NDArray[np.int64]
    t: Array

    def __len__(self) -> int:
        return len(self.t)

    def merge_order(self, other: Samples) -> NDArray[np.int64]:
        """The order that sorts these samples, followed by the others, by piece and time."""
        return np.lexsort((np.concatenate([self.t, other.t]), np.concatenate([self.piece, other.piece])))

    def joined(self, other: Samples, order: NDArray[np.int64]) -> Samples:
        """These samples and the others, in an order that `merge_order` gave."""
        return Samples(np.concatenate([self.piece, other.piece])[order], np.concatenate([self.t, other.t])[order])


class Stage:
    """Robot, objects and their frames over a motion that begins with objects at known poses."""

    def __init__(self, model: RobotModel, motion: Motion, pieces: Sequence[Piece], X_WO: Mapping[str, Array]) -> None:
        """X_WO: known poses of objects at the start of the motion, shape (4, 4)."""
        self.model, self.motion, self.pieces = model, motion, tuple(pieces)
        self._primitive = np.array([piece.primitive for piece in self.pieces])
        self._X_WO = X_WO
        self._carried = dict.fromkeys(p.held for p in motion.primitives if p.held is not None)

    def positions(self, samples: Samples) -> Array:
        """Positions of the motion's joints, shape (m, n)."""
        q = np.empty((len(samples), len(self.motion.joint_names)))
        for index, rows in self._by_primitive(samples):
            q[rows] = self.motion.positions(index, samples.t[rows])
        return q

    def held(self, samples: Samples) -> list[str | None]:
        """The object in the tool at each sample."""
        holding = [primitive.held for primitive in self.motion.primitives]
        return [holding[index] for index in self._primitive[samples.piece].tolist()]

    def states(self, samples: Samples) -> SceneStates:
        """World poses of every frame at each sample."""
        X_WL = self.model.link_poses(self.positions(samples))
        links = {name: X[:1] if name in self.model.still_links else X for name, X in X_WL.items()}
        starts = {name: fixed_frame(X_start) for name, X_start in self._X_WO.items()}
        X_WT = X_WL[self.model.tool_frame]
        carried = {name: carried_poses(X_WT, self._stays(name, samples)) for name in self._carried}
        return SceneStates(len(samples), frame_poses(links, {**starts, **carried}, starts, fixed_frame()))

    def _stays(self, name: str, samples: Samples) -> Iterator[Stay]:
        """The stays of an object that some primitives carry and that rests in the others."""
        for index, rows in self._by_primitive(samples):
            primitive = self.motion.primitives[index]
            yield Stay(rows, primitive.X_TO if primitive.held == name else None, primitive.X_WO.get(name))

    def _by_primitive(self, samples: Samples) -> list[tuple[int, slice]]:
        """The primitives with samples, and the slices of these."""
        count = len(self.motion.primitives)
        ends = self._primitive[samples.piece].searchsorted(np.arange(count), side="right").tolist()
        return [(index, slice(start, end)) for index, (start, end) in enumerate(pairwise([0, *ends])) if start < end]
