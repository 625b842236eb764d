"""The joint moves between sections: the fastest sequence of branches, and the moves of which it is made."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, reduce
from itertools import pairwise
from typing import Literal

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import Contact
from sqrp_cli.motion.sections import Branch, MotionProblem, Section, Ways
from sqrp_cli.motion.timing import MotionLimits, joint_move, joint_move_duration
from sqrp_cli.motion.way_around import find_way, motion_through
from sqrp_cli.records import dataclass
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.trajectory import Trajectory

TIE_DECIMALS = 6  # total times equal to this many decimals of a second are ties; joint values are rounded alike
TRIES_PER_WAY = 250  # most straight pieces that the search for one way around may check
MOST_TRIES = 1500  # most straight pieces that all searches for one motion may check together


@dataclass(frozen=True, order=True)
class _Sequence:
    """A sequence of branches so far: a bound of the total time, its joint values, and the time spent until its end."""

    bound: float
    key: tuple[float, ...]
    chosen: tuple[int, ...]
    around: bool
    """Whether the last move is to be a way around."""
    spent: float


def fastest_sequence(
    starts: Sequence[Array],
    durations: Sequence[Array],
    move_durations: Sequence[Array],
    works: Callable[[int, int, int], bool],
    way_works: Callable[[int, int, int], bool] | None = None,
) -> tuple[int, ...] | None:
    """The branch of each section with which the whole takes the shortest time, ties by lexicographic joint values.

    starts, durations: where each of the k branches of a section begins, shape (k, n), and how long it takes, (k,) [s].
    move_durations: of the moves from each branch of a section to each of the next one, shape (k_i, k_i+1) [s] each.
    works(i, previous, branch): whether a branch of section i and the move to it from one of the section before (-1 for
    none) are feasible. It is called only for the most promising sequences, once for each argument. None when no
    sequence works. way_works: likewise, whether there is a way around where `works` is false; in the search it counts
    twice the time of the move that it replaces.

    A* search: the remaining time, infeasibility ignored, is exact by dynamic programming, so sequences are completed in
    the order of their total times.
    """
    to_go = list(durations)
    for i in reversed(range(len(durations) - 1)):
        to_go[i] = to_go[i] + (move_durations[i] + to_go[i + 1]).min(axis=1, initial=np.inf)
    keys = [np.round(q, TIE_DECIMALS) for q in starts]
    known: dict[tuple[int, int, int, bool], bool] = {}
    heap: list[tuple[_Sequence, Iterator[_Sequence]]] = []

    def longer(chosen: tuple[int, ...], key: tuple[float, ...], begun: Array) -> Iterator[_Sequence]:
        """One section further, the most promising first; begun: when each of its branches would begin [s]."""
        i = len(chosen)
        bounds, spent = np.round(begun + to_go[i], TIE_DECIMALS), begun + durations[i]
        for k in np.lexsort((*keys[i].T[::-1], bounds)).tolist():
            if np.isinf(bounds[k]):
                return
            joints = (*key, *keys[i][k].tolist())
            yield _Sequence(float(bounds[k]), joints, (*chosen, k), around=False, spent=float(spent[k]))

    def push_next(siblings: Iterator[_Sequence]) -> None:
        if (sequence := next(siblings, None)) is not None:
            heapq.heappush(heap, (sequence, siblings))

    push_next(longer((), (), np.zeros(len(to_go[0]))))
    while heap:
        sequence, siblings = heapq.heappop(heap)
        push_next(siblings)
        i, k = len(sequence.chosen) - 1, sequence.chosen[-1]
        previous = sequence.chosen[-2] if i else -1
        asked = (i, previous, k, sequence.around)
        if asked not in known:
            known[asked] = (way_works if sequence.around and way_works else works)(i, previous, k)
        if known[asked]:
            if i + 1 == len(durations):
                return sequence.chosen
            push_next(longer(sequence.chosen, sequence.key, sequence.spent + move_durations[i][k]))
        elif way_works is not None and i and not sequence.around:
            again = float(move_durations[i - 1][previous, k])
            bound = round(sequence.bound + again, TIE_DECIMALS)
            push_next(iter([replace(sequence, bound=bound, spent=sequence.spent + again, around=True)]))
    return None


@dataclass(frozen=True, eq=False)
class FoundMove:
    """A move between two branches, with the obstacle that it goes around, if any."""

    trajectory: Trajectory
    around: str | None = None


_How = Literal["direct", "through", "around"]


class JointMoves:
    """Makes and checks moves, and the primitives tied to their ends, on demand; notes what touches, and when.

    Moves are named by the index i of the section that they lead to, of a way through the section before, and of the way
    that is chosen.
    """

    def __init__(self, problem: MotionProblem, sections: Sequence[Section], ways: Sequence[Ways]) -> None:
        """ways: those through each section."""
        self._problem, self._sections, self._ways = problem, sections, ways
        self._tied_is_free, self._move = cache(self._check_tied), cache(self._find)
        self.tries = 0
        """Straight pieces that searches for ways around have checked."""
        self.durations: list[Array] = []
        """Of the direct moves from each way through a section to each of the next, shape (k_i, k_i+1) each [s]."""
        for before, after, section in zip(ways[:-1], ways[1:], sections[1:], strict=True):
            primitive, home = problem.primitives[section.first - 1], problem.model.home
            q0, q1, limits = before.q_end[:, None], after.q_start[None], MotionLimits.of(problem.model, primitive.speed)
            stops = pairwise((q0, home, q1) if primitive.via_home else (q0, q1))
            self.durations.append(np.asarray(sum(joint_move_duration(one, two, limits) for one, two in stops)))

    def direct_works(self, i: int, previous: int, chosen: int) -> bool:
        """Whether a way through section i and the direct move to it are free."""
        if not self._tied_is_free(i, self._ways[i].branch(chosen)):
            return False
        return self._sections[i].move is None or isinstance(self._move(i, previous, chosen, "direct"), FoundMove)

    def way_works(self, i: int, previous: int, chosen: int) -> bool:
        """Whether there is a way around the obstacle of that move, first by its vias; none for moves by home."""
        if not self._tied_is_free(i, self._ways[i].branch(chosen)):
            return False
        has_vias = self._problem.primitives[self._sections[i].first - 1].vias is not None
        hows: tuple[_How, ...] = ("through", "around") if has_vias else ("around",)
        return any(isinstance(self._move(i, previous, chosen, how), FoundMove) for how in hows)

    def along(self, chosen: Sequence[int]) -> list[FoundMove] | Infeasible:
        """The moves of a sequence of ways through the sections that works; infeasible if one is blocked by its vias."""
        moves: list[FoundMove] = []
        for i in range(1, len(chosen)):
            has_vias = self._problem.primitives[self._sections[i].first - 1].vias is not None
            move = self._move(i, chosen[i - 1], chosen[i], "through" if has_vias else "direct")
            if isinstance(move, Infeasible):
                return move
            if isinstance(move, Contact):
                move = self._move(i, chosen[i - 1], chosen[i], "around")
            moves += [move] if isinstance(move, FoundMove) else []
        return moves

    def _find(self, i: int, previous: int, chosen: int, how: _How) -> FoundMove | Contact | Infeasible | None:
        """The direct move, or the one by home, unless something is in its way; the one through its vias; one around."""
        problem, index = self._problem, self._sections[i].first - 1
        primitive, scene = problem.primitives[index], problem.scenes[index]
        q0, q1 = self._ways[i - 1].q_end[previous], self._ways[i].q_start[chosen]
        limits = MotionLimits.of(problem.model, primitive.speed)
        if how == "direct":
            stops = pairwise((q0, problem.model.home, q1) if primitive.via_home else (q0, q1))
            trajectory = reduce(Trajectory.followed_by, (joint_move(one, two, limits) for one, two in stops))
            return self._contact(index, trajectory) or FoundMove(trajectory)
        direct = self._move(i, previous, chosen, "direct")
        obstacle = direct.second if isinstance(direct, Contact) else None
        if how == "through":
            vias = np.zeros((0, len(q0))) if primitive.vias is None else primitive.vias
            trajectory = motion_through(q0, vias, q1, limits)
            if (contact := scene.check_path(trajectory.path)) is not None:
                return Infeasible((f"{self._at(index, trajectory, contact)} with its vias",))
            return FoundMove(trajectory, obstacle)
        tries = min(TRIES_PER_WAY, MOST_TRIES - self.tries)
        if tries == 0 or primitive.via_home or obstacle is None:
            return None
        found, checked = find_way(scene, q0, q1, problem.bounds, limits, tries, problem.seed)
        self.tries += checked
        return None if found is None else FoundMove(found, obstacle)

    def _check_tied(self, i: int, branch: Branch) -> bool:
        """Whether all primitives tied to the start of a branch of section i are free, and fingers that move in them."""
        primitives = self._problem.primitives
        for k, trajectory in enumerate(branch.trajectories, self._sections[i].first):
            before, now = primitives[max(k - 1, 0)], primitives[k]
            # Where the arm still stands at the end of the primitive before, that was checked: with the same contacts.
            stands = now.kind is not JointMove and not now.curves and k > 0
            known = stands and now.world is before.world and before.allowed <= now.allowed
            if not known and self._contact(k, trajectory) is not None:
                return False
            if now.fingers is not None:
                contact = self._problem.scenes[k].check_fingers(trajectory.path.end, now.fingers.path.end)
                if contact is not None:
                    self._problem.note(k, f"{contact} as the fingers move in {now.name}")
                    return False
        return True

    def _contact(self, index: int, trajectory: Trajectory) -> Contact | None:
        """The first contact during a primitive; notes it."""
        contact = self._problem.scenes[index].check_path(trajectory.path)
        if contact is not None:
            self._problem.note(index, self._at(index, trajectory, contact))
        return contact

    def _at(self, index: int, trajectory: Trajectory, contact: Contact) -> str:
        """What touches, and when."""
        share = trajectory.law.time_at(contact.s) / trajectory.duration if trajectory.duration > 0 else 0.0
        return f"{contact} at {100 * share:.0f} % of {self._problem.primitives[index].name}"
