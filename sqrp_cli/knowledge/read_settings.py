"""Motion parameters of a skill, and the settings that use them, with their dimensions checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sqrp_cli.errors import Problem, expected_names, nearest
from sqrp_cli.knowledge import units
from sqrp_cli.knowledge.skill import MotionParameter, MotionValue, Reference, Setting
from sqrp_cli.knowledge.skill_file import ListedValues, ValueRange
from sqrp_cli.knowledge.source import Document, KeyPath, describe
from sqrp_cli.knowledge.units import Dimension, Quantity, expected_quantity

SIDES = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Kind:
    """What a setting may be: a quantity of a dimension within bounds (the lower one excluded if `above`), or a word."""

    dimension: Dimension | None = None
    least: float = -np.inf
    most: float = np.inf
    above: bool = False
    words: tuple[str, ...] = ()

    def complaint(self, value: Quantity | str) -> tuple[str, str] | None:
        """What is wrong with a value, as the code and message of a problem, or None."""
        if isinstance(value, str):
            if value in self.words:
                return None
            close = nearest(value, self.words)
            hint = f"; did you mean `{close}`?" if close else ""
            return "wrong-value", f"found `{value}`, expected {self._expected()}{hint}"
        if self.dimension is None or value.dimension not in (None, self.dimension):
            found = value.dimension.name if value.dimension else f"`{value.value:g}`"
            return "wrong-unit", f"found {found}, expected {self._expected()}"
        if value.value < self.least or (self.above and value.value <= self.least):
            bound = f"{'above' if self.above else 'of at least'} {self.least:g}"
            return "wrong-value", f"found {value.value:g}, expected a value {bound}"
        if value.value > self.most:
            return "wrong-value", f"found {value.value:g}, expected a value of at most {self.most:g}"
        return None

    def _expected(self) -> str:
        if self.dimension is not None:
            return expected_quantity(self.dimension)
        return "one of " + ", ".join(f"`{word}`" for word in self.words)


YAW = Kind(units.ANGLE)
SIDE = Kind(words=SIDES)
DISTANCE = Kind(units.LENGTH, least=0.0)
SPEED_SHARE = Kind(units.SHARE, least=0.0, most=1.0, above=True)
SPEED = Kind(units.SPEED, least=0.0, above=True)
ACCELERATION = Kind(units.ACCELERATION, least=0.0, above=True)
JERK = Kind(units.JERK, least=0.0, above=True)
DURATION = Kind(units.TIME, least=0.0, most=3600.0)


@dataclass
class SettingsReader:
    """Reads the motion parameters and settings of one skill file and collects what is wrong with them."""

    document: Document
    entries: Mapping[str, ListedValues | ValueRange | Quantity | str]
    problems: list[Problem] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._values = {name: self._read_values(name) for name in self.entries}

    def parameters(self) -> tuple[MotionParameter, ...]:
        """The motion parameters with their values in SI units."""
        parameters = []
        for name in self.entries:
            values = tuple(value.value if isinstance(value, Quantity) else value for value in self._values[name])
            if len(set(values)) < len(values):
                self.problems.append(
                    self.document.problem("repeated-value", ("motion", name), "a value is given twice")
                )
            parameters.append(MotionParameter(name, values))
        return tuple(parameters)

    def setting(self, value: Quantity | str | Reference, kind: Kind, path: KeyPath) -> Setting:
        """The setting at `path`, whose own value or whose parameter's values must be of `kind`."""
        if isinstance(value, Reference):
            if value.parameter not in self.entries:
                expected = expected_names(value.parameter, self.entries)
                message = f"found `${value.parameter}`, which is no parameter under `motion`; {expected}"
                self.problems.append(self.document.problem("unknown-parameter", path, message))
                return value
            used_at = ".".join(str(part) for part in path)
            for parameter_value in self._values[value.parameter]:
                complaint = kind.complaint(parameter_value)
                if complaint:
                    code, message = complaint
                    message += f", because `{used_at}` uses it"
                    self.problems.append(self.document.problem(code, ("motion", value.parameter), message))
                    break
            return value
        complaint = kind.complaint(value)
        if complaint:
            self.problems.append(self.document.problem(complaint[0], path, complaint[1]))
        return _plain(value)

    def _read_values(self, name: str) -> tuple[Quantity | str, ...]:
        entry = self.entries[name]
        if isinstance(entry, ListedValues):
            return tuple(entry.values)
        if isinstance(entry, ValueRange):
            return self._spread(name, entry)
        return (entry,)

    def _spread(self, name: str, entry: ValueRange) -> tuple[Quantity | str, ...]:
        start, end = entry.start, entry.to
        if not isinstance(start, Quantity) or not isinstance(end, Quantity):
            word = end if isinstance(start, Quantity) else start
            message = f"found {describe(word)}, expected a number at both ends of a range"
            self.problems.append(self.document.problem("wrong-unit", ("motion", name), message))
            return (Quantity(0.0, None),)
        dimension = start.dimension or end.dimension
        if dimension is not end.dimension and end.dimension is not None:
            message = f"the range goes from {dimension.name if dimension else 'a number'} to {end.dimension.name}"
            self.problems.append(self.document.problem("wrong-unit", ("motion", name), message))
        return tuple(Quantity(float(value), dimension) for value in np.linspace(start.value, end.value, entry.count))


def _plain(value: Quantity | str) -> MotionValue:
    return value.value if isinstance(value, Quantity) else value
