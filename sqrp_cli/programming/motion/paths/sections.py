"""The parts of a motion between its joint moves: where each may begin, and the moves that are tied to that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.programming.motion.ground_primitives import GroundPrimitive
from sqrp_cli.programming.motion.paths.branch_search import Station
from sqrp_cli.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Section:
    """A joint move (none at the start of the motion) and what is tied to where it ends, up to the next joint move.

    first: index of the first tied primitive in the skill.
    """

    move: GroundPrimitive | None
    first: int
    tied: tuple[GroundPrimitive, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether it begins at given joint positions, not at any that bring the tool to a pose."""
        return self.move is None or self.move.home


@dataclass(frozen=True, eq=False)
class Branch:
    """One way through a section: where its joint move ends, and the trajectories of the tied primitives.

    turns: offsets by whole turns of joints that keep all of it within the joints' limits, shape (k, n).
    """

    q: Array
    trajectories: tuple[Trajectory, ...]
    turns: Array

    @property
    def q_end(self) -> Array:
        """Where the last of its trajectories ends, shape (n,)."""
        return self.trajectories[-1].path.end if self.trajectories else self.q

    @property
    def duration(self) -> float:
        """Duration of its trajectories [s]."""
        return sum(trajectory.duration for trajectory in self.trajectories)


@dataclass(frozen=True, eq=False)
class Ways(Station):
    """All k ways through a section: its branches, with each of their turns.

    branches: some of one or more ways. of: index of the branch of each way, shape (k,). turns: of each, shape (k, n).
    """

    branches: tuple[Branch, ...]
    of: NDArray[np.intp]
    turns: Array

    @staticmethod
    def through(branches: Sequence[Branch]) -> Ways:
        """All ways of the branches of a section, of which there is at least one."""
        of = np.repeat(np.arange(len(branches)), [len(branch.turns) for branch in branches])
        turns = np.concatenate([branch.turns for branch in branches])
        q_start = np.stack([branch.q for branch in branches])[of] + turns
        q_end = np.stack([branch.q_end for branch in branches])[of] + turns
        duration = np.array([branch.duration for branch in branches])[of]
        return Ways(q_start, q_end, duration, tuple(branches), of, turns)

    def branch(self, k: int) -> Branch:
        """The branch of a way."""
        return self.branches[int(self.of[k])]

    def trajectories(self, k: int) -> list[Trajectory]:
        """Those of a way, in its turns."""
        return [Trajectory(t.path.shifted(self.turns[k]), t.law) for t in self.branch(k).trajectories]


def cut_into_sections(primitives: Sequence[GroundPrimitive]) -> list[Section]:
    """The primitives cut before each joint move; the first section has none, and may be empty."""
    cuts = [i for i, primitive in enumerate(primitives) if primitive.kind is JointMove]
    sections = [Section(None, 0, tuple(primitives[: cuts[0] if cuts else None]))]
    for cut, following in pairwise([*cuts, len(primitives)]):
        sections.append(Section(primitives[cut], cut + 1, tuple(primitives[cut + 1 : following])))
    return sections


class Failures:
    """Why branches fail, each with the index of the primitive at which it does.

    out_of_reach: whether a waypoint is, whatever is in the way.
    """

    def __init__(self) -> None:
        self._found: list[tuple[int, str]] = []
        self.out_of_reach = False

    def note(self, index: int, reason: str) -> None:
        """Note a reason at a primitive."""
        self._found.append((index, reason))

    def reasons(self, most: int) -> tuple[str, ...]:
        """The different reasons, those of the branches that got furthest first, at most so many."""
        furthest_first = sorted(self._found, key=lambda failure: -failure[0])
        return tuple(dict.fromkeys(reason for _, reason in furthest_first))[:most]
