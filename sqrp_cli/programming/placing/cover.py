"""What has to be covered, for an integer program: items that the same cameras see are one row, and so on.

A *row* says which options see something, and how many must. A *group* is time in which a state is covered if all of its
rows are. The quality of a way is that of the definition at its samples: time between two neighbouring samples counts if
both are covered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.pieces import fault_intervals
from sqrp_cli.programming.placing.scenes import JudgedWay

NEVER = -1
"""The number of a row that no choice covers."""


@dataclass(frozen=True, eq=False)
class Group:
    """Time of a way in which the same rows must be covered."""

    rows: tuple[int, ...]
    seconds: float
    """All of it that formulas monitor [s]."""
    of_interest: float
    """What of it lies in events of interest [s]."""


@dataclass(frozen=True, eq=False)
class FaultSamples:
    """The samples at which a fault may happen, in one interval, with the rows that must be covered to see it."""

    start: float
    """When it may first happen [s]."""
    end: float
    """When it may last happen [s]."""
    t: Array
    """From the start to the end of the motion, shape (s,) [s]."""
    rows: tuple[tuple[tuple[int, ...] | None, ...], ...]
    """For each response, fastest first: of each sample the rows of cameras that respond so fast; None where the state
    does not hold the fault's literals."""
    linked: Mask
    """Whether a sample and the next one lie in one piece, shape (s - 1,)."""


@dataclass(frozen=True, eq=False)
class CoveredWay:
    """A way as an integer program sees it."""

    way: JudgedWay
    number: int
    """Its index among all."""
    groups: tuple[Group, ...]
    faults: tuple[FaultSamples, ...]

    @property
    def T(self) -> float:
        """Duration of the union of all formulas' intervals [s]."""
        return self.way.scene.T

    @property
    def T_eoi(self) -> float:
        """Duration of the union of the events of interest [s]."""
        return self.way.scene.T_eoi

    @property
    def total(self) -> float:
        """Duration of the whole motion [s]."""
        return self.way.scene.motion.time


@dataclass(eq=False)
class RowTable:
    """The different rows; equal ones have one number."""

    numbers: dict[tuple[int, bytes], int] = field(default_factory=dict)
    sees: list[Mask] = field(default_factory=list)
    """Which options see it, shape (options,) each."""
    needed: list[int] = field(default_factory=list)
    """How many of them must."""

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

    @cached_property
    def matrix(self) -> Mask:
        """All rows, shape (rows, options)."""
        return np.array(self.sees, dtype=bool)

    def implied(self) -> Mask:
        """Whether a row (first axis) is covered whenever another one (second axis) is, shape (rows, rows).

        Of equal rows only the first one implies the others.
        """
        if not self.sees:
            return np.zeros((0, 0), dtype=bool)
        sees, needed = self.matrix.astype(np.float32), np.array(self.needed)
        implied: Mask = (sees @ (1.0 - sees).T < 0.5).T & (needed[:, None] <= needed[None])
        np.fill_diagonal(implied, val=False)
        return implied

    def covered(self, chosen: Sequence[int]) -> Mask:
        """Which rows a choice of options covers, shape (rows,)."""
        if not self.sees:
            return np.zeros(0, dtype=bool)
        covered: Mask = self.matrix[:, list(chosen)].sum(axis=1) >= np.array(self.needed)
        return covered


@dataclass(frozen=True, eq=False)
class Cover:
    """All ways with their rows."""

    ways: tuple[CoveredWay, ...]
    table: RowTable
    responses: tuple[float, ...]
    """Of the options, each once, fastest first [s]."""

    @classmethod
    def of(cls, ways: Sequence[JudgedWay], sees: Sequence[Mask], responses: Array, spare: int) -> Cover:
        """The rows of some ways.

        sees: for each way, which options see which items, shape (options, items). responses: of the options, (options,)
        [s]. spare: so many cameras may fail, and all that counts as seen is seen still.
        """
        table, tiers = RowTable(), tuple(np.unique(responses).tolist())
        covered = []
        for number, (way, of_way) in enumerate(zip(ways, sees, strict=True)):
            needed = (way.needed + spare).tolist()
            rows = [
                [table.number(of_way[:, i] & (responses <= tier), k) for i, k in enumerate(needed)] for tier in tiers
            ]
            covered.append(
                CoveredWay(way, number, tuple(_groups(way, rows[-1])), tuple(_faults(way, [*map(np.array, rows)])))
            )
        implied = table.implied()
        return cls(tuple(replace(way, groups=_without(way.groups, implied)) for way in covered), table, tiers)

    @property
    def quickest(self) -> float:
        """The shortest response of any option [s]; 0 without options."""
        return min(self.responses, default=0.0)

    def quality(self, way: CoveredWay, covered: Mask) -> tuple[float | None, float | None]:
        """Q_eoi and Q_avg of a way if some rows are covered, shape (rows,)."""
        seen = [group for group in way.groups if all(row != NEVER and covered[row] for row in group.rows)]
        q_avg = min(1.0, sum(group.seconds for group in seen) / way.T) if way.T > 0 else None
        q_eoi = min(1.0, sum(group.of_interest for group in seen) / way.T_eoi) if way.T_eoi > 0 else None
        return q_eoi, q_avg

    def delay(self, way: CoveredWay, covered: Mask) -> float:
        """The longest time until a fault is noticed, at the samples, if some rows are covered [s]; 0 without faults."""
        return float(self.delays(way, covered[:, None])[0])

    def delays(self, way: CoveredWay, covered: Mask) -> Array:
        """The same for several sets of cameras; covered: shape (rows, sets); (sets,)."""
        worst = np.zeros(covered.shape[1])
        for fault in way.faults:
            response = np.full((len(fault.t), covered.shape[1]), np.inf)
            for tier, rows in zip(reversed(self.responses), reversed(fault.rows), strict=True):
                for sample, needed in enumerate(rows):
                    if needed is not None and NEVER not in needed:
                        response[sample, covered[list(needed)].all(axis=0)] = tier
            worst = np.maximum(worst, longest_delays(fault, way.total, response))
        return worst


def longest_delays(fault: FaultSamples, total: float, response: Array) -> Array:
    """The longest delays of a fault for several sets of cameras, shape (sets,) [s].

    response: at each sample, infinite where it is not covered, shape (s, sets) [s].
    """
    seen = np.isfinite(response)
    noticed, later = np.full(seen.shape, total), np.full(seen.shape[1], total)
    for sample in range(len(seen) - 1, -1, -1):  # when a fault just after this sample is noticed
        noticed[sample] = later
        later = np.where(seen[sample], fault.t[sample] + response[sample], later)
    worst = np.maximum(0.0, later - fault.start)
    for sample in np.flatnonzero(fault.t < fault.end).tolist():
        delay = noticed[sample] - fault.t[sample]
        if sample + 1 < len(seen) and fault.linked[sample]:
            both = seen[sample] & seen[sample + 1]
            delay = np.where(both, np.maximum(response[sample], response[sample + 1]), delay)
        worst = np.maximum(worst, delay)
    return worst


def _groups(way: JudgedWay, rows: Sequence[int]) -> list[Group]:
    """Time between neighbouring samples of one piece, by the rows of both."""
    by_sample: list[set[int]] = [set() for _ in range(len(way.samples))]
    for sample, row in zip(way.items.sample.tolist(), rows, strict=True):
        by_sample[sample].add(row)
    pieces = way.scene.stage.pieces
    found: dict[tuple[int, ...], tuple[float, float]] = {}
    piece, t = way.samples.piece, way.samples.t
    for sample in np.flatnonzero(np.diff(piece) == 0).tolist():
        if not (by_sample[sample] and by_sample[sample + 1]):
            continue  # nothing has to be seen there
        key = tuple(sorted(by_sample[sample] | by_sample[sample + 1]))
        step = float(t[sample + 1] - t[sample])
        seconds, of_interest = found.get(key, (0.0, 0.0))
        found[key] = seconds + step, of_interest + step * pieces[piece[sample]].of_interest
    return [Group(key, *times) for key, times in found.items() if times[0] > 0]


def _without(groups: Sequence[Group], implied: Mask) -> tuple[Group, ...]:
    """The groups without rows that others of theirs imply; those that are then equal as one."""
    found: dict[tuple[int, ...], tuple[float, float]] = {}
    for group in groups:
        rows = group.rows
        if NEVER in rows:
            rows = (NEVER,)
        elif len(rows) > 1:
            among: Mask = np.any(implied[np.ix_(rows, rows)], axis=1, keepdims=True)
            rows = tuple(row for row, is_implied in zip(rows, among[:, 0].tolist(), strict=True) if not is_implied)
        seconds, of_interest = found.get(rows, (0.0, 0.0))
        found[rows] = seconds + group.seconds, of_interest + group.of_interest
    return tuple(Group(rows, *times) for rows, times in found.items())


def _faults(way: JudgedWay, rows: Sequence[Indices]) -> Iterator[FaultSamples]:
    """The intervals of every fault; rows: of each item, for each response."""
    sample, target = way.items
    at = {(int(s), int(c)): number for number, (s, c) in enumerate(zip(sample, target, strict=True))}
    piece, t = way.samples.piece, way.samples.t
    for fault, columns in way.scene.faults.items():
        for stretch in fault_intervals(way.scene.formulas, fault):
            after = np.flatnonzero(t >= stretch.start - 1e-12)

            def needed(tier: Indices, row: int, columns: tuple[int, ...] = columns) -> tuple[int, ...] | None:
                items = [at.get((row, column)) for column in columns]
                known = [item for item in items if item is not None]
                return tuple(sorted({int(tier[item]) for item in known})) if len(known) == len(items) else None

            yield FaultSamples(
                start=stretch.start,
                end=stretch.end,
                t=t[after],
                rows=tuple(tuple(needed(tier, int(row)) for row in after) for tier in rows),
                linked=np.diff(piece[after]) == 0,
            )
