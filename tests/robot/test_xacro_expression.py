"""Expressions of xacro files give what Python gives, and reach nothing that Python could."""

from __future__ import annotations

import math

import pytest
import xacro
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.robot.xacro_expression import UNOFFERED, RefusedExpressionError, evaluate

NAMES = {"width": 0.5, "side": "left", "ports": [1, 2, 3], "cfg": {"arm": {"mass": 3.7}, "flag": True}}


def value(expression: str, **names: object) -> object:
    symbols = xacro.create_global_symbols()
    for one in UNOFFERED:
        symbols["python"].pop(one, None)
    return evaluate(expression, {**symbols, **NAMES, **names})


@pytest.mark.parametrize(("expression", "expected"), [
        ("1 if side == 'left' else -1", 1), ("-width/2 + pi", math.pi - 0.25), ("radians(90)", math.pi / 2),
        ("math.sin(0.5)", math.sin(0.5)), ("cfg['arm']['mass'] * 2", 7.4), ("cfg.arm.mass", 3.7),
        ("cfg.get('leg', 4)", 4), ("[float(x) for x in '1 2 3'.split()][1]", 2.0),
        ("list(map(float, '1 2'.split()))", [1.0, 2.0]), ("' '.join([str(p) for p in ports if p > 1])", "2 3"),
        ("'{:.2f}'.format(width)", "0.50"), ("'%.1f' % width", "0.5"), ("side[:2] + side[-1]", "let"),
        ("not (side in ['right', 'top']) and 1 < 2 <= 2", True), ("max(*ports)", 3),
        ("sorted(ports, reverse=True)[0]", 3), ("side.startswith('le')", True),
        ("len(range(4)) + python.sum(ports)", 10), ("2**3 % 5 // 2", 1),
])  # fmt: skip
def test_what_descriptions_use_is_evaluated(expression: str, expected: object) -> None:
    assert value(expression) == expected


@given(st.recursive(
    st.integers(-9, 9).map(str) | st.sampled_from(["0.5", "width", "True"]),
    lambda part: st.tuples(part, st.sampled_from(["+", "-", "*", "<", "==", "and", "or"]), part).map(
        lambda three: f"({' '.join(three)})"
    ),
))  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_arithmetic_is_that_of_python(expression: str) -> None:
    assert value(expression) == eval(expression, {}, dict(NAMES))  # noqa: S307 - made above


@pytest.mark.parametrize("expression", [
        "().__class__.__bases__[0].__subclasses__()", "side.__class__", "'{0.__class__}'.format(side)",
        "'%s' % (lambda: 1)", "[c for c in ().__class__.__base__.__subclasses__()]", "(lambda: ().__class__)()",
        "math.__loader__", "python.type(1)", "python.vars()", "str.mro()", "str.format('{0.__class__}', 1)",
        "__import__('os').system('true')", "open('/etc/passwd')", "(p for p in ports).gi_frame",
        "xacro.load_yaml.__globals__", "load_yaml.__globals__", "list(map('{0.real}'.format, ports))",
        "list(map(str.format, ['{0.real}'], ports))", "'{0[arm]}'.format(cfg)", "'{:{0.real}}'.format(1)",
        "dict.fromkeys(ports)", "_", "__builtins__", "cfg.update", "ports.append(1)", "(x := 1)", "f'{width!r:>9}'",
        "math.sin.__self__", "getattr(side, 'upper')", "math['__doc__']",
])  # fmt: skip
def test_nothing_of_python_itself_can_be_reached(expression: str) -> None:
    with pytest.raises((RefusedExpressionError, KeyError, AttributeError)):
        value(expression)


def test_a_name_that_is_not_defined_has_a_suggestion() -> None:
    with pytest.raises(RefusedExpressionError, match="`widht` is not defined; did you mean `width`"):
        value("widht + 1")
