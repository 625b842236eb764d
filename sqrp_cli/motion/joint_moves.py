"""The joint moves between sections: the fastest sequence of branches, and the moves of which it is made."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from itertools import pairwise
from typing import Literal

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import Contact
from sqrp_cli.motion.sections import MotionProblem, Ways
from sqrp_cli.motion.timing import MotionLimits, joint_move, joint_move_duration
from sqrp_cli.motion.way_around import find_way, motion_through
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.trajectory import Trajectory

TIE_DECIMALS = 6  # total times equal to this many decimals of a second are ties; joint values are rounded alike
TRIES_PER_WAY = 250  # most straight pieces that the search for one way around may check
MOST_TRIES = 1500  # most straight pieces that all searches for one motion may check together


def fastest_sequence(
    starts: Sequence[Array],
    durations: Sequence[Array],
    move_durations: Sequence[Array],
    works: Callable[[int, int, int, bool], bool],
    *,
    takes: Callable[[int, int], float] | None = None,
    around: bool = False,
) -> tuple[int, ...] | None:
    """The branch of each section with which the whole takes the shortest time, ties by lexicographic joint values.

    starts, durations: where each of the k branches of a section begins, shape (k, n), and how long it takes, (k,) [s].
    takes(i, branch): how long one really takes [s], where `durations` say how long at least; asked of the most
    promising ones.
    move_durations: of the moves from each branch of a section to each of the next one, shape (k_i, k_i+1) [s] each.
    works(i, previous, branch, False): whether a branch of section i and the move to it from one of the section before
    (-1 for none) are feasible. It is called only for the most promising sequences, once for each argument. None when no
    sequence works. around: ask where that is false with True, whether there is a way around, which counts twice the
    time of the move that it replaces in the search.

    A* search: the remaining time, infeasibility ignored, is exact by dynamic programming, so sequences are completed in
    the order of their total times.
    """
    to_go = list(durations)
    for i in reversed(range(len(durations) - 1)):
        to_go[i] = to_go[i] + (move_durations[i] + to_go[i + 1]).min(axis=1, initial=np.inf)
    keys = [np.round(q, TIE_DECIMALS) for q in starts]
    known: dict[tuple[int, int, int, bool], bool] = {}
    # Sequences so far: a bound of the total time, joint values, the branches, whether the last move is to be a way
    # around, and the time spent until the end; then those of which it is the first, which follow once it is taken.
    heap: list[tuple[float, tuple[float, ...], tuple[int, ...], bool, float, _Siblings | None]] = []

    def push(chosen: tuple[int, ...], key: tuple[float, ...], begun: Array, order: Iterator[int] | None) -> None:
        """The next of the branches one section further; begun: when each would begin [s]; order: from the best on."""
        i = len(chosen)
        bounds = np.round(begun + to_go[i], TIE_DECIMALS)
        order = iter(np.lexsort((*keys[i].T[::-1], bounds)).tolist()) if order is None else order
        if (k := next(order, None)) is not None and not np.isinf(bounds[k]):
            joints, spent = (*key, *keys[i][k].tolist()), float(begun[k] + durations[i][k])
            heapq.heappush(heap, (float(bounds[k]), joints, (*chosen, k), False, spent, (chosen, key, begun, order)))

    push((), (), np.zeros(len(to_go[0])), None)
    while heap:
        bound, key, chosen, is_around, spent, siblings = heapq.heappop(heap)
        i, k = len(chosen) - 1, chosen[-1]
        if siblings is not None:
            push(*siblings)
            least = float(durations[i][k])
            if takes is not None and (longer := takes(i, k) - least):
                total = round(spent + longer + float(to_go[i][k]) - least, TIE_DECIMALS)
                heapq.heappush(heap, (total, key, chosen, False, spent + longer, None))
                continue
        asked = (i, chosen[-2] if i else -1, k, is_around)
        if asked not in known:
            known[asked] = works(*asked)
        if known[asked]:
            if i + 1 == len(durations):
                return chosen
            push(chosen, key, spent + move_durations[i][k], None)
        elif around and i and not is_around:
            again = float(move_durations[i - 1][chosen[-2], k])
            heapq.heappush(heap, (round(bound + again, TIE_DECIMALS), key, chosen, True, spent + again, None))
    return None


_Siblings = tuple[tuple[int, ...], tuple[float, ...], Array, Iterator[int]]
"""What gives the sequences that differ in the last branch: as `push` takes it."""
FoundMove = tuple[Trajectory, str | None]  # A move between two branches, and the obstacle that it goes around, if any
_How = Literal["direct", "through", "around"]


class JointMoves:
    """Makes and checks moves, and the primitives tied to their ends, on demand; notes what touches, and when.

    Moves are named by the index i of the section that they lead to, of a way through the section before, and of the way
    that is chosen.
    """

    def __init__(self, problem: MotionProblem, ways: Sequence[Ways], *, each: bool = False) -> None:
        """ways: those through each section. each: whether all will be asked for, not only the most promising."""
        self._each, self._timed = each, [dict[int, tuple[Trajectory, ...]]() for _ in ways]
        self._problem, self._sections, self._ways = problem, problem.sections, ways
        # What was found; a cache of bound methods would hold the motion until garbage is collected.
        self._free = dict[tuple[int, int], bool]()
        self._moves = dict[tuple[int, int, int, _How], FoundMove | Contact | Infeasible | None]()
        self.tries = 0
        """Straight pieces that searches for ways around have checked."""
        self.durations: list[Array] = []
        """Of the direct moves from each way through a section to each of the next, shape (k_i, k_i+1) each [s]."""
        for before, after, section in zip(ways[:-1], ways[1:], problem.sections[1:], strict=True):
            primitive, home = problem.primitives[section.first - 1], problem.model.home
            q0, q1, limits = before.q_end[:, None], after.q_start[None], MotionLimits.of(problem.model, primitive.speed)
            stops = pairwise((q0, home, q1) if primitive.via_home else (q0, q1))
            self.durations.append(np.asarray(sum(joint_move_duration(one, two, limits) for one, two in stops)))

    def tied(self, i: int, branch: int) -> tuple[Trajectory, ...]:
        """The primitives tied to the start of a branch of section i, without turns; timed when first asked for."""
        begun, timed = self._ways[i].begun, self._timed[i]
        if branch not in timed:
            some = range(len(begun)) if self._each else [branch]
            found = self._problem.trajectories(self._sections[i], [begun[one] for one in some])
            timed |= zip(some, found, strict=True)
        return timed[branch]

    def takes(self, i: int, way: int) -> float:
        """How long the primitives tied to the start of a way through section i take [s]."""
        return sum(move.duration for move in self.tied(i, int(self._ways[i].of[way])))

    def works(self, i: int, previous: int, chosen: int, around: bool) -> bool:
        """Whether a way through section i and the direct move to it are free.

        around: whether there is a way around the obstacle of that move, first by its vias; none for moves by home.
        """
        section = self._sections[i]
        if (tied := (i, int(self._ways[i].of[chosen]))) not in self._free:
            self._free[tied] = self._check_tied(*tied)
        if not self._free[tied]:
            return False
        has_vias = around and self._problem.primitives[section.first - 1].vias is not None
        hows: tuple[_How, ...] = ("through", "around") if has_vias else ("around",) if around else ("direct",)
        found = (self._move(i, previous, chosen, how) for how in hows)
        return (section.move is None and not around) or any(isinstance(move, tuple) for move in found)

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
            moves += [move] if isinstance(move, tuple) else []
        return moves

    def _move(self, i: int, previous: int, chosen: int, how: _How) -> FoundMove | Contact | Infeasible | None:
        """A move to a way through section i, searched for when first asked for."""
        if (asked := (i, previous, chosen, how)) not in self._moves:
            self._moves[asked] = self._find(*asked)
        return self._moves[asked]

    def _find(self, i: int, previous: int, chosen: int, how: _How) -> FoundMove | Contact | Infeasible | None:
        """The direct move, or the one by home, unless something is in its way; the one through its vias; one around."""
        problem, index = self._problem, self._sections[i].first - 1
        primitive, scene = problem.primitives[index], problem.scenes[index]
        q0, q1 = self._ways[i - 1].q_end[previous], self._ways[i].q_start[chosen]
        limits = MotionLimits.of(problem.model, primitive.speed)
        if how == "direct":
            stops = pairwise((q0, problem.model.home, q1) if primitive.via_home else (q0, q1))
            trajectory = reduce(Trajectory.followed_by, (joint_move(one, two, limits) for one, two in stops))
            contact, said = self._contact(index, trajectory)
            if contact is not None:
                problem.failures.append((index, said))
            return contact or (trajectory, None)
        direct = self._move(i, previous, chosen, "direct")
        obstacle = direct.second if isinstance(direct, Contact) else None
        if how == "through":
            vias = np.zeros((0, len(q0))) if primitive.vias is None else primitive.vias
            trajectory = motion_through(q0, vias, q1, limits)
            contact, said = self._contact(index, trajectory)
            return (trajectory, obstacle) if contact is None else Infeasible((f"{said} with its vias",))
        tries = min(TRIES_PER_WAY, MOST_TRIES - self.tries)
        if tries == 0 or primitive.via_home or obstacle is None:
            return None
        found, checked = find_way(scene, q0, q1, problem.bounds, limits, tries, problem.seed)
        self.tries += checked
        return None if found is None else (found, obstacle)

    def _check_tied(self, i: int, branch: int) -> bool:
        """Whether all primitives tied to the start of a branch of section i are free, and fingers that move in them."""
        primitives = self._problem.primitives
        for k, trajectory in enumerate(self.tied(i, branch), self._sections[i].first):
            before, now = primitives[max(k - 1, 0)], primitives[k]
            # Where the arm still stands at the end of the primitive before, that was checked: with the same contacts.
            stands = now.kind is not JointMove and not now.curves and k > 0
            known = stands and now.world is before.world and before.allowed <= now.allowed
            contact, said = (None, "") if known else self._contact(k, trajectory)
            if contact is not None:
                self._problem.failures.append((k, said))
                return False
            if now.fingers is not None:
                contact = self._problem.scenes[k].check_fingers(trajectory.path.end, now.fingers.path.end)
                if contact is not None:
                    self._problem.failures.append((k, f"{contact} as the fingers move in {now.name}"))
                    return False
        return True

    def _contact(self, index: int, trajectory: Trajectory) -> tuple[Contact | None, str]:
        """The first contact during a primitive, and what touches, and when."""
        contact = self._problem.scenes[index].check_path(trajectory.path)
        if contact is None:
            return None, ""
        share = trajectory.law.time_at(contact.s) / trajectory.duration if trajectory.duration > 0 else 0.0
        return contact, f"{contact} at {100 * share:.0f} % of {self._problem.primitives[index].name}"
