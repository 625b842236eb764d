"""How long the cameras lose sight of what matters along the paths that joint moves could take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.coverage.assessment import Rehearsal
from sqrp_cli.programming.coverage.look import Look, look_at
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.trajectory import Trajectory


class _ElsewhereStage(Stage):
    """The stage of a motion with its joints at other positions."""

    def __init__(self, stage: Stage, q: Array) -> None:
        """q: positions of the driven joints at the samples to come, shape (m, n)."""
        super().__init__(stage.model, stage.motion, stage.pieces, stage.X_WO)
        self._q = q

    def positions(self, samples: Samples) -> Array:
        """Those given, whatever the samples."""
        if len(samples) != len(self._q):
            raise ValueError(f"there are positions for {len(self._q)} samples, not {len(samples)}")
        return self._q


@dataclass(frozen=True, eq=False)
class WatchedMove:
    """A joint move of a studied way, which may take any path between its ends."""

    scene: Rehearsal
    primitive: int
    """Its index."""

    @property
    def name(self) -> str:
        """Of the move."""
        return self.scene.motion.primitives[self.primitive].name

    @cached_property
    def pieces(self) -> list[int]:
        """Indices of the motion's pieces within the move."""
        return [index for index, piece in enumerate(self.scene.stage.pieces) if piece.primitive == self.primitive]

    @property
    def is_monitored(self) -> bool:
        """Whether any formula applies during the move."""
        return any(self.scene.stage.pieces[index].literals for index in self.pieces)

    def look(self, trajectories: Sequence[Trajectory], samples: int) -> Look:
        """A look at each trajectory of the arm in the middle of as many equal stretches of time as `samples` says.

        Where formulas begin or end within the move, their share of its time counts as that in the studied motion.
        """
        stage, timed = self.scene.stage, self.scene.motion.primitives[self.primitive]
        share = (np.arange(samples) + 0.5) / samples
        q = np.concatenate([trajectory.positions(share * trajectory.duration) for trajectory in trajectories])
        driven = timed.trajectory.path.end
        q = np.concatenate([q, np.broadcast_to(driven[q.shape[1] :], (len(q), len(driven) - q.shape[1]))], axis=1)
        ends = np.array([stage.pieces[index].end for index in self.pieces[:-1]])
        piece = np.array(self.pieces)[np.searchsorted(ends, timed.start + share * (timed.end - timed.start))]
        at = Samples(np.tile(piece, len(trajectories)), np.zeros(len(q)))
        return Look(_ElsewhereStage(stage, q), self.scene.targets, at)


def blind_times(observer: Observer, moves: Sequence[tuple[WatchedMove, Sequence[Trajectory], int]]) -> list[Array]:
    """How long the state is not covered on trajectories of several moves of one cell, about [s], shape (b,) each.

    moves: each with its trajectories and the number of looks at each, see `WatchedMove.look`. All are one batch.
    """
    looks = [move.look(trajectories, samples) for move, trajectories, samples in moves if trajectories]
    seen = iter(look_at(observer, looks))
    times = []
    for _, trajectories, samples in moves:
        if not trajectories:
            times.append(np.zeros(0))
            continue
        observation = next(seen)
        blind = (observation.monitored & ~observation.states_covered).reshape(len(trajectories), samples)
        times.append(blind.mean(axis=1) * np.array([trajectory.duration for trajectory in trajectories]))
    return times
