"""The best choice of cameras and ways, with a proof: an integer program, one aim after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.placing.choice_program import SLACK, ChoiceProgram
from sqrp_cli.programming.placing.every import EverySet
from sqrp_cli.programming.placing.gain import improved, with_useful_cameras
from sqrp_cli.programming.placing.problem import Choice, Demand, Placing, worth_of
from sqrp_cli.programming.placing.solver import LinearProgram, Solution, Terms

_MOST_TRIED = 8
"""Most cameras that are tried to find a first choice which meets a wish."""

_QUALITIES = ("q_eoi", "q_avg")


@dataclass(frozen=True, eq=False, kw_only=True)
class Chosen:
    """The best choice that was found."""

    choice: Choice | None
    """None if there is none that meets the wish."""
    bound: float
    """No choice has a greater quality, least or mean, as far as was searched; in 0..1."""
    proven: bool
    """Whether nothing better exists, in every aim; or no choice at all, if there is none."""
    fewest: int | None = None
    """With a wish: no fewer cameras than this meet it."""
    interrupted: bool = False


class _Aim(NamedTuple):
    """Something to maximize."""

    title: str
    terms: Terms
    ideal: float
    """It is never more."""


class ChoiceSearch:
    """Builds and solves the integer program of a problem."""

    def __init__(
        self,
        problem: Placing,
        demand: Demand,
        watch: Callable[[str, float | None, float], None],
        start: Choice | None = None,
    ) -> None:
        """watch: called with what is sought now, the best value so far and the bound. start: a choice that is known."""
        self._problem, self._demand, self._watch, self._known = problem, demand, watch, start
        self._at_least = problem.at_least(demand)
        self._program = LinearProgram()
        self._interrupted = False
        self._proven = True
        self._parts = ChoiceProgram(self._program, problem)
        self._values: Array | None = None

    def best(self) -> Chosen:
        """The best choice: among all sets of cameras where they are few, else by the integer program."""
        return self._of_every_set(first_only=False) or self._by_program()

    def first(self) -> Chosen:
        """The best choice as far as the first aim is concerned."""
        found = self._of_every_set(first_only=True)
        if found is not None:
            return found
        self._limits()
        self._start()
        bound = self._first_bound()
        return self._chosen(bound)

    def _of_every_set(self, *, first_only: bool) -> Chosen | None:
        """The best of all sets of cameras; None if they are too many, or if no few cameras meet the wish."""
        problem, demand, most = self._problem, self._demand, self._demand.most
        known = [] if demand.wish is not None or most is None else list(self._known_choices(most))
        worths = [worth_of(problem, choice).of(demand.objective) for choice in known]
        every = EverySet(problem, demand, max(worths, default=0.0))
        limit = every.most if most is None else min(most, every.most)
        try:
            if demand.wish is not None:
                choice = self._fewest_of(every, limit)
                if choice is None and self._at_least <= limit:
                    return None
            elif every.fits(counts := range(self._at_least, limit + 1)):
                choice = every.best(counts, first_only=first_only)
            else:
                return None
        except KeyboardInterrupt:
            self._interrupted, self._proven = True, False
            choice = known[int(np.argmax(worths))] if known else None
        return self._compared(choice)

    def _fewest_of(self, every: EverySet, limit: int) -> Choice | None:
        """The best of the smallest sets that meet the wish, as far as sets are few; then `_at_least` has grown."""
        while self._at_least <= limit and every.fits([self._at_least]):
            choice = every.best([self._at_least])
            if choice is not None:
                return choice
            self._at_least += 1
        return None

    def _compared(self, choice: Choice | None) -> Chosen:
        """What came of a comparison of all sets."""
        demand, quality = self._demand, 0.0
        if choice is not None:
            choice = with_useful_cameras(self._problem, demand, choice)
            quality = worth_of(self._problem, choice).of(demand.objective)
        return Chosen(
            choice=choice,
            bound=1.0 if self._interrupted else quality,
            proven=self._proven,
            fewest=None if demand.wish is None or choice is None else len(choice.options),
            interrupted=self._interrupted,
        )

    def _by_program(self) -> Chosen:
        demand, fewest = self._demand, None
        self._limits()
        if demand.wish is not None:
            self._wish()
            known = next((choice for choice in self._candidates() if self._meets(choice)), None)
            self._values = None if known is None else self._parts.values_of(known)
            count = self._next("fewest cameras", dict.fromkeys(self._parts.free.values(), -1.0))
            if self._values is None:
                return self._chosen(0.0)
            fewest = round(-count.bound) if count.proven else int(np.ceil(-count.bound - SLACK))
            self._program.row(dict.fromkeys(self._parts.free.values(), 1.0), most=float(len(self._choice().options)))
        else:
            self._start()
        bound = self._first_bound()
        if self._values is None:
            return self._chosen(0.0)
        self._hold(self._first)
        if not self._interrupted:
            self._shorten_delay()
        for aim in self._further():
            if not self._interrupted and self._may_improve(aim):
                self._next(aim.title, aim.terms)
            self._hold(aim.terms)
        return self._chosen(bound, fewest)

    def _chosen(self, bound: float, fewest: int | None = None) -> Chosen:
        choice = None if self._values is None else with_useful_cameras(self._problem, self._demand, self._choice())
        return Chosen(
            choice=choice,
            bound=0.0 if choice is None else bound,
            proven=self._proven,
            fewest=fewest,
            interrupted=self._interrupted,
        )

    @property
    def _first(self) -> Terms:
        """What counts first."""
        return self._parts.least if self._demand.objective == "least" else self._parts.mean

    def _first_bound(self) -> float:
        """Improve the quality that counts first, unless it is perfect already; its bound."""
        if self._values is not None and self._value(self._first) >= 1.0 - SLACK:
            return 1.0
        return min(1.0, self._next(f"{self._demand.objective} Q", self._first).bound)

    def _further(self) -> Iterator[_Aim]:
        """The aims after quality and delay, each with a value that nothing exceeds."""
        free, price = self._parts.free, self._problem.price
        needed = self._at_least
        cheapest = float(np.sort(price[list(free)])[:needed].sum())
        yield _Aim("price", {x: -float(price[option]) for option, x in free.items()}, -cheapest)
        yield _Aim("fewest cameras", dict.fromkeys(free.values(), -1.0), -float(needed))
        yield _Aim("mean Q", self._parts.mean, 1.0)

    def _may_improve(self, aim: _Aim) -> bool:
        return any(aim.terms.values()) and self._value(aim.terms) < aim.ideal - SLACK

    def _value(self, terms: Terms) -> float:
        values = self._values
        return -np.inf if values is None else float(sum(factor * values[n] for n, factor in terms.items()))

    def _next(self, title: str, terms: Terms) -> Solution:
        """Improve one aim; keeps the values if there are better ones."""
        known = self._values if self._values is not None and len(self._values) == len(self._program.whole) else None
        found = self._program.maximized(terms, known, partial(self._watch, title))
        if found.values is not None:
            self._values = found.values
        self._interrupted |= found.interrupted
        self._proven &= found.proven
        return found

    def _hold(self, terms: Terms) -> None:
        """No later aim may worsen this one."""
        if self._values is not None:
            self._program.row(terms, least=sum(f * self._values[n] for n, f in terms.items()) - SLACK)

    def _choice(self) -> Choice:
        values, parts = self._values, self._parts
        assert values is not None  # noqa: S101 - it is asked for once there are some
        options = tuple(option for option, x in parts.free.items() if values[x] > 0.5)
        ways = tuple(
            max(of_one, key=lambda way: values[parts.taken[way]] if way in parts.taken else 1.0)
            for of_one in self._problem.candidates
        )
        return Choice(options, ways)

    def _start(self) -> None:
        """Begin with the greedy choice: so there is one whenever the search is ended."""
        problem, demand = self._problem, self._demand
        known = self._known_choices(demand.most if demand.most is not None else len(self._parts.free))
        best = max(known, key=lambda choice: worth_of(problem, choice).of(demand.objective), default=None)
        self._values = None if best is None else self._parts.values_of(best)

    def _known_choices(self, most: int) -> Iterator[Choice]:
        """Choices of so many cameras that are found at once, and may be chosen."""
        some = [improved(self._problem, self._demand, most), *([] if self._known is None else [self._known])]
        allowed = (choice for choice in some if choice.options not in self._problem.missing)
        yield from (choice for choice in allowed if self._at_least <= len(choice.options) <= most)

    def _candidates(self) -> Iterator[Choice]:
        """Choices that may meet the wish."""
        if self._known is not None:
            yield self._known
        most = _MOST_TRIED if self._demand.most is None else self._demand.most
        yield from (improved(self._problem, self._demand, count) for count in range(1, most + 1))

    def _meets(self, choice: Choice) -> bool:
        """Whether a choice reaches what is wished for."""
        wish, most = self._demand.wish, self._demand.most
        assert wish is not None  # noqa: S101 - the caller has looked
        worth = worth_of(self._problem, choice)
        enough = all(
            least is None or quality is None or quality >= least - SLACK
            for pair in worth.qualities
            for least, quality in zip((wish.q_eoi, wish.q_avg), pair, strict=True)
        )
        late = max(worth.delay, self._problem.least_delay(choice))
        in_time = wish.delay is None or late <= wish.delay + SLACK
        count = len(choice.options)
        allowed = choice.options not in self._problem.missing and count >= self._at_least
        return enough and in_time and allowed and (most is None or count <= most)

    def _limits(self) -> None:
        """One camera at a place, none that are in each other's or the robot's way, number and budget."""
        problem, demand, program, parts = self._problem, self._demand, self._program, self._parts
        at: dict[int, dict[int, float]] = {}
        for option, x in parts.free.items():
            at.setdefault(int(problem.spot[option]), {})[x] = 1.0
        for terms in at.values():
            if len(terms) > 1:
                program.row(terms, most=1.0)
        for first, second in sorted(problem.apart):
            if first in at and second in at:
                program.row({**at[first], **at[second]}, most=1.0)
        for place, way in sorted(problem.blocked):
            if place in at:
                taken = parts.taken.get(way)
                program.row(at[place] if taken is None else {**at[place], taken: 1.0}, most=1.0 if taken else 0.0)
        for hiding in sorted(problem.hiding):
            seeing = {parts.free[option]: 1.0 for option in hiding.options if option in parts.free}
            both, taken = {**at.get(hiding.place, {}), **seeing}, parts.taken.get(hiding.way)
            most = 1.0 if seeing else 0.0  # what a camera that stays sees must not be hidden
            program.row(both if taken is None else {**both, taken: 1.0}, most=most + (taken is not None))
        for some in sorted(problem.missing):
            program.row({x: 1.0 if option in some else -1.0 for option, x in parts.free.items()}, most=len(some) - 1.0)
        if self._at_least:
            program.row(dict.fromkeys(parts.free.values(), 1.0), least=float(self._at_least))
        if demand.most is not None:
            program.row(dict.fromkeys(parts.free.values(), 1.0), most=float(demand.most))
        if demand.budget is not None:
            prices = {x: float(problem.price[option]) for option, x in parts.free.items()}
            program.row(prices, most=demand.budget + 1e-9)

    def _wish(self) -> None:
        """Every candidate reaches what is wished for."""
        wish = self._demand.wish
        assert wish is not None  # noqa: S101 - the caller has looked
        for candidate in range(len(self._problem.candidates)):
            for name, terms in zip(_QUALITIES, self._parts.qualities[candidate], strict=True):
                least = getattr(wish, name)
                if least is not None and terms is not None:
                    self._program.row(terms, least=least - SLACK)
        if wish.delay is not None:
            self._parts.no_later_than(wish.delay)
            self._parts.shown_within(wish.delay)

    def _shorten_delay(self) -> None:
        """The shortest longest delay, by bisection over the values that it can have; each step is a program."""
        if self._delay() <= self._problem.cover.quickest + SLACK and not any(map(self._may_improve, self._further())):
            return
        low, high = 0, len(values := self._delays()) - 1
        if high < 0:
            return
        high = int(np.searchsorted(values, self._delay() + SLACK, side="right")) - 1
        while low < high and not self._interrupted:
            middle = (low + high) // 2
            rows, count = len(self._program.rows), len(self._program.whole)
            self._parts.no_later_than(float(values[middle]))
            self._watch("delay", float(values[high]), float(values[low]))
            found = self._program.maximized({})
            self._interrupted |= found.interrupted
            if found.values is not None:
                self._values = found.values[:count]
                high = min(middle, int(np.searchsorted(values, self._delay() + SLACK, side="right")) - 1)
            elif found.proven:
                low = middle + 1
            else:
                self._proven = False
                low = high
            self._program.cut(rows, count)
        if self._values is not None:
            count = len(self._program.whole)
            self._parts.no_later_than(float(values[high]))
            if len(self._program.whole) > count:
                solved = self._program.maximized({})
                self._values = solved.values if solved.values is not None else self._values

    def _delay(self) -> float:
        return worth_of(self._problem, self._choice()).delay

    def _delays(self) -> Array:
        """All values that the longest delay can have, the shortest first [s]."""
        found: set[float] = set()
        tiers = self._problem.cover.responses
        for way in self._problem.cover.ways:
            for fault in way.faults:
                ends = np.append((fault.t[:, None] + np.array(tiers)).ravel(), way.total)
                starts = np.append(fault.t[fault.t < fault.end], fault.start)
                gaps = (ends[None] - starts[:, None]).ravel()
                found |= set(np.round(gaps[gaps > 0], 6).tolist())
        found |= set(np.round(tiers, 6).tolist()) if found else set()
        return np.array(sorted(value for value in found if value >= self._problem.cover.quickest - SLACK))
