"""A program at a share of its speed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sqrp_cli.files.entries import Entry
from sqrp_cli.logic.image_time import Onset, Window
from sqrp_cli.program.record import Step
from sqrp_cli.trajectory import Trajectory

_INTERVAL = re.compile(r"(?<=\[)[^\[\]]*(?=\])")  # The bounds of an interval in the text of a formula
_TIMES = ("time", "start", "end", "seen", "usual", "refuted")
"""Fields with times that are as many times as long; how late an image is, how often one is taken, and how long a
literal may lag stay as they are."""


def slowed(step: Step, speed: float) -> Step:
    """A step at a share of its speed, in 0..1, with its predictions: the same paths, and all times longer.

    How late faults are noticed is known by its sights alone.
    """
    if speed == 1.0:
        return step
    found: Step = _longer(step, "", 1.0 / speed)
    return found.model_copy(update={"faults": {}})


def _longer(value: Any, name: str, factor: float) -> Any:  # noqa: ANN401 - of any field of a step
    """The value of a field of that name with all times in it `factor` times as long."""
    match value:
        case float() if name in _TIMES:
            return value * factor
        case str() if name == "formula":
            return _INTERVAL.sub(lambda bounds: ", ".join(repr(float(t) * factor) for t in bounds[0].split(",")), value)
        case tuple():
            return tuple(_longer(part, name, factor) for part in value)
        case Mapping():
            return {key: _longer(part, name, factor) for key, part in value.items()}
        case Trajectory():
            return Trajectory(value.path, value.law.stretched(factor))
        case Onset():
            return Onset(value.x * factor, value.shown * factor)
        case Window():
            return replace(value, start=value.start * factor, end=value.end * factor)
        case Entry():
            fields = ((field, getattr(value, field)) for field in type(value).model_fields)
            return value.model_copy(update={field: _longer(part, field, factor) for field, part in fields})
    return value
