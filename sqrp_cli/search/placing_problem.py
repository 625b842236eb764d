"""The choice of cameras and ways as a problem that an integer program solves: what may be chosen, and what it leads to.

Time between two neighbouring samples of a way is an *interval*. A camera counts in it if it sees at either end what has
to be seen there, so that no quality, and no delay, is better than the problem says: unless a camera sees something
between two samples only. What all options see alike is one *row*: which of them see it, and how many must.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.records import dataclass
from sqrp_cli.search.goal import Goal, Objective
from sqrp_cli.search.placing_result import FewestPossible
from sqrp_cli.search.sites import JudgedWay
from sqrp_cli.study.fault_sights import is_lost_by_fingers, watched_faults

NEVER = -1  # the number of a row that no choice covers


@dataclass(frozen=True, eq=False, kw_only=True)
class Requirements:
    """What is wanted of the cameras."""

    goal: Goal | None = None  # what every candidate has to reach; then as few cameras as possible
    most: int | None = None  # most cameras on mounts; None: no limit
    floor: FewestPossible | None = None  # fewest cameras; `most` is not below it. None: any number will do
    objective: Objective = "least"  # whether the least quality counts first, or the mean
    failure_tolerance: int = 0  # so many cameras may fail: only what is seen then still counts as seen
    budget: float | None = None  # most that the cameras may cost; None: no limit

    def at_least(self, kept: int) -> int:
        """The fewest cameras on mounts with which anything is seen, and not fewer than are required.

        kept: cameras that stay.
        """
        floor = 0 if self.floor is None else self.floor.cameras
        return max(floor, 1 + self.failure_tolerance - kept, 0)

    def value(self, qualities: Iterable[tuple[float | None, float | None]], weights: Array) -> float:
        """The quality that counts first, by Q_eoi and Q_avg of each candidate; those that are undefined do not count.

        weights: how much each candidate counts in the mean, shape (candidates,).
        """
        known = [[q for q in pair if q is not None] for pair in qualities]
        if self.objective == "least":
            return min((q for of_one in known for q in of_one), default=1.0)
        each = np.array([float(np.mean(of_one)) if of_one else 1.0 for of_one in known])
        total = float(weights.sum())
        return float(weights @ each) / total if total > 0 else 1.0


class FaultIntervals(NamedTuple):
    """The intervals of a way in which images may show a fault that happens in one interval of its formula."""

    first: Array  # the times at which a fault has longest to wait: where its interval or one of these begins, (f,) [s]
    begin: Array  # of the intervals that may show it, in order, shape (i,) [s]
    end: Array  # shape (i,) [s]
    rows: tuple[tuple[tuple[int, ...] | None, ...], ...]
    """For each response, fastest first: of each interval the rows that cameras so fast must cover; None if they cannot.
    Empty where nothing is known of what shows it."""

    def least(self, response: Array) -> Array:
        """The least delay of a fault at each of `first` if intervals show it so fast, shape (i,) [s]; shape (f, i).

        response: infinite where an interval does not show it.
        """
        later = np.maximum(self.begin - self.first[:, None], 0.0)
        return np.where(self.end >= self.first[:, None] - 1e-12, later + response, np.inf)


class CoveredWay(NamedTuple):
    """A way as the integer program sees it; times are pairs, of events of interest and of all that is monitored [s]."""

    times: tuple[float, float]  # T_eoi and T, of which Q_eoi and Q_avg are shares
    groups: Mapping[tuple[int, ...], tuple[float, float]]  # by rows: the times that count as covered if all these are
    faults: tuple[FaultIntervals, ...]


Hiding = tuple[int, tuple[int, ...], int]
"""A site where a camera stands in the sight of others, the options at one other site from which it hides something that
they see, and the way in whose motion it does."""

Late = tuple[tuple[int, ...], int]
"""Options with which a fault of a way is noticed later than the goal says, by the exact figures, and the way."""


@dataclass(frozen=True)
class Selection:
    """Cameras, and a way for each candidate, by index."""

    options: tuple[int, ...]  # those on mounts; cameras that stay are not named
    ways: tuple[int, ...]


@dataclass(eq=False)
class Rows:
    """The different rows; equal ones have one number."""

    numbers: dict[tuple[int, bytes], int] = field(default_factory=dict)
    sees: list[Mask] = field(default_factory=list)  # which options see each, shape (options,) each
    needed: list[int] = field(default_factory=list)  # how many of them must
    _bits: list[int] = field(default_factory=list)  # the same as `sees`, as whole numbers, as far as that was needed

    def number(self, sees: Mask, needed: int) -> int:
        """The number of a row; `NEVER` if there are too few options."""
        if int(sees.sum()) < needed:
            return NEVER
        key = needed, np.packbits(sees).tobytes()
        if key not in self.numbers:
            self.numbers[key] = len(self.sees)
            self.sees.append(sees)
            self.needed.append(needed)
        return self.numbers[key]

    def hardest(self, rows: Iterable[int]) -> tuple[int, ...]:
        """Rows without those that are covered whenever another one of them is; only `NEVER` if that is among them."""
        some = sorted(set(rows))
        if NEVER in some:
            return (NEVER,)
        kept: list[int] = []
        self._bits += [int.from_bytes(np.packbits(sees).tobytes()) for sees in self.sees[len(self._bits) :]]
        for row in sorted(some, key=lambda one: (self._bits[one].bit_count(), -self.needed[one], one)):
            others, needed = ~self._bits[row], self.needed[row]
            if not any(needed <= self.needed[one] and not self._bits[one] & others for one in kept):
                kept.append(row)
        return tuple(sorted(kept))


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """What may be chosen, and what that leads to. Options and ways are named by index."""

    ways: tuple[CoveredWay, ...]
    rows: Rows
    tiers: tuple[float, ...]
    """The different responses of options, a frame period and the latency each, fastest first [s]."""
    candidates: tuple[tuple[int, ...], ...]  # the ways of each candidate, one of which is taken
    weights: Array  # how much each candidate counts in the mean, shape (candidates,)
    site_of: Indices  # where each option is; there is room for one, shape (options,)
    price: Array  # shape (options,)
    alone: Array  # the mean quality that each option alone may have, in 0..1, shape (options,)
    kept: frozenset[int] = frozenset()  # options that are there already: always chosen, and not counted
    apart: frozenset[tuple[int, int]] = frozenset()  # pairs of sites that cannot both have a camera
    blocked: frozenset[tuple[int, int]] = frozenset()
    """Sites with the ways in which the robot would touch a camera there."""
    least_delays: Array
    """How long the longest delay of a fault of each way is at least with each option, shape (ways, options) [s]."""
    hiding: frozenset[Hiding] = frozenset()
    """Choices in which one camera hides something from another one; none of them counts."""
    late: frozenset[Late] = frozenset()  # choices that are known to miss the delay of the goal
    beside: Mapping[int, str] = field(default_factory=dict)
    """Sites where a camera would touch one that stays, with its name."""

    @property
    def free(self) -> list[int]:
        """The options on mounts."""
        return [option for option in range(len(self.site_of)) if option not in self.kept]

    @property
    def shut(self) -> frozenset[int]:
        """The sites where a camera is in the way of a candidate in all of its ways."""
        of_way = [{site for site, way in self.blocked if way == number} for number in range(len(self.ways))]
        return frozenset(
            site for of_one in self.candidates for site in set.intersection(*(of_way[number] for number in of_one))
        )

    def figures(self, selection: Selection) -> list[tuple[float | None, float | None, float]]:
        """Q_eoi and Q_avg at most, and the longest delay of a fault at least [s], of each way of a selection.

        The delay is 0 without faults.
        """
        together, found = [*selection.options, *sorted(self.kept)], list[tuple[float | None, float | None, float]]()
        seen = np.array(self.rows.sees, dtype=bool).reshape(-1, len(self.site_of))[:, together].sum(axis=1)
        covered: Mask = seen >= np.array(self.rows.needed)
        for way in (self.ways[number] for number in selection.ways):
            known = [times for rows, times in way.groups.items() if all(covered[row] for row in rows)]
            q_eoi, q_avg = (
                min(1.0, sum(times[which] for times in known) / total) if total > 0 else None
                for which, total in enumerate(way.times)
            )
            longest = 0.0
            for fault in way.faults:
                response = np.full(len(fault.begin), np.inf)
                for tier, of_tier in zip(reversed(self.tiers), reversed(fault.rows), strict=True):
                    response[[rows is not None and bool(covered[list(rows)].all()) for rows in of_tier]] = tier
                longest = max(longest, float(fault.least(response).min(axis=1, initial=np.inf).max(initial=0.0)))
            found.append((q_eoi, q_avg, longest))
        return found

    def worth(self, requirements: Requirements, selection: Selection) -> tuple[float, float]:
        """The quality that counts first at most, and the longest delay at least [s], of a selection."""
        found = self.figures(selection)
        value = requirements.value(((q_eoi, q_avg) for q_eoi, q_avg, _ in found), self.weights)
        return value, max((delay for *_, delay in found), default=0.0)


def covered_way(
    way: JudgedWay, sees: Mask, responses: Array, tiers: Sequence[float], spare: int, rows: Rows
) -> CoveredWay:
    """A way by its intervals; new rows are added to `rows`.

    sees: which options see which items, shape (options, items). responses: of the options, shape (options,), and each
    once, fastest first [s]. spare: so many cameras may fail, and all that counts as seen is seen still.
    """
    planned, samples, targets = way.planned, way.samples, way.planned.targets
    item = np.full((len(samples), len(targets)), NEVER)
    item[way.items] = np.arange(len(way.needed))
    piece, t = samples.piece.tolist(), samples.t.tolist()
    single = np.flatnonzero(np.bincount(samples.piece)[samples.piece] == 1).tolist()
    spans = [(n, n + 1) for n in np.flatnonzero(np.diff(samples.piece) == 0).tolist()]
    spans = sorted([*spans, *((n, n) for n in single)])

    def row(span: tuple[int, int], column: int, tier: float) -> int:
        first, last = item[span[0], column], item[span[1], column]
        return rows.number((sees[:, first] | sees[:, last]) & (responses <= tier), targets[column].cameras + spare)

    groups: dict[tuple[int, ...], tuple[float, float]] = {}
    for first, last in spans:
        columns = np.flatnonzero(item[first] != NEVER).tolist()
        if columns and t[last] > t[first]:
            key = rows.hardest(row((first, last), column, np.inf) for column in columns)
            step, (of_interest, seconds) = t[last] - t[first], groups.get(key, (0.0, 0.0))
            groups[key] = of_interest + step * planned.stage.pieces[piece[first]].of_interest, seconds + step
    begin, (asked, watched), faults = np.array([t[first] for first, _ in spans]), watched_faults(planned), []
    for fault in watched:
        alone = [asked[columns[0]] for columns in fault.columns if len(columns) == 1]
        known = [targets.index(one) for one in alone if one in targets and not is_lost_by_fingers(planned.stage, fault)]
        for interval in fault.intervals:
            late = [span for span in spans if t[span[1]] >= interval.start - 1e-12]
            shown = [span for span in late if fault.counts_in(planned.stage.pieces[piece[span[0]]])]
            needed = [
                [
                    rows.hardest(row(span, column, tier) for column in known if item[span[0], column] != NEVER)
                    for span in shown
                ]
                for tier in tiers
            ]
            inside = (begin > interval.start) & (begin < interval.end)
            faults.append(
                FaultIntervals(
                    first=np.unique(np.append(begin[inside], interval.start)),
                    begin=np.array([t[first] for first, _ in shown]),
                    end=np.array([t[last] for _, last in shown]),
                    rows=tuple(tuple(None if NEVER in one else one for one in of_tier) for of_tier in needed),
                )
            )
    seen = {key: times for key, times in groups.items() if NEVER not in key}
    return CoveredWay((planned.T_eoi, planned.T), seen, tuple(faults))


def obstacle(problem: Problem, requirements: Requirements, *, blind: bool) -> str:
    """Why not even the fewest cameras that are needed can be chosen, in one sentence.

    blind: whether some can, but see nothing that counts.
    """
    if blind:
        fails = ", if one of them fails" if requirements.failure_tolerance else ""
        return f"none of them would see anything that matters{fails}"
    free = np.array(problem.free, dtype=np.int64)
    places = len(np.unique(problem.site_of[free]))
    if not len(free):
        return "at none of the mounts is there a direction for a camera to look in"
    usable: Indices = free[~np.isin(problem.site_of[free], sorted(problem.shut))]
    if not len(usable):
        mounts = "the only mount is" if places == 1 else f"all {places} mounts are"
        stays = set(problem.beside.values()) if problem.shut <= set(problem.beside) else set()
        touched = f"`{stays.pop()}`, which stays" if len(stays) == 1 else "something"
        return f"{mounts} in the way: a camera there would touch {touched}"
    needed = max(requirements.at_least(len(problem.kept)), 1)
    sites = problem.site_of[usable]
    prices = np.sort([problem.price[usable][sites == site].min() for site in np.unique(sites)])
    for count, total in enumerate(np.cumsum(prices[:needed]).tolist(), 1):
        if requirements.budget is not None and total > requirements.budget + 1e-9:
            cheapest = "the cheapest camera costs" if count == 1 else f"the cheapest {count} cameras cost"
            return f"{cheapest} {total:g}, the budget is {requirements.budget:g}"
    reason = "" if requirements.floor is None else f", and {requirements.floor.reason}"
    if len(prices) < needed:
        return f"of {places} mounts only {len(prices)} can be used{reason}"
    return f"no {needed} of the mounts can be used together: cameras there touch or hide each other{reason}"
