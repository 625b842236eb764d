"""Numbers with units: `30 deg`, `20 mm`, `5 cm/s`; a plain number is in SI units and radians.

Bounds of the numbers in files keep computations from overflowing or running for ever.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import field
from math import pi

from sqrp_cli.records import dataclass

LARGEST = 1e6  # largest number by default, in SI units
LARGEST_LENGTH = 1000.0  # largest coordinate, distance and extent [m]
LARGEST_ANGLE = 20 * pi  # largest angle: ten turns [rad]
LONGEST = 3600.0  # longest time [s]
SMALLEST_SIZE = 1e-6  # smallest extent of a shape [m]
SHORTEST_DIRECTION = 1e-9  # a vector that is shorter has no direction
SMALLEST_LIMIT = 1e-6  # smallest velocity, acceleration and jerk; below it motions would never end
NO_LIMIT = 1e18  # largest joint limit in a URDF; some descriptions write huge numbers for "no limit"
_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(\S.*?)?\s*")
TURN = 6.2832  # slightly more than a turn [rad]. A larger angle without a unit was meant in degrees
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLES = {"rad": 1.0, "deg": pi / 180, "°": pi / 180}


@dataclass(frozen=True, eq=False)
class Dimension:
    """A kind of quantity, with its units and their values in SI units."""

    name: str
    units: dict[str, float] = field(repr=False)
    example: str  # An example for messages


LENGTH = Dimension("a length", _LENGTHS, "20 mm")
ANGLE = Dimension("an angle", _ANGLES, "30 deg")
TIME = Dimension("a time", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}, "50 ms")
FREQUENCY = Dimension("a frequency", {"Hz": 1.0, "kHz": 1e3, "fps": 1.0}, "10 Hz")
SPEED, ACCELERATION, JERK, ANGULAR_SPEED, ANGULAR_ACCELERATION, ANGULAR_JERK = (
    Dimension(name, {f"{unit}/s{power}": factor for unit, factor in base.items()}, example)
    for name, base, power, example in (
        ("a speed", _LENGTHS, "", "5 cm/s"),
        ("an acceleration", _LENGTHS, "^2", "0.5 m/s^2"),
        ("a jerk", _LENGTHS, "^3", "5 m/s^3"),
        ("an angular speed", _ANGLES, "", "60 deg/s"),
        ("an angular acceleration", _ANGLES, "^2", "120 deg/s^2"),
        ("an angular jerk", _ANGLES, "^3", "600 deg/s^3"),
    )
)
PIXELS = Dimension("a number of pixels", {"px": 1.0}, "20 px")
FORCE = Dimension("a force", {"N": 1.0, "kN": 1e3}, "5 N")
SHARE = Dimension("a share", {"%": 0.01}, "50 %")

DIMENSIONS = (
    LENGTH, ANGLE, TIME, FREQUENCY, SPEED, ACCELERATION, JERK, ANGULAR_SPEED, ANGULAR_ACCELERATION, ANGULAR_JERK,
    PIXELS, FORCE, SHARE,
)  # fmt: skip


def as_number(text: str | bytes) -> float:
    """The number that a text is, which may be infinite; NaN for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


@dataclass(frozen=True)
class Quantity:
    """A number in SI units and its dimension, which is None for a plain number (it fits every dimension)."""

    value: float
    dimension: Dimension | None


def read_quantity(value: object) -> Quantity | None:
    """A finite number, or text of a number and a known unit, as a quantity; None for anything else."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return Quantity(float(value), None) if math.isfinite(value) else None
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) and len(value) < 100 else None
    if match is None or not math.isfinite(float(match[1])):
        return None
    if match[2] is None:
        return Quantity(float(match[1]), None)
    unit = re.sub(r"\s*/\s*", "/", match[2]).replace("**", "^").replace("²", "^2").replace("³", "^3")
    unit = re.sub(r"/s([23])$", r"/s^\1", unit)
    for dimension in DIMENSIONS:
        if unit in dimension.units:
            return Quantity(float(match[1]) * dimension.units[unit], dimension)
    return None


_OFTEN_MEANT: Mapping[Dimension, tuple[str, str]] = {
    LENGTH: ("mm", "millimetres"),
    TIME: ("ms", "milliseconds"),
    SPEED: ("mm/s", "millimetres"),
    ACCELERATION: ("mm/s^2", "millimetres"),
    JERK: ("mm/s^3", "millimetres"),
    ANGULAR_SPEED: ("deg/s", "degrees"),
    ANGULAR_ACCELERATION: ("deg/s^2", "degrees"),
    ANGULAR_JERK: ("deg/s^3", "degrees"),
    SHARE: ("%", "per cent"),
}
"""The unit that is often meant by a plain number too large in SI units, and its name."""


def meant_instead(value: object, dimension: Dimension | None, least: float, most: float) -> tuple[str, str] | None:
    """The probable meaning of a plain number beyond `most`, if that lies in the range, and how to write it.

    value: as in the file; least, most: the range in SI units. None for text with a unit, which is unambiguous.
    """
    read = read_quantity(value)
    if dimension is None or dimension not in _OFTEN_MEANT:
        return None
    if read is None or read.dimension is not None or abs(read.value) <= most:
        return None
    unit, name = _OFTEN_MEANT[dimension]
    stated, meant = f"{read.value:g} {unit}", read.value * dimension.units[unit]
    better = f"`{stated}` or {meant:.4g}"
    return (f"it looks like {name}: {stated} would be {better}", better) if least <= meant <= most else None


def in_unit(value: float, dimension: Dimension | None) -> str:
    """A number in SI units as a message shows it: angles in degrees, shares in both forms, others in m, s, px, ..."""
    if dimension is None:
        return f"{value:g}"
    if dimension is SHARE:
        return f"{value:g} ({100 * value:g} %)"
    unit = "deg" if dimension is ANGLE else next(iter(dimension.units))
    return f"{value / dimension.units[unit]:.4g} {unit}"


def shown_length(value: float) -> str:
    """A length [m] as a message shows it: in mm below 1 m, else in m."""
    return f"{1e3 * value:.1f} mm" if abs(value) < 1 else f"{value:.4g} m"


def expected_quantity(*dimensions: Dimension) -> str:
    """The expected quantities for a message: "a length such as `20 mm` (units m, cm, mm, um)"."""
    if not dimensions:
        return "a number"
    return " or ".join(
        f"{dimension.name} such as `{dimension.example}` (units {', '.join(dimension.units)})"
        for dimension in dimensions
    )
