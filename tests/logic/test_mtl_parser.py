from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Place
from sqrp_cli.logic.formula import Formula, Instant, Interval, Operation, Predicate, check_formula
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.pddl_parser import parse_domain
from tests.cells import read_cases

PLACE = Place(Path("skill.yaml"), 3, 5)
CASES = read_cases("mtl_errors.yaml")


def parse(text: str) -> Formula:
    return parse_formula(text, PLACE)


names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,6}(-[a-z0-9]{1,3})?", fullmatch=True).filter(
    lambda name: name not in {"always", "eventually", "G", "F", "not", "and", "or", "implies"}
)
numbers = st.floats(0, 1e9, allow_subnormal=False)
instants = st.builds(Instant, offset=numbers) | st.builds(
    Instant, names, st.sampled_from(["start", "end"]), st.floats(-1e9, 1e9, allow_subnormal=False)
)
intervals = st.builds(Interval, instants, instants)
predicates = st.builds(Predicate, names, st.none() | st.lists(names, min_size=1, max_size=3).map(tuple))


def combined(parts: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    return st.one_of(
        st.builds(Operation, st.just("not"), st.tuples(parts)),
        st.builds(Operation, st.sampled_from(["and", "or"]), st.lists(parts, min_size=2, max_size=3).map(tuple)),
        st.builds(Operation, st.just("implies"), st.tuples(parts, parts)),
        st.builds(Operation, st.sampled_from(["always", "eventually"]), st.tuples(parts), intervals),
    )


formulas = st.recursive(predicates, combined, max_leaves=12)


@given(formulas)
def test_parsing_what_was_printed_gives_the_same_formula(formula: Formula) -> None:
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(("text", "same"), read_cases("logic.yaml")["spellings"])
def test_spellings_and_precedence(text: str, same: str) -> None:
    assert parse(text) == parse(same)


def test_grouping_of_the_writer_is_kept_and_a_keyword_may_begin_a_name() -> None:
    assert parse("(a and b) and c") != parse("a and b and c")
    assert str(parse("(a and b) and c")) == "(a and b) and c"
    names = Operation("and", (Predicate("nothing"), Predicate("Grip")))
    assert parse("nothing and Grip or orange") == Operation("or", (names, Predicate("orange")))
    assert parse("(" * 6000 + "x" + ")" * 6000) == Predicate("x")
    text = "eventually[a4.start, a4.end] (obj_on_table(g1) and not hold(g1))"
    assert str(parse(text)) == str(parse("◇[a4.start, a4.end] (obj_on_table(g1) ∧ ¬hold(g1))")) == text


@pytest.mark.parametrize("case", CASES["cases"], ids=lambda case: case["input"][:40] or "empty")
def test_errors_say_what_is_wrong_and_where(case: dict[str, str]) -> None:
    domain = parse_domain(CASES["domain"], Path("handling.pddl"))
    try:
        formula = parse(case["input"])
        problems = list(check_formula(formula, domain, domain.actions[CASES["action"]], CASES["primitives"]))
    except InputError as error:
        problems = error.problems
    assert len(problems) == 1
    (problem,) = problems
    assert problem.place is not None
    assert (problem.code, problem.place.line, problem.place.column) == (case["code"], case["line"], case["column"])
    assert case["message"] in problem.message
    line, caret = str(problem.excerpt).split("\n")
    shift = 4 if case["line"] == 3 else 0
    assert caret == " " * (case["column"] - 1 - shift) + "^"
    assert line == case["input"].split("\n")[case["line"] - 3].rstrip()


def test_columns_of_further_lines_count_the_indentation_that_was_taken_off() -> None:
    with pytest.raises(InputError) as error:
        parse_formula("hold\n and", PLACE, indent=4)
    place = error.value.problems[0].place
    assert place is not None
    assert (place.line, place.column) == (4, 9)


@pytest.mark.parametrize(
    "text", ["!" * 400 + "x", "always[0, 1] " * 300 + "x", "x -> " * 300 + "x", "x & " * 5001 + "x"]
)
def test_huge_formulas_are_refused(text: str) -> None:
    with pytest.raises(InputError) as error:
        parse(text)
    assert error.value.problems[0].code in {"mtl-too-deep", "mtl-too-long"}


@given(st.text(st.sampled_from("always[].startGF !&|->hold(),12 \n\t$□¬"), max_size=40))
def test_any_text_is_read_or_refused_with_a_place_inside_it(text: str) -> None:
    try:
        parse(text)
    except InputError as error:
        (problem,) = error.problems
        assert problem.place is not None
        assert 3 <= (problem.place.line or 0) <= 3 + text.count("\n")
