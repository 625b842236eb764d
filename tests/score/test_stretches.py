"""Sets of stretches of time, against membership of single instants."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.logic.formula_time import Stretch, merge
from sqrp_cli.study.blind_spans import difference, intersection

stretches = st.lists(
    st.tuples(st.integers(0, 20), st.integers(1, 6)).map(lambda pair: Stretch(pair[0], pair[0] + pair[1])), max_size=6
).map(merge)
INSTANTS = [index + 0.5 for index in range(28)]


def contains(some: tuple[Stretch, ...], t: float) -> bool:
    return any(stretch.start < t < stretch.end for stretch in some)


@given(stretches, stretches)
def test_a_difference_holds_what_only_the_first_holds(first, second):
    for t in INSTANTS:
        assert contains(difference(first, second), t) == (contains(first, t) and not contains(second, t))


@given(stretches, stretches)
def test_an_intersection_holds_what_both_hold(first, second):
    for t in INSTANTS:
        assert contains(intersection(first, second), t) == (contains(first, t) and contains(second, t))
