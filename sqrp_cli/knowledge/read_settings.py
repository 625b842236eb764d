"""Motion parameters of a skill, and the settings that use them, with their dimensions checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sqrp_cli.errors import Problem, expected_names
from sqrp_cli.knowledge.setting_kind import Kind
from sqrp_cli.knowledge.skill import MotionParameter, MotionValue, Reference, Setting
from sqrp_cli.knowledge.skill_file import ListedValues, ValueRange
from sqrp_cli.knowledge.source import Document, KeyPath, describe
from sqrp_cli.knowledge.units import Quantity


@dataclass
class SettingsReader:
    """Reads the motion parameters and settings of one skill file and collects what is wrong with them."""

    document: Document
    entries: Mapping[str, ListedValues | ValueRange | Quantity | str]
    problems: list[Problem] = field(default_factory=list)
    _kinds: dict[str, list[Kind]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._values = {name: self._read_values(name) for name in self.entries}

    def parameters(self) -> tuple[MotionParameter, ...]:
        """The motion parameters with their values in SI units; to be asked when all settings have been read."""
        parameters = []
        for name in self.entries:
            values = tuple(value.value if isinstance(value, Quantity) else value for value in self._values[name])
            if len(set(values)) < len(values):
                self.problems.append(
                    self.document.problem("repeated-value", ("motion", name), "a value is given twice")
                )
            kinds = tuple(dict.fromkeys(self._kinds.get(name, ())))
            parameters.append(MotionParameter(name, values, kinds))
        return tuple(parameters)

    def setting(self, value: Quantity | str | Reference, kind: Kind, path: KeyPath) -> Setting:
        """The setting at `path`, whose own value or whose parameter's values must be of `kind`."""
        if isinstance(value, Reference):
            if value.parameter not in self.entries:
                expected = expected_names(value.parameter, self.entries)
                message = f"found `${value.parameter}`, which is no parameter under `motion`; {expected}"
                self.problems.append(self.document.problem("unknown-parameter", path, message))
                return value
            self._kinds.setdefault(value.parameter, []).append(kind)
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
