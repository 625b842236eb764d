"""Settings of a skill: the kinds of their values, and the motion parameters that candidates vary."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, PlainValidator, Tag, WithJsonSchema
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_after_validator_function

from sqrp_cli.errors import nearest
from sqrp_cli.files import units
from sqrp_cli.files.entries import Entry, MappingOr, any_quantity, one_of
from sqrp_cli.records import dataclass

MotionValue = float | str  # value of a motion parameter: a number in SI units, or a word such as `+z` or `up`
ANY = "any"  # the value that leaves a setting free: every choice is a way of doing the same
FASTEST = "fastest"  # the value of a branch that leaves it to the time that the motion takes
DIRECT = "direct"  # the path of a joint move that is straight in joint space, and the value of `via` without a stop
SEEN = "seen"  # the path of a joint move that the cameras can follow
FIRST_SIDE, FIRST_NUMBER = "+z", 0.0  # the first choices of a side and of a yaw that are left free
NOTHING_SPECIAL = "as at home"  # what a way says beyond its candidate where that is nothing
MAX_VALUES = 1000  # most values of one motion parameter


@dataclass(frozen=True)
class Reference:
    """The name of a motion parameter, in place of a number or word."""

    parameter: str


def number_of(value: MotionValue) -> float:
    """The number that a value is [SI units]; of one that is left free, the first choice."""
    return FIRST_NUMBER if value == ANY else float(value)


def side_of(value: MotionValue) -> str:
    """The side that a value names; of one that is left free, the first choice."""
    return FIRST_SIDE if value == ANY else str(value)


def _value(value: object) -> units.Quantity | str:
    if isinstance(value, str) and units.read_quantity(value) is None and value and not any(map(str.isspace, value)):
        return value
    return any_quantity(value, "a number, a number with a unit such as `5 cm`, or a word")


def _setting(value: object) -> units.Quantity | str | Reference:
    return Reference(value[1:]) if isinstance(value, str) and value.startswith("$") else _value(value)


_ANY = {"anyOf": [{"type": "number", "minimum": -units.LARGEST, "maximum": units.LARGEST}, {"type": "string"}]}
Value = Annotated[units.Quantity | str, PlainValidator(_value), WithJsonSchema(_ANY)]
"""A quantity or a word; its dimension is checked against the settings that use the parameter."""
Setting = Annotated[
    MotionValue | Reference,
    PlainValidator(_setting),
    WithJsonSchema({**_ANY, "description": "A number with its unit, a word, or $PARAMETER."}),
]
"""A value, or a reference to a motion parameter; the `Kind` beside it limits the values."""


@dataclass(frozen=True)
class Kind:
    """The values that a setting can take: a quantity of a dimension within bounds, or one of some words."""

    dimension: units.Dimension | None = None
    least: float = -np.inf
    most: float = np.inf
    words: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        # A quantity becomes its number in SI units; one of another dimension stays, and `read_skill` refuses it.
        return no_info_after_validator_function(
            lambda value: value.value if isinstance(value, units.Quantity) and self.complaint(value) is None else value,
            handler(source),
        )

    def complaint(self, value: units.Quantity | str) -> tuple[str, str] | None:
        """What is wrong with a value, as the code and message of a problem; None if nothing is."""
        dimension, words = self.dimension, ", ".join(f"`{word}`" for word in self.words)
        expected = f"one of {words}"
        if dimension is not None:
            expected = units.expected_quantity(dimension) + (f", or {words}" if words else "")
        if isinstance(value, str):
            if value in self.words:
                return None
            plain = ""  # a number in the first unit stands for a quantity too, but radians are seldom meant
            if dimension is units.SHARE:
                plain = f"a number from {self.least:g} to {self.most:g}, or "
            elif dimension is not None and dimension is not units.ANGLE:
                plain = f"a number in {next(iter(dimension.units))}, or "
            close = nearest(value, self.words)
            hint = f"; did you mean `{close}`?" if close else ""
            return "wrong-value", f"found `{value}`, expected {plain}{expected}{hint}"
        number, is_plain = value.value, value.dimension is None
        if dimension is None or value.dimension not in (None, dimension):
            found = value.dimension.name if value.dimension else f"`{number:g}`"
            return "wrong-unit", f"found {found}, expected {expected}"
        if self.least <= number <= self.most:
            return None
        if is_plain and dimension is units.ANGLE:
            return "wrong-unit", f"found {number:g}, which would be radians; expected {expected}"
        found = f"{number:g}" if is_plain else units.in_unit(number, dimension)
        if number < self.least:
            least = units.in_unit(self.least, dimension)
            return "wrong-value", f"found {found}, expected a value of at least {least}"
        message = f"found {found}, expected a value of at most {units.in_unit(self.most, dimension)}"
        meant = units.meant_instead(number if is_plain else None, dimension, self.least, self.most)
        return "wrong-value", message + (f"; {meant[0]}" if meant else "")


PATHS = Kind(words=(DIRECT, SEEN, ANY))  # the paths of joint moves
Turn = Annotated[Setting, Kind(units.ANGLE, least=-units.TURN, most=units.TURN)]
Yaw = Annotated[Setting, Kind(units.ANGLE, least=-units.TURN, most=units.TURN, words=(ANY,))]
Side = Annotated[Setting, Kind(words=("+x", "-x", "+y", "-y", "+z", "-z", ANY))]
Elbow = Annotated[Setting, Kind(words=(ANY, FASTEST, "up", "down"))]
Shoulder = Annotated[Setting, Kind(words=(ANY, FASTEST, "left", "right"))]
Wrist = Annotated[Setting, Kind(words=(ANY, FASTEST, "no_flip", "flip"))]
Via = Annotated[Setting, Kind(words=(DIRECT, "home", ANY))]
Path = Annotated[Setting, PATHS]
Distance = Annotated[Setting, Kind(units.LENGTH, least=0.0, most=100.0)]
Offset = Annotated[Setting, Kind(units.LENGTH, least=-100.0, most=100.0)]
Turns = Annotated[Setting, Kind(units.ANGLE, least=-20 * units.TURN, most=20 * units.TURN)]
Force = Annotated[Setting, Kind(units.FORCE, least=0.1, most=1000.0)]
TurnSpeed = Annotated[Setting, Kind(units.ANGULAR_SPEED, least=units.SMALLEST_LIMIT, most=100.0)]
OffsetShare = Annotated[Setting, Kind(units.SHARE, least=-1.0, most=1.0)]
SpeedShare = Annotated[Setting, Kind(units.SHARE, least=0.001, most=1.0)]
Speed = Annotated[Setting, Kind(units.SPEED, least=units.SMALLEST_LIMIT, most=100.0)]
Acceleration = Annotated[Setting, Kind(units.ACCELERATION, least=units.SMALLEST_LIMIT, most=1e4)]
Jerk = Annotated[Setting, Kind(units.JERK, least=units.SMALLEST_LIMIT, most=units.LARGEST)]
Duration = Annotated[Setting, Kind(units.TIME, least=0.0, most=units.LONGEST)]


class ListedValues(Entry):
    """The values that candidates try, in order; the first is the default."""

    values: list[Value] = Field(min_length=1, max_length=MAX_VALUES, description="Numbers with their units, or words.")


class ValueRange(Entry):
    """Values spread evenly from one bound to the other, both included."""

    start: Value = Field(alias="from", description="The first.")
    to: Value = Field(description="The last.")
    count: Annotated[int, Field(strict=True, ge=2, le=MAX_VALUES, description="How many.")]


MotionValues = MappingOr[
    Annotated[
        Annotated[ListedValues, Tag("<values>")] | Annotated[ValueRange, Tag("<from>")], one_of("values", "from")
    ],
    Value,
]
"""The values of a motion parameter as a file states them: a list, a range or a single one."""


@dataclass(frozen=True)
class MotionParameter:
    """A parameter of the motion with the values that candidates try, in order; the first is the default."""

    name: str
    values: tuple[MotionValue, ...]
    kinds: tuple[Kind, ...] = ()  # The kind of each setting that uses it
    implicit: bool = False
    """Whether the skill does not list it: a setting that is free, or the path of its joint moves.

    Candidates show it only where a task sets it.
    """
