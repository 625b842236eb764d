"""Expressions of xacro files give what Python gives, and reach nothing that Python could."""

from __future__ import annotations

import pytest
import xacro
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.robot.xacro_expression import UNOFFERED, RefusedExpressionError, evaluate
from tests.cells import read_cases

NAMES = {"width": 0.5, "side": "left", "ports": [1, 2, 3], "cfg": {"arm": {"mass": 3.7}, "flag": True}}


def value(expression: str, **names: object) -> object:
    symbols = xacro.create_global_symbols()
    for one in UNOFFERED:
        symbols["python"].pop(one, None)
    return evaluate(expression, {**symbols, **NAMES, **names})


CASES = read_cases("xacro_expressions.yaml")


@pytest.mark.parametrize(("expression", "expected"), CASES["evaluated"])
def test_what_descriptions_use_is_evaluated(expression, expected):
    assert value(expression) == pytest.approx(expected)


@given(st.recursive(
    st.integers(-9, 9).map(str) | st.sampled_from(["0.5", "width", "True"]),
    lambda part: st.tuples(part, st.sampled_from(["+", "-", "*", "<", "==", "and", "or"]), part).map(
        lambda three: f"({' '.join(three)})"
    ),
))  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_arithmetic_is_that_of_python(expression):
    assert value(expression) == eval(expression, {}, dict(NAMES))  # noqa: S307 - made above


@pytest.mark.parametrize("expression", CASES["refused"])
def test_nothing_of_python_itself_can_be_reached(expression):
    with pytest.raises((RefusedExpressionError, KeyError, AttributeError)):
        value(expression)


def test_a_name_that_is_not_defined_has_a_suggestion():
    with pytest.raises(RefusedExpressionError, match="`widht` is not defined; did you mean `width`"):
        value("widht + 1")
