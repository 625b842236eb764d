"""The integer program of a choice: its variables, by what they stand for, and expressions of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.placing.cover import NEVER, CoveredWay, FaultSamples
from sqrp_cli.programming.placing.problem import Choice, Placing, worth_of
from sqrp_cli.programming.placing.solver import LinearProgram, Terms

SLACK = 1e-7
"""By how much a later aim may worsen an earlier one: figures of the solver are rounded."""


@dataclass(eq=False)
class ChoiceProgram:
    """The variables of a program, by what they stand for, and expressions of them."""

    program: LinearProgram
    problem: Placing
    free: dict[int, int] = field(default_factory=dict)
    """Of each option that is not kept: whether it is chosen."""
    taken: dict[int, int] = field(default_factory=dict)
    """Of each way of a candidate that has several: whether it is taken."""
    covered: dict[int, int] = field(default_factory=dict)
    """Of each row: whether it is covered."""
    counted: list[tuple[int, CoveredWay, tuple[int, ...]]] = field(default_factory=list)
    """Whether the time of a group counts: its variable, way and rows, where it is not that of its only row."""
    qualities: list[tuple[Terms | None, Terms | None]] = field(default_factory=list)
    """Q_eoi and Q_avg of each candidate; None where undefined."""
    least: Terms = field(default_factory=dict)
    mean: Terms = field(default_factory=dict)

    def __post_init__(self) -> None:
        problem, program = self.problem, self.program
        for option in range(problem.count):
            if option not in problem.kept:
                self.free[option] = program.variable(whole=True)
        for of_one in problem.candidates:
            if len(of_one) > 1:
                self.taken |= {way: program.variable(whole=True) for way in of_one}
                program.row({self.taken[way]: 1.0 for way in of_one}, least=1.0, most=1.0)
        self._rows()
        self._qualities()

    def _rows(self) -> None:
        table, kept = self.problem.cover.table, sorted(self.problem.kept)
        for row, (sees, needed) in enumerate(zip(table.sees, table.needed, strict=True)):
            still = needed - int(sees[kept].sum())
            y = self.covered[row] = self.program.variable(whole=still > 1)
            if still > 0:
                terms = {self.free[option]: -1.0 for option in np.flatnonzero(sees).tolist() if option in self.free}
                self.program.row({y: float(still), **terms}, most=0.0)

    def _qualities(self) -> None:
        for of_one in self.problem.candidates:
            q_eoi: dict[int, float] = {}
            q_avg: dict[int, float] = {}
            ways = [self.problem.cover.ways[number] for number in of_one]
            for way in ways:
                for group in way.groups:
                    if NEVER not in group.rows:
                        v = self._group(way, group.rows)
                        q_eoi[v] = q_eoi.get(v, 0.0) + (group.of_interest / way.T_eoi if way.T_eoi > 0 else 0.0)
                        q_avg[v] = q_avg.get(v, 0.0) + (group.seconds / way.T if way.T > 0 else 0.0)
                if way.number in self.taken and len(ways) > 1:  # what is undefined is as good as seen
                    g = self.taken[way.number]
                    q_eoi |= {g: 1.0} if way.T_eoi <= 0 else {}
                    q_avg |= {g: 1.0} if way.T <= 0 else {}
            self.qualities.append(
                (
                    q_eoi if any(way.T_eoi > 0 for way in ways) else None,
                    q_avg if any(way.T > 0 for way in ways) else None,
                )
            )
        self._objectives()

    def _objectives(self) -> None:
        z = self.program.variable()
        weights, mean = self.problem.weights, dict[int, float]()
        total = max(float(weights.sum()), 1e-12)
        for weight, pair in zip(weights.tolist(), self.qualities, strict=True):
            known = [terms for terms in pair if terms is not None]
            for terms in known:
                self.program.row({z: -1.0, **terms}, least=0.0)
                for variable, factor in terms.items():
                    mean[variable] = mean.get(variable, 0.0) + weight / total * factor / len(known)
        self.least, self.mean = {z: 1.0}, mean

    def _group(self, way: CoveredWay, rows: tuple[int, ...]) -> int:
        """The variable of time that counts if all rows are covered and the way is taken."""
        taken = self.taken.get(way.number)
        if len(rows) == 1 and taken is None:
            return self.covered[rows[0]]
        v = self.program.variable()
        for limit in [*(self.covered[row] for row in rows), *([] if taken is None else [taken])]:
            self.program.row({v: 1.0, limit: -1.0}, most=0.0)
        self.counted.append((v, way, rows))
        return v

    def no_later_than(self, delay: float) -> None:
        """Let every fault of the ways that are taken be noticed within a delay [s]."""
        for way in self.problem.cover.ways:
            for fault in way.faults:
                self._in_time(way, fault, delay)

    def shown_within(self, delay: float) -> None:
        """Take no cameras that show too late that a lost part has parted, in the ways that are taken [s]."""
        for way in self.problem.cover.ways:
            taken = self.taken.get(way.number)
            for option in np.flatnonzero(self.problem.late[way.number] > delay + SLACK).tolist():
                chosen = {self.free[option]: 1.0} if option in self.free else {}
                most = (taken is not None) - (option in self.problem.kept)
                self.program.row(chosen if taken is None else {**chosen, taken: 1.0}, most=float(most))

    def _in_time(self, way: CoveredWay, fault: FaultSamples, delay: float) -> None:
        taken, tiers, limit = self.taken.get(way.number), self.problem.cover.responses, delay + SLACK
        known: dict[tuple[int, int], int | None] = {}

        def seen(tier: int, sample: int) -> int | None:
            """The variable of a sample that cameras of a tier cover; None if none can."""
            rows = fault.rows[tier][sample]
            if rows is None or NEVER in rows:
                return None
            if (tier, sample) not in known:
                known[tier, sample] = self._all(rows)
            return known[tier, sample]

        def within(start: float, first: int) -> Iterator[int]:
            for tier, response in enumerate(tiers):
                last = int(np.searchsorted(fault.t, start + limit - response, side="right"))
                yield from (v for s in range(first, last) if (v := seen(tier, s)) is not None)

        begins = [(fault.start, -1)] + [(float(t), s) for s, t in enumerate(fault.t.tolist()) if t < fault.end]
        for start, sample in begins:
            if way.total - start <= limit:
                continue
            terms = dict.fromkeys(within(start, sample + 1), 1.0)
            if sample >= 0 and sample + 1 < len(fault.t) and fault.linked[sample]:
                for tier, response in enumerate(tiers):
                    pair = [fault.rows[tier][sample], fault.rows[tier][sample + 1]]
                    if response <= limit and all(rows is not None and NEVER not in rows for rows in pair):
                        terms[self._all(tuple(sorted({row for rows in pair for row in rows or ()})))] = 1.0
            self.program.row({**terms, **({} if taken is None else {taken: -1.0})}, least=1.0 if taken is None else 0.0)

    def _all(self, rows: tuple[int, ...]) -> int:
        """A variable that is 1 only if all rows are covered."""
        if len(rows) == 1:
            return self.covered[rows[0]]
        v = self.program.variable()
        for row in rows:
            self.program.row({v: 1.0, self.covered[row]: -1.0}, most=0.0)
        return v

    def values_of(self, choice: Choice) -> Array:
        """The values of all variables for a choice."""
        values = np.zeros(len(self.program.whole))
        covered = choice.covered(self.problem)
        values[[self.free[option] for option in choice.options]] = 1.0
        values[[self.taken[way] for way in choice.ways if way in self.taken]] = 1.0
        for row, y in self.covered.items():
            values[y] = float(covered[row])
        for v, way, rows in self.counted:
            values[v] = float(way.number in choice.ways and all(covered[row] for row in rows))
        for z in self.least:
            values[z] = worth_of(self.problem, choice).least
        return values
