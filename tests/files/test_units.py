"""Numbers with units."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.files.units import DIMENSIONS, Dimension, read_quantity


@pytest.mark.parametrize(("text", "value", "dimension"), [
        ("30 deg", math.pi / 6, "an angle"), ("20 mm", 0.02, "a length"), ("5cm", 0.05, "a length"),
        ("1e-3 m", 0.001, "a length"), ("-.5 rad", -0.5, "an angle"), ("60 deg/s", math.pi / 3, "an angular speed"),
        ("60 deg / s", math.pi / 3, "an angular speed"), ("5 cm/s", 0.05, "a speed"),
        ("120 deg/s^2", 2 * math.pi / 3, "an angular acceleration"),
        ("120 deg/s2", 2 * math.pi / 3, "an angular acceleration"), ("600 deg/s³", 10 * math.pi / 3, "an angular jerk"),
        ("10 Hz", 10.0, "a frequency"), ("50 ms", 0.05, "a time"), ("2 min", 120.0, "a time"), ("50 %", 0.5, "a share"),
        ("20 px", 20.0, "a number of pixels"),
])  # fmt: skip
def test_text_with_a_unit_is_in_si_units(text: str, value: float, dimension: str) -> None:
    quantity = read_quantity(text)
    assert quantity.value == pytest.approx(value, rel=1e-15)
    assert quantity.dimension.name == dimension


@pytest.mark.parametrize("value", [3, 0.5, -2, "3", " 4.5 "])
def test_a_plain_number_fits_every_dimension(value: object) -> None:
    quantity = read_quantity(value)
    assert quantity.dimension is None
    assert quantity.value == float(value)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "value",
    ["", "m", "5 parsec", "5 m m", "5 deg/s/s/s/s", "nan m", "inf", "1e999 m", True, None, [1], "1,5 m", "1" * 200],
)
def test_anything_else_is_no_quantity(value: object) -> None:
    assert read_quantity(value) is None


@given(st.sampled_from(DIMENSIONS), st.floats(-1e6, 1e6), st.data())
def test_a_unit_multiplies_the_number(dimension: Dimension, number: float, data: st.DataObject) -> None:
    unit = data.draw(st.sampled_from(sorted(dimension.units)))
    quantity = read_quantity(f"{number!r} {unit}")
    assert quantity.dimension is dimension
    assert quantity.value == number * dimension.units[unit]


def test_no_unit_has_two_meanings() -> None:
    units = [unit for dimension in DIMENSIONS for unit in dimension.units]
    assert len(units) == len(set(units))
