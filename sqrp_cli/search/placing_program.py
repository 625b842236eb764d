"""The integer program that chooses cameras and ways, by HiGHS: one objective after the other, each with its bound."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from functools import partial
from math import inf
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from sqrp_cli.errors import needed
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass
from sqrp_cli.search.placing_problem import Problem, Requirements, Selection

Terms = Mapping[int, float]  # a linear expression: the factor of each variable, by its number
Watch = Callable[[str, float | None, float], None]
"""Told what is sought, the best value so far if there is one, and the bound."""
SLACK = 1e-7  # by how much a later objective may worsen an earlier one: figures of the solver are rounded
DELAY_STEP = 0.01  # delays are compared in whole steps [s]


class Optimum(NamedTuple):
    """What came of a program."""

    values: Array | None  # of the variables; None if none was found
    bound: float  # no values are better than this; minus infinity where nothing is possible at all
    proven: bool  # whether the values are the best, or it is proven that there are none
    interrupted: bool = False  # whether Ctrl-C came


@dataclass(eq=False)
class LinearProgram:
    """Variables in 0..1 and linear rows between limits, built step by step."""

    whole: list[bool] = field(default_factory=list)  # whether each variable takes whole numbers only
    rows: list[tuple[float, Terms, float]] = field(default_factory=list)

    def variable(self, *, whole: bool = False) -> int:
        """A new variable; its number."""
        self.whole.append(whole)
        return len(self.whole) - 1

    def row(self, terms: Terms, *, least: float = -inf, most: float = inf) -> None:
        """A limit on an expression."""
        self.rows.append((least, dict(terms), most))

    def all_of(self, limits: Iterable[int]) -> int:
        """A variable that is at most each of these: 1 only if all are."""
        some = list(dict.fromkeys(limits))
        if len(some) == 1:
            return some[0]
        both = self.variable()
        for limit in some:
            self.row({both: 1.0, limit: -1.0}, most=0.0)
        return both

    def maximized(
        self,
        objective: Terms,
        watch: Callable[[float | None, float], None] | None = None,
        start: Array | None = None,
        *,
        until: float = inf,
        gap: float = 0.0,
        presolve: bool = True,
    ) -> Optimum:
        """The values with the greatest objective; always the same for the same program and start, unless time ends.

        start: values that are known, of the first variables at least, which stay where none is better. Ctrl-C ends the
        search with the best values so far, and so do `until`, by `time.monotonic` [s], and a bound that is no more than
        `gap` above them. presolve: whether HiGHS looks for rows and variables that do not matter first. One thread
        solves it: more would not always give the same values.
        """
        library, size = solver_library(), len(self.whole)
        highs = library._core._Highs()  # its wrapper in Python prints a line before it can be told not to
        options = {"output_flag": False, "threads": 1, "presolve": "choose" if presolve else "off", "random_seed": 0}
        limits = {"mip_rel_gap": 1e-9, "mip_abs_gap": max(gap, 1e-9), "mip_feasibility_tolerance": 1e-7}
        for name, value in (options | limits | {"time_limit": max(until - monotonic(), 0.0)}).items():
            highs.setOptionValue(name, value)
        model, cost, kinds = library.HighsLp(), np.zeros(size), library.HighsVarType
        cost[list(objective)] = list(objective.values())
        model.num_col_, model.num_row_ = size, len(self.rows)
        model.sense_ = library.ObjSense.kMaximize
        model.col_cost_, model.col_lower_, model.col_upper_ = cost, np.zeros(size), np.ones(size)
        model.row_lower_ = np.array([least for least, _, _ in self.rows])
        model.row_upper_ = np.array([most for _, _, most in self.rows])
        matrix = model.a_matrix_
        matrix.format_ = library.MatrixFormat.kRowwise
        matrix.start_ = np.cumsum([0, *(len(terms) for _, terms, _ in self.rows)]).astype(np.int32)
        matrix.index_ = np.array([n for _, terms, _ in self.rows for n in terms], dtype=np.int32)
        matrix.value_ = np.array([factor for _, terms, _ in self.rows for factor in terms.values()], dtype=float)
        model.integrality_ = [kinds.kInteger if whole else kinds.kContinuous for whole in self.whole]
        highs.passModel(model)
        if start is not None:
            found = library.HighsSolution()
            found.col_value = [*start.tolist(), *[0.0] * (size - len(start))]
            highs.setSolution(found)
        with _until_interrupted(highs, watch) as interrupted:
            highs.run()
        status = highs.getModelStatus()
        if status == library.HighsModelStatus.kInfeasible:
            return Optimum(None, -inf, proven=True)
        info, values = highs.getInfo(), np.array(highs.getSolution().col_value)
        whole, feasible = np.array(self.whole, dtype=bool), info.primal_solution_status == 2
        values[whole] = np.round(values[whole])
        reached = sum(factor * values[number] for number, factor in objective.items())
        if start is not None and feasible and abs(reached - info.objective_function_value) > 1e-5:
            # HiGHS 1.16 returns the start, with the figure of better values that it found before it read that.
            return self.maximized(objective, watch, until=until, gap=gap, presolve=presolve)
        bound = float(info.mip_dual_bound) if any(self.whole) else float(info.objective_function_value)
        optimal = status == library.HighsModelStatus.kOptimal
        proven = optimal and (not feasible or bound - info.objective_function_value <= SLACK)
        return Optimum(values if feasible else None, bound, proven=proven, interrupted=bool(interrupted))


def solver_library() -> Any:  # noqa: ANN401 # a module without types
    """HiGHS. Raises InputError where it is not installed."""
    with needed("placing cameras needs HiGHS, which is not installed", "pip install 'sqrp[place]'"):
        import highspy
    return highspy


@contextmanager
def _until_interrupted(
    highs: Any,  # noqa: ANN401
    watch: Callable[[float | None, float], None] | None,
) -> Iterator[Sequence[int]]:
    """Let Ctrl-C end a search; yields a list that is then not empty."""
    kinds = solver_library().cb.HighsCallbackType
    came: list[int] = []

    def called(kind: Any, _message: str, out: Any, into: Any, _data: object) -> None:  # noqa: ANN401
        if kind == kinds.kCallbackMipInterrupt and into is not None:
            into.user_interrupt = bool(came)
        if watch is not None and abs(out.mip_dual_bound) < 1e20:
            watch(out.mip_primal_bound if abs(out.mip_primal_bound) < 1e20 else None, out.mip_dual_bound)

    highs.setCallback(called, None)
    highs.startCallback(kinds.kCallbackMipInterrupt)
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)


class PlacementProgram:
    """Builds and solves the integer program of a problem.

    Objectives, one after the other: with a goal the number of cameras; the quality that counts first; the longest
    delay, in hundredths of a second; the price; the number of cameras; the mean quality; what each camera sees alone,
    added up; the order of the options.

    Where all that counts can be seen, nothing is better, and the program is a set cover: a row for each set of options
    one of which has to be chosen, and no variable for what is covered. That is tried first.
    """

    def __init__(
        self,
        problem: Problem,
        requirements: Requirements,
        watch: Watch,
        start: Selection | None = None,
        *,
        until: float = inf,
        gap: float = 0.0,
    ) -> None:
        """watch: told of the search. start: a selection to begin with, which may break limits.

        until, gap: when it may end before its proof, see `LinearProgram.maximized`; of the quality that counts first.
        """
        self._problem, self._requirements, self._watch = problem, requirements, watch
        self._until, self._gap = until, gap
        self._program = program = LinearProgram()
        self._x = {option: program.variable(whole=True) for option in problem.free}
        """Of each option on mounts: whether it is chosen."""
        self._taken: dict[int, int] = {}  # of each way of a candidate that has several: whether it is taken
        for of_one in problem.candidates:
            if len(of_one) > 1:
                self._taken |= {way: program.variable(whole=True) for way in of_one}
                program.row({self._taken[way]: 1.0 for way in of_one}, least=1.0, most=1.0)
        self._covered: dict[int, int] = {}  # of each row of the problem that is asked for: whether it is covered
        self._qualities: list[tuple[Terms | None, Terms | None]] = []
        """Q_eoi and Q_avg of each candidate, once they are expressions; None where undefined."""
        self._mean: Terms = {}  # then: the mean quality
        self._start: Array | None = None
        if start is not None:
            self._start = np.zeros(len(program.whole))
            self._start[[self._x[option] for option in start.options]] = 1.0
            self._start[[self._taken[way] for way in start.ways if way in self._taken]] = 1.0
        self._limit_sites()
        self._values: Array | None = None  # the best so far
        self.bound = 1.0  # no selection has a greater quality, least or mean, in 0..1
        self.proven = True  # whether nothing is better in the objectives so far, or that there is no selection at all
        self.fewest = 0  # with a goal: no fewer cameras than this meet it
        self.interrupted = False  # whether Ctrl-C came
        self.complete = False  # whether the selection sees all that counts

    @property
    def selection(self) -> Selection | None:
        """The best selection; None if there is none, or none was found in time."""
        values = self._values
        if values is None:
            return None
        ways = tuple(
            max(of_one, key=lambda way: values[self._taken[way]] if way in self._taken else 1.0)
            for of_one in self._problem.candidates
        )
        return Selection(tuple(option for option, x in self._x.items() if values[x] > 0.5), ways)

    def solve_first(self) -> Selection | None:
        """The best selection in the first objectives: with a goal the number of cameras, and the quality."""
        requirements, count = self._requirements, dict.fromkeys(self._x.values(), 1.0)
        if requirements.goal is not None:
            self._demand_goal()
            fewest = self._improve("fewest cameras", dict.fromkeys(count, -1.0))
            if (chosen := self.selection) is None:
                self.bound = 0.0 if self.proven else self.bound
                return None
            self.fewest = max(0, int(np.ceil(-fewest.bound - 1e-6)))
            self._program.row(count, most=float(len(chosen.options)))
        title, program = f"{requirements.objective} Q", self._program
        rows, variables = len(program.rows), len(program.whole)
        # Demand that all is seen that any quality counts. Where that is possible it is chosen by the last objective, so
        # that nothing is left to improve where the others are at their best then.
        if self._demand_all((one, which) for one in self._problem.candidates for which in (0, 1)):
            self._watch(title, None, 1.0)
            last = self._last_objective(len(self._x) if requirements.most is None else requirements.most)
            start = self._start if self._values is None else self._values
            # Rows that follow from others are left out already.
            found = program.maximized(last, None, start, until=self._until, presolve=False)
            self.interrupted |= found.interrupted
            if found.values is not None:
                self._values, self.proven, self.complete = found.values, self.proven and found.proven, True
        if not self.complete:
            del program.rows[rows:], program.whole[variables:]
            terms = self._mean_quality()
            if requirements.objective == "least":
                least = self._program.variable()
                for quality in (one for pair in self._qualities for one in pair if one is not None):
                    self._program.row({least: -1.0, **quality}, least=0.0)
                terms = {least: 1.0}
            bound = min(1.0, self._improve(title, terms, gap=self._gap).bound)
            self.bound = 0.0 if self._values is None and self.proven else max(0.0, bound)
        return self.selection

    def solve_further(self, known: Selection) -> Selection | None:
        """The best of the selections that `solve_first` cannot tell apart, in all other objectives.

        known: the one that it has found.
        """
        problem = self._problem
        at_best = self._shorten_delay(known) and self.complete and self.proven
        least, price = self._requirements.at_least(len(problem.kept)), problem.price[list(self._x)]
        if problem.price[list((self.selection or known).options)].sum() > np.sort(price)[:least].sum() + SLACK:
            at_best = False
            self._improve("price", {x: -float(problem.price[option]) for option, x in self._x.items()})
        if len((self.selection or known).options) > least:
            at_best = False
            self._improve("fewest cameras", dict.fromkeys(self._x.values(), -1.0))
        mean = replace(self._requirements, objective="mean")
        if not self.complete and problem.worth(mean, self.selection or known)[0] < 1.0 - SLACK:
            self._improve("mean Q", self._mean_quality())
        if not at_best:
            self._improve("what each sees", self._last_objective(len((self.selection or known).options)))
        return self.selection

    def _last_objective(self, most: int) -> Terms:
        """What each camera sees alone, added up; then the order of the options. most: how many are chosen at most."""
        alone = {x: round(float(self._problem.alone[option]), 4) for option, x in self._x.items()}
        return {x: sees - 1e-5 * x / len(alone) / max(1, most) for x, sees in alone.items()}

    def _row(self, number: int) -> int:
        """The variable of a row: whether enough of the options that see it are chosen."""
        if number not in self._covered:
            still, seen = self._still_needed(number)
            self._covered[number] = covered = self._program.variable(whole=still > 1)
            if still > 0:
                self._program.row({covered: float(still), **dict.fromkeys(seen, -1.0)}, most=0.0)
        return self._covered[number]

    def _still_needed(self, number: int) -> tuple[int, list[int]]:
        """How many of the options on mounts have to see a row, and the variables of those that do."""
        rows, kept = self._problem.rows, sorted(self._problem.kept)
        seen = [self._x[option] for option in np.flatnonzero(rows.sees[number]).tolist() if option in self._x]
        return rows.needed[number] - int(rows.sees[number][kept].sum()), seen

    def _if_taken(self, way: int, factor: float = 1.0) -> dict[int, float]:
        """The variable that says whether a way is taken; none where it is the only one."""
        return {self._taken[way]: factor} if way in self._taken else {}

    def _not_all(self, *parts: Terms) -> None:
        """Let not all of some parts be so: variables of which one at most is 1, or none where a part always is so."""
        some = [part for part in parts if part]
        self._program.row({variable: 1.0 for part in some for variable in part}, most=len(some) - 1.0)

    def _demand_all(self, qualities: Iterable[tuple[Sequence[int], int]]) -> bool:
        """Let candidates have all of some qualities in the way that is taken; whether each has a way that may.

        qualities: the ways of a candidate, and which of the `CoveredWay.times` is counted.
        """
        problem, demanded = self._problem, dict[int | None, set[int]]()
        for of_one, which in qualities:
            may = False
            for number in of_one:
                way, taken = problem.ways[number], self._taken.get(number)
                groups = {rows: times[which] for rows, times in way.groups.items() if times[which] > 0.0}
                if sum(groups.values()) >= way.times[which] * (1.0 - SLACK):
                    may = True
                    demanded.setdefault(taken, set()).update(row for rows in groups for row in rows)
                elif taken is not None:
                    self._program.row({taken: 1.0}, most=0.0)
            if not may:
                return False
        for taken, rows in demanded.items():
            for row in problem.rows.hardest(rows):
                still, seen = self._still_needed(row)
                if still > 0:
                    unless = {} if taken is None else {taken: -float(still)}
                    self._program.row(dict.fromkeys(seen, 1.0) | unless, least=0.0 if unless else float(still))
        return True

    def _mean_quality(self) -> Terms:
        """The mean quality as an expression; then `_qualities` are known, too."""
        if self._qualities:
            return self._mean
        problem, program, mean = self._problem, self._program, dict[int, float]()
        total = max(float(problem.weights.sum()), 1e-12)
        for weight, of_one in zip(problem.weights.tolist(), problem.candidates, strict=True):
            counted = [
                (program.all_of([*map(self._row, rows), *self._if_taken(way)]), problem.ways[way].times, times)
                for way in of_one
                for rows, times in problem.ways[way].groups.items()
            ]
            pair: list[Terms | None] = []
            for which in (0, 1):
                terms: dict[int, float] = {}
                for variable, whole, times in counted:
                    if times[which]:
                        terms[variable] = terms.get(variable, 0.0) + times[which] / whole[which]
                defined = problem.ways[of_one[0]].times[which] > 0  # all ways have the same formulas
                pair.append(terms if defined else None)
            self._qualities.append((pair[0], pair[1]))
            known = [terms for terms in pair if terms is not None]
            for variable, factor in (item for terms in known for item in terms.items()):
                mean[variable] = mean.get(variable, 0.0) + weight / total * factor / len(known)
        self._mean = mean
        return mean

    def _limit_sites(self) -> None:
        """One camera at a site, none that are in each other's or the robot's way, number and budget."""
        problem, requirements, program = self._problem, self._requirements, self._program
        at: dict[int, dict[int, float]] = {}
        for option, x in self._x.items():
            at.setdefault(int(problem.site_of[option]), {})[x] = 1.0
        for terms in (terms for terms in at.values() if len(terms) > 1):
            program.row(terms, most=1.0)
        for first, second in sorted(problem.apart):
            if first in at and second in at:
                self._not_all(at[first], at[second])
        for site, way in sorted(problem.blocked):
            if site in at:
                self._not_all(at[site], self._if_taken(way))
        for site, options, way in sorted(problem.hiding):  # a camera that stays is always there, to hide and to see
            seeing = {self._x[option]: 1.0 for option in options if option in self._x}
            self._not_all(at.get(site, {}), seeing, self._if_taken(way))
        for options, way in sorted(problem.late):
            exactly = {x: 1.0 if option in options else -1.0 for option, x in self._x.items()}
            program.row(exactly | self._if_taken(way), most=len(options) - 1.0 + (way in self._taken))
        limit = inf if requirements.most is None else float(requirements.most)
        least = float(requirements.at_least(len(problem.kept)))
        program.row(dict.fromkeys(self._x.values(), 1.0), least=least, most=limit)
        if requirements.budget is not None:
            prices = {x: float(problem.price[option]) for option, x in self._x.items()}
            program.row(prices, most=requirements.budget + 1e-9)

    def _demand_goal(self) -> None:
        """Let every candidate reach the goal."""
        goal, problem = self._requirements.goal, self._problem
        assert goal is not None  # noqa: S101 - the caller has looked
        stated = [(which, least) for which, least in enumerate((goal.q_eoi, goal.q_avg)) if least is not None]
        whole = [which for which, least in stated if least >= 1.0]
        if not self._demand_all((one, which) for one in problem.candidates for which in whole):
            self._program.row({}, least=1.0)
        for which, least in stated:
            if which not in whole:
                self._mean_quality()
                for terms in filter(None, (pair[which] for pair in self._qualities)):
                    self._program.row(terms, least=least - SLACK)
        if goal.delay is not None:
            self._no_later_than(goal.delay)
            for way, option in np.argwhere(problem.least_delays > goal.delay + SLACK).tolist():
                self._not_all({} if option in problem.kept else {self._x[option]: 1.0}, self._if_taken(way))

    def _no_later_than(self, delay: float) -> None:
        """Let every fault of the ways that are taken be noticed within a delay [s], as far as the problem knows.

        A row for each time at which a fault may happen: one of the intervals that are soon enough shows it.
        """
        for way, fault in ((number, one) for number, of in enumerate(self._problem.ways) for one in of.faults):
            soon = [fault.least(np.full(len(fault.begin), tier)) <= delay + SLACK for tier in self._problem.tiers]
            shown: dict[tuple[int, ...], int] = {}
            demanded: set[tuple[int, ...]] = set()
            for number in range(len(fault.first)):
                enough: dict[int, float] = {}
                for tier, rows in zip(soon, fault.rows, strict=True):
                    some = {rows[interval] for interval in np.flatnonzero(tier[number]).tolist()}
                    if () in some:  # nothing is known of what shows it there
                        break
                    for of_one in (rows_of for rows_of in some if rows_of is not None):
                        if of_one not in shown:
                            shown[of_one] = self._program.all_of(map(self._row, of_one))
                        enough[shown[of_one]] = 1.0
                else:
                    if (key := tuple(sorted(enough))) not in demanded:
                        demanded.add(key)
                        taken = self._if_taken(way, -1.0)
                        self._program.row({**enough, **taken}, least=0.0 if taken else 1.0)

    def _improve(self, title: str, terms: Terms, gap: float = 0.0) -> Optimum:
        """Improve one objective, keep the values if there are better ones, and let no later one worsen it."""
        found = Optimum(None, inf, proven=False, interrupted=True)
        if not self.interrupted:
            watch, start = partial(self._watch, title), self._start if self._values is None else self._values
            found = self._program.maximized(terms, watch, start, until=self._until, gap=gap)
        self.interrupted |= found.interrupted
        self.proven &= found.proven
        if found.values is not None:
            self._values = found.values
            self._program.row(terms, least=sum(factor * self._values[n] for n, factor in terms.items()) - SLACK)
        return found

    def _shorten_delay(self, known: Selection) -> bool:
        """The shortest longest delay, by bisection over the values that it can have; each step is a program.

        Whether the known selection has the shortest that any selection can have.
        """
        problem = self._problem
        some = [
            fault.least(np.full(len(fault.begin), tier)).ravel()
            for way in problem.ways
            for fault in way.faults
            for tier in problem.tiers
        ]
        values = np.unique(np.ceil(np.concatenate([np.zeros(0), *some]) / DELAY_STEP - 1e-6) * DELAY_STEP)
        values = values[np.isfinite(values) & (values >= min(problem.tiers, default=0.0) - SLACK)]
        low, high = 0, int(np.searchsorted(values, problem.worth(self._requirements, known)[1] - SLACK))
        at_best = high == 0
        rows, variables, covered = len(self._program.rows), len(self._program.whole), dict(self._covered)
        while low < high and not self.interrupted:
            middle = high - 1 if high == len(values) else (low + high) // 2  # first whether all can be seen at all
            self._no_later_than(float(values[middle]))
            self._watch("delay", float(values[high]) if high < len(values) else None, float(values[low]))
            found = self._program.maximized({}, until=self._until)
            self.interrupted |= found.interrupted
            del self._program.rows[rows:], self._program.whole[variables:]
            self._covered = dict(covered)
            if found.values is not None:
                self._values, high = found.values[:variables], middle
            elif found.proven:
                low = middle + 1
            else:
                self.proven, low = False, high
        if high < len(values):
            self._no_later_than(float(values[high]))
        return at_best
