"""The joint moves between the branches of neighbouring sections: durations and collision checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.blended_path import motion_through
from sqrp_cli.motion.branch_search import Question
from sqrp_cli.motion.ground_primitives import GroundPrimitive
from sqrp_cli.motion.placed_scene import Contact, PlacedScene
from sqrp_cli.motion.position_limits import near_limits
from sqrp_cli.motion.sections import Branch, Failures, Section, Ways
from sqrp_cli.motion.timing import MotionLimits, joint_move, joint_move_duration
from sqrp_cli.motion.way_around import find_way
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.trajectory import Trajectory

TRIES_PER_WAY = 250
"""Most straight pieces that the search for one way around may check."""

MOST_TRIES = 1500
"""Most straight pieces that all searches for one motion may check together."""


@dataclass(frozen=True, eq=False)
class FoundMove:
    """A move between two branches, with the obstacle that it goes around, if any."""

    trajectory: Trajectory
    around: str | None = None


class JointMoves:
    """Makes and checks moves, and the primitives tied to their ends, on demand.

    tries: straight pieces that searches for ways around have checked.
    """

    def __init__(
        self,
        model: RobotModel,
        primitives: Sequence[GroundPrimitive],
        scenes: Sequence[PlacedScene],
        sections: Sequence[Section],
        ways: Sequence[Ways],
        q_start: Array,
        failures: Failures,
        seed: int,
    ) -> None:
        """scenes: the surroundings of each primitive. ways: those through each section."""
        self._model, self._primitives, self._scenes, self._sections = model, primitives, scenes, sections
        self._ways, self._failures, self._seed = ways, failures, seed
        self._bounds = near_limits(model, np.stack([q_start, model.home]))
        self._limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
        self._moves: dict[Question, FoundMove] = {}
        self._blocked: dict[Question, Contact] = {}
        self._contacts: dict[tuple[int, Trajectory], Contact | None] = {}
        self._tied_is_free = cache(self._check_tied)
        self._direct = cache(self._direct_move)
        self._through = cache(self._move_through)
        self.tries = 0

    @cached_property
    def durations(self) -> list[Array]:
        """Durations [s] of the direct moves from each way through a section to each of the next, (k_i, k_i+1) each."""
        return [
            self._move_durations(section.first - 1, before.q_end[:, None], after.q_start[None])
            for before, after, section in zip(self._ways[:-1], self._ways[1:], self._sections[1:], strict=True)
        ]

    def direct_works(self, i: int, previous: int, chosen: int) -> bool:
        """Whether a way through section i and the direct move to it from one through the section before are free."""
        if not self._tied_is_free(i, self._ways[i].branch(chosen)):
            return False
        if self._sections[i].move is None:
            return True
        direct = self._direct(i, previous, chosen)
        contact = self._contact(self._sections[i].first - 1, direct)
        if contact is None:
            self._moves[i, previous, chosen] = FoundMove(direct)
        else:
            self._blocked[i, previous, chosen] = contact
        return contact is None

    def way_works(self, i: int, previous: int, chosen: int) -> bool:
        """Whether there is a way around the obstacle of that move, first by its vias; none for moves by home."""
        contact = self._blocked.get((i, previous, chosen))
        if contact is None:
            return False  # The primitives tied to the branch are blocked, not the way to it.
        if self._has_vias(i) and isinstance(self._through(i, previous, chosen), FoundMove):
            return True
        index = self._sections[i].first - 1
        tries = min(TRIES_PER_WAY, MOST_TRIES - self.tries)
        if tries == 0 or self._primitives[index].via_home:
            return False
        limits, radii = self._move_limits(index), self._scenes[index].bound.radii
        ends = self._ends(i, previous, chosen)
        found = find_way(self._scenes[index], *ends, self._bounds, radii, limits, tries, self._seed)
        self.tries += found.tries
        if found.trajectory is not None:
            self._moves[i, previous, chosen] = FoundMove(found.trajectory, contact.second)
        return found.trajectory is not None

    def along(self, chosen: Sequence[int]) -> list[FoundMove] | Infeasible:
        """The moves of a sequence of ways through the sections that works; infeasible if one is blocked by its vias."""
        moves = []
        for i in range(1, len(chosen)):
            question = (i, chosen[i - 1], chosen[i])
            move = self._through(*question) if self._has_vias(i) else self._moves[question]
            if isinstance(move, Infeasible):
                return move
            moves.append(move)
        return moves

    def _has_vias(self, i: int) -> bool:
        """Whether the move to section i has vias."""
        move = self._sections[i].move
        return move is not None and move.vias is not None

    def _move_through(self, i: int, previous: int, chosen: int) -> FoundMove | Infeasible:
        """The move around its vias from a way through the section before to one through section i."""
        index = self._sections[i].first - 1
        vias, (q0, q1) = self._primitives[index].vias, self._ends(i, previous, chosen)
        if vias is None:
            raise ValueError(f"{self._primitives[index].name} has no vias")
        trajectory = motion_through(q0, vias, q1, self._move_limits(index))
        if (contact := self._scenes[index].check_path(trajectory.path)) is not None:
            return Infeasible((f"{self._at(index, trajectory, contact)} with its vias",))
        blocked = self._blocked.get((i, previous, chosen))
        return FoundMove(trajectory, None if blocked is None else blocked.second)

    def _check_tied(self, i: int, branch: Branch) -> bool:
        """Whether all primitives tied to the start of a branch are free."""
        for k, trajectory in enumerate(branch.trajectories, self._sections[i].first):
            before, now = self._primitives[max(k - 1, 0)], self._primitives[k]
            # Where the arm still stands at the end of the primitive before, that was checked: with the same contacts.
            stands = now.kind is not JointMove and not now.curves and k > 0
            known = stands and now.world is before.world and before.allowed <= now.allowed
            if not (known or self._contact(k, trajectory) is None) or not self._fingers_are_free(k, trajectory):
                return False
        return True

    def _contact(self, index: int, trajectory: Trajectory) -> Contact | None:
        """The first contact during a primitive; notes what touches, and when."""
        if (index, trajectory) not in self._contacts:
            self._contacts[index, trajectory] = self._scenes[index].check_path(trajectory.path)
        contact = self._contacts[index, trajectory]
        if contact is not None:
            self._failures.note(index, self._at(index, trajectory, contact))
        return contact

    def _at(self, index: int, trajectory: Trajectory, contact: Contact) -> str:
        """What touches, and when."""
        share = trajectory.law.time_at(contact.s) / trajectory.duration if trajectory.duration > 0 else 0.0
        return f"{contact} at {100 * share:.0f} % of {self._primitives[index].name}"

    def _fingers_are_free(self, index: int, trajectory: Trajectory) -> bool:
        """Whether the fingers touch nothing as they move during a primitive; notes what they do."""
        primitive = self._primitives[index]
        if primitive.fingers is None:
            return True
        contact = self._scenes[index].check_fingers(trajectory.path.end, primitive.fingers.path.end)
        if contact is not None:
            self._failures.note(index, f"{contact} as the fingers move in {primitive.name}")
        return contact is None

    def _ends(self, i: int, previous: int, chosen: int) -> tuple[Array, Array]:
        return self._ways[i - 1].q_end[previous], self._ways[i].q_start[chosen]

    def _move_durations(self, index: int, q0: Array, q1: Array) -> Array:
        """Durations [s] of direct joint moves from q0 to q1, or by home, shapes (..., n) that broadcast."""
        limits = self._move_limits(index)
        if not self._primitives[index].via_home:
            return joint_move_duration(q0, q1, limits)
        home = self._model.home
        return joint_move_duration(q0, home, limits) + joint_move_duration(home, q1, limits)

    def _direct_move(self, i: int, previous: int, chosen: int) -> Trajectory:
        """The direct joint move to a way through section i from one through the section before, or the one by home."""
        index, (q0, q1) = self._sections[i].first - 1, self._ends(i, previous, chosen)
        limits = self._move_limits(index)
        if not self._primitives[index].via_home:
            return joint_move(q0, q1, limits)
        return joint_move(q0, self._model.home, limits).followed_by(joint_move(self._model.home, q1, limits))

    def _move_limits(self, index: int) -> MotionLimits:
        return replace(self._limits, velocity=self._primitives[index].speed * self._limits.velocity)
