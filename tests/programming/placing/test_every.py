"""The best of all sets of cameras of small random problems, against a look at each of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.placing import every
from sqrp_cli.programming.placing.choose import ChoiceSearch
from sqrp_cli.programming.placing.cover import Cover, CoveredWay, FaultSamples, Group, RowTable
from sqrp_cli.programming.placing.every import EverySet
from sqrp_cli.programming.placing.gain import Gain, improved
from sqrp_cli.programming.placing.problem import OBJECTIVES, Choice, Demand, Placing, Worth, worth_of

OPTIONS, PLACES, ROWS = 8, 6, 7


def random_problem(rng: np.random.Generator) -> Placing:
    """Two candidates with two ways each, in which some rows must be covered together."""
    table = RowTable()
    for row in range(ROWS):
        sees = rng.random(OPTIONS) < 0.3
        sees[rng.integers(OPTIONS, size=2)] = True
        table.numbers[(row, b"")] = row
        table.sees.append(sees)
        table.needed.append(1 + int(rng.random() < 0.2))

    def way(number: int) -> CoveredWay:
        groups = tuple(
            Group(tuple(sorted({*rng.integers(ROWS, size=2).tolist()})), seconds, seconds * rng.integers(2))
            for seconds in rng.random(5)
        )
        fault = FaultSamples(
            start=1.0,
            end=3.0,
            t=np.arange(1.0, 6.0),
            rows=(tuple((int(row),) for row in rng.integers(ROWS, size=5)),),
            linked=np.ones(4, dtype=bool),
        )
        scene = SimpleNamespace(
            T=sum(group.seconds for group in groups),
            T_eoi=sum(group.of_interest for group in groups),
            motion=SimpleNamespace(time=6.0),
        )
        return CoveredWay(SimpleNamespace(scene=scene), number, groups, (fault,))

    return Placing(
        cover=Cover(tuple(way(number) for number in range(4)), table, (0.1,)),
        candidates=((0, 1), (2, 3)),
        weights=np.array([1.0, 2.0]),
        spot=rng.integers(PLACES, size=OPTIONS),
        price=rng.integers(1, 4, size=OPTIONS).astype(float),
        kept=frozenset(rng.integers(OPTIONS, size=rng.integers(2)).tolist()),
        apart=frozenset({(0, 1), (0, PLACES)}),  # at the last place there is no option
        blocked=frozenset({(int(rng.integers(PLACES)), int(rng.integers(4)))}),
        late=rng.random((4, OPTIONS)),
        missing=frozenset({tuple(sorted(rng.choice(OPTIONS, 3, replace=False).tolist()))}),
    )


def each_set(problem: Placing, count: int, budget: float = np.inf) -> Iterator[tuple[int, ...]]:
    """Every set of so many cameras that may be chosen."""
    for chosen in combinations(sorted({*range(OPTIONS)} - problem.kept), count):
        places = [int(problem.spot[option]) for option in chosen]
        clash = len(set(places)) < count or any(pair in problem.apart for pair in permutations(places, 2))
        if not clash and chosen not in problem.missing and sum(problem.price[list(chosen)]) <= budget:
            yield chosen


def each_choice(problem: Placing, demand: Demand, count: int) -> Iterator[Worth]:
    """What every set of so many cameras is worth in all ways that reach the wish with it."""
    wish = demand.wish or Wish()
    for chosen in each_set(problem, count, demand.budget or np.inf):
        for ways in product(*problem.candidates):
            choice = Choice(chosen, ways)
            worth = worth_of(problem, choice)
            wanted = [zip((wish.q_eoi, wish.q_avg), pair, strict=True) for pair in worth.qualities]
            enough = all(q is None or q >= (least or 0.0) - 1e-9 for pair in wanted for least, q in pair)
            late = max(worth.delay, problem.least_delay(choice)) > (wish.delay or np.inf) + 1e-9
            touches = any((problem.spot[option], way) in problem.blocked for option in chosen for way in ways)
            if enough and not late and not touches:
                yield worth


@pytest.mark.parametrize("seed", range(60))
def test_what_is_left_out_by_bounds_is_never_better(seed):
    rng = np.random.default_rng(seed)
    problem, count = random_problem(rng), int(rng.integers(1, 5))
    demand = Demand(budget=None if rng.integers(2) else 2.0 * count, objective=OBJECTIVES[rng.integers(2)])
    known = list(each_choice(problem, demand, count))
    if known and seed % 3:  # a wish that the best just meets, or just does not
        best = max(known, key=lambda worth: worth.of(demand.objective))
        q_eoi, q_avg = (min(q for q in each if q is not None) for each in zip(*best.qualities, strict=True))
        wish = Wish(q_eoi=q_eoi, delay=best.delay + 1.0) if seed % 3 == 1 else Wish(q_avg=q_avg + rng.choice([0, 1e-5]))
        demand = replace(demand, wish=wish)
        known = list(each_choice(problem, demand, count))
    found = EverySet(problem, demand).best([count])
    assert (found is None) == (not known)
    if found is not None:
        worth, first = worth_of(problem, found), max(one.of(demand.objective) for one in known)
        assert worth.of(demand.objective) == pytest.approx(first, abs=1e-9)
        if demand.objective == "least":
            equal = [(one.delay, one.price) for one in known if one.least >= first - 1e-9]
            assert (worth.delay, worth.price) == pytest.approx(min(equal), abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_of_sets_that_are_equal_in_every_aim_the_first_of_the_file_is_chosen(seed):
    problem = random_problem(np.random.default_rng(seed))
    problem.cover.table.sees[:] = [np.ones(OPTIONS, dtype=bool)] * ROWS
    problem = replace(problem, price=np.ones(OPTIONS), blocked=frozenset())
    found = EverySet(problem, Demand()).best([2, 3])
    assert found is not None
    assert found.options == min(each_set(problem, 2))


@pytest.mark.parametrize("seed", range(20))
def test_no_more_is_covered_than_a_bound_says(seed):
    rng = np.random.default_rng(seed)
    problem = random_problem(rng)
    gain, more = Gain(problem, Demand()), int(rng.integers(1, 4))
    begun, open_ = rng.choice(OPTIONS, 2, replace=False), rng.random(OPTIONS) < 0.7
    seen = gain.seen(begun[None])
    most = seen + np.minimum(more, gain.sees @ open_[:, None].astype(int))
    bounds = gain.figures_at_most(seen, most, more, open_[None])
    for added in combinations(np.flatnonzero(open_ & ~np.isin(np.arange(OPTIONS), begun)).tolist(), more):
        for bound, pair in zip(bounds, gain.figures(gain.seen(np.array([[*begun, *added]]))), strict=True):
            assert np.all(~(pair > bound + 1e-12))


@pytest.mark.parametrize("seed", range(30))
def test_another_set_is_found_if_the_one_that_is_found_at_once_is_not_to_be_chosen(seed):
    problem, demand = random_problem(np.random.default_rng(seed)), Demand(most=2)
    known = improved(problem, demand, 2)
    problem = replace(problem, missing=frozenset({known.options}))
    counts = range(problem.at_least(demand), 3)
    best = max((one.least for count in counts for one in each_choice(problem, demand, count)), default=None)
    for search in (ChoiceSearch(problem, demand, lambda *_: None, start) for start in (None, known)):
        for found in (search.first(), search.best()):
            assert found.proven
            if best is None:
                assert found.choice is None
            else:
                assert found.choice is not None
                assert found.choice.options != known.options
                assert worth_of(problem, found.choice).least == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize(("count", "looks"), [(1, [1]), (4, [2, 2, 2, 1, 1])])
def test_the_rows_that_are_needed_are_looked_for_a_few_at_a_time_where_sets_are_many(count, looks, monkeypatch):
    problem, demand = replace(random_problem(np.random.default_rng(3)), kept=frozenset()), Demand()
    expected, sizes = EverySet(problem, demand).best([count]), list[int]()
    at_most = EverySet._at_most

    def watched(every, cameras, seen, figures):
        sizes.extend([seen.shape[1]] * (cameras.shape[1] == 0))
        return at_most(every, cameras, seen, figures)

    monkeypatch.setattr(every, "_TOGETHER", 32)
    monkeypatch.setattr(EverySet, "_at_most", watched)
    found = EverySet(problem, demand).best([count])
    assert (found.options, found.ways) == (expected.options, expected.ways)
    assert sizes == looks
