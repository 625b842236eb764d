"""Poses of robot and objects at any instant of a motion: the geometric side of skill states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.files.frames import carried_poses, frame_poses
from sqrp_cli.geometry import Array, Indices, Mask, pose
from sqrp_cli.motion.fingers import closed_behind
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.task.pieces import Piece


@dataclass(frozen=True, eq=False)
class Samples:
    """Instants of a motion: the piece that each belongs to, non-decreasing, and its time [s]; both of shape (m,)."""

    piece: NDArray[np.int64]
    t: Array

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def gaps(self) -> Array:
        """Time from each sample to the next within its piece [s], 0 at the end of a piece, shape (m - 1,)."""
        return np.where(np.diff(self.piece) == 0, np.diff(self.t), 0.0)

    @property
    def ends(self) -> Mask:
        """Whether each sample is the first or the last of its piece, shape (m,)."""
        ends: Mask = (np.diff(self.piece, prepend=-1) != 0) | (np.diff(self.piece, append=-1) != 0)
        return ends

    def some(self, which: Mask | Indices | list[int]) -> Samples:
        """Some of the samples, by mask or by index."""
        return Samples(self.piece[which], self.t[which])

    def joined(self, other: Samples) -> tuple[Samples, NDArray[np.int64]]:
        """These samples and others by piece and time, and the order that sorts these, followed by the others, so."""
        piece, t = np.concatenate([self.piece, other.piece]), np.concatenate([self.t, other.t])
        order = np.lexsort((t, piece))
        return Samples(piece[order], t[order]), order

    def with_new(self, other: Samples) -> Samples:
        """These samples and those others that are not among them, by piece and time."""
        known = set(zip(self.piece.tolist(), self.t.tolist(), strict=True))
        pairs = zip(other.piece.tolist(), other.t.tolist(), strict=True)
        return self.joined(other.some(np.array([pair not in known for pair in pairs], dtype=bool)))[0]


class Stage:
    """Robot, objects and their frames over a motion that begins with objects at known poses."""

    def __init__(
        self,
        model: RobotModel,
        motion: Motion,
        pieces: Sequence[Piece],
        X_WO: Mapping[str, Array],
        carried: Sequence[str] | None = None,
    ) -> None:
        """X_WO: known poses of objects at the start of the motion, by name, shape (4, 4).

        carried: names of the objects that do not stay there, by default of all that the tool holds at some time.
        """
        self.model, self.motion, self.pieces, self.X_WO = model, motion, tuple(pieces), X_WO
        self._primitive = np.array([piece.primitive for piece in self.pieces])
        held = dict.fromkeys(p.held for p in motion.primitives if p.held is not None)
        self.carried = tuple(held) if carried is None else tuple(carried)

    def of_interest(self, samples: Samples) -> Mask:
        """Whether each of m samples lies in an event of interest, shape (m,)."""
        return np.array([piece.of_interest for piece in self.pieces], dtype=bool)[samples.piece]

    def once_lost(self, closed: float = 1.0) -> Stage:
        """The motion of a tool that has lost what it should hold.

        The part lies where it stood or, if the tool held it from the start, where it is to stand. closed: how far the
        fingers have closed behind it, as a share of the way that is left to them.
        """
        motion, from_start = self.motion, self.motion.primitives[0].held
        lies = {name: (motion.final.X_WO if name == from_start else self.X_WO)[name] for name in self.carried}
        primitives = []
        for one in motion.primitives:
            trajectory = one.trajectory if one.held is None else closed_behind(self.model, one.trajectory, closed)
            primitives.append(replace(one, held=None, X_TO=None, X_WO={**one.X_WO, **lies}, trajectory=trajectory))
        lost = replace(motion, primitives=tuple(primitives))
        return Stage(self.model, lost, self.pieces, self.X_WO, self.carried)

    def samples_at(self, t: Array) -> Samples:
        """Instants in order, shape (n,) [s], as samples; those after the motion are at its end."""
        ends = np.array([piece.end for piece in self.pieces])
        t = np.minimum(t, ends[-1])
        return Samples(np.minimum(np.searchsorted(ends, t, side="right"), len(ends) - 1), t)

    def positions(self, samples: Samples) -> Array:
        """Positions of the motion's joints, shape (m, n)."""
        q = np.empty((len(samples), len(self.motion.joint_names)))
        for index, rows in self.by_primitive(samples):
            q[rows] = self.motion.positions(index, samples.t[rows])
        return q

    def held(self, samples: Samples) -> list[str | None]:
        """The object in the tool at each sample."""
        holding = [primitive.held for primitive in self.motion.primitives]
        return [holding[index] for index in self._primitive[samples.piece].tolist()]

    def requires(self, targets: Sequence[Target], samples: Samples) -> Mask:
        """Whether the state at each sample holds the atom of each target, shape (m, targets)."""
        atoms = [{literal.atom for literal in piece.literals} for piece in self.pieces]
        held = np.array([[target.atom in of_piece for target in targets] for of_piece in atoms], dtype=bool)
        return held[samples.piece]

    def states(self, samples: Samples, q: Array | None = None) -> SceneStates:
        """World poses of every frame at each sample; q: positions of the joints there if not the motion's, (m, n)."""
        return states_of([self], [samples], None if q is None else [q])

    @cached_property
    def resting(self) -> dict[str, Array]:
        """World poses of the objects that the motion does not carry, and of all at its start, shape (1, 4, 4) each."""
        starts = {name: X_start[None] for name, X_start in self.X_WO.items()}
        objects = {name: X_start for name, X_start in starts.items() if name not in self.carried}
        return frame_poses({}, objects, starts, pose()[None])

    def by_primitive(self, samples: Samples) -> list[tuple[int, slice]]:
        """The primitives with samples, and the slices of these."""
        count = len(self.motion.primitives)
        ends = self._primitive[samples.piece].searchsorted(np.arange(count), side="right").tolist()
        return [(index, slice(start, end)) for index, (start, end) in enumerate(pairwise([0, *ends])) if start < end]


def states_of(stages: Sequence[Stage], samples: Sequence[Samples], q: Sequence[Array] | None = None) -> SceneStates:
    """World poses of every frame at the samples of stages in one cell, those of one stage after the other's.

    q: positions of the joints at the samples of each stage, by default those of its motion.
    """
    model, counts = stages[0].model, [len(some) for some in samples]
    if q is None:
        q = [stage.positions(some) for stage, some in zip(stages, samples, strict=True)]
    X_WL = model.link_poses(np.concatenate(q) if len(q) > 1 else q[0])
    links = {name: X[:1] if name in model.still_links else X for name, X in X_WL.items()}
    X_WT = np.split(X_WL[model.tool_frame], np.cumsum(counts)[:-1])
    # Some primitives carry an object, and it rests in the others.
    carried: list[dict[str, Array]] = []
    for stage, some, X_of_tool in zip(stages, samples, X_WT, strict=True):
        during = [(rows, stage.motion.primitives[index]) for index, rows in stage.by_primitive(some)]
        stays = {
            name: [(rows, p.X_TO if p.held == name else None, p.X_WO.get(name)) for rows, p in during]
            for name in stage.carried
        }
        carried.append({name: carried_poses(X_of_tool, own) for name, own in stays.items()})
    # Objects and their starts: of shape (m, 4, 4), or (1, 4, 4) for what rests at one place in all states.
    objects = dict(stages[0].resting)
    in_one_world = all(stage.X_WO is stages[0].X_WO for stage in stages)
    for name in dict.fromkeys(chain.from_iterable(carried if in_one_world else [objects, *carried])):
        poses = [own[name] if name in own else stage.resting[name] for stage, own in zip(stages, carried, strict=True)]
        objects[name] = poses[0]
        if len(poses[0]) > 1 or not all(np.array_equal(X, poses[0]) for X in poses):
            lasting = (np.broadcast_to(X, (count, 4, 4)) for X, count in zip(poses, counts, strict=True))
            objects[name] = np.concatenate(list(lasting))
    return SceneStates(sum(counts), frame_poses(links, objects, {}, pose()[None]))
