"""What a setting of a skill may be: a quantity within bounds, or one of a few words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.errors import nearest
from sqrp_cli.knowledge import units
from sqrp_cli.knowledge.bounds import LARGEST, LONGEST, SMALLEST_LIMIT
from sqrp_cli.knowledge.units import Dimension, Quantity, expected_quantity, in_unit, meant_instead

SIDES = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Kind:
    """What a setting may be: a quantity of a dimension within bounds, or a word."""

    dimension: Dimension | None = None
    least: float = -np.inf
    most: float = np.inf
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
        if value.dimension is None and self.dimension is units.ANGLE and not self.least <= value.value <= self.most:
            return "wrong-unit", f"found {value.value:g}, which would be radians; expected {self._expected()}"
        if value.value < self.least:
            return "wrong-value", f"found {value.value:g}, expected a value of at least {self._shown(self.least)}"
        if value.value > self.most:
            message = f"found {value.value:g}, expected a value of at most {self._shown(self.most)}"
            plain = value.value if value.dimension is None else None
            meant = meant_instead(plain, self.dimension, self.least, self.most)
            return "wrong-value", message + (f"; {meant}" if meant else "")
        return None

    def _shown(self, bound: float) -> str:
        return in_unit(bound, self.dimension)

    def _expected(self) -> str:
        if self.dimension is not None:
            return expected_quantity(self.dimension)
        return "one of " + ", ".join(f"`{word}`" for word in self.words)


YAW = Kind(units.ANGLE, least=-units.TURN, most=units.TURN)
SIDE = Kind(words=SIDES)
ELBOW = Kind(words=("any", "up", "down"))
SHOULDER = Kind(words=("any", "left", "right"))
WRIST = Kind(words=("any", "no_flip", "flip"))
VIA = Kind(words=("direct", "home"))
DISTANCE = Kind(units.LENGTH, least=0.0, most=100.0)
OFFSET_SHARE = Kind(units.SHARE, least=-1.0, most=1.0)
SPEED_SHARE = Kind(units.SHARE, least=0.001, most=1.0)
SPEED = Kind(units.SPEED, least=SMALLEST_LIMIT, most=100.0)
ACCELERATION = Kind(units.ACCELERATION, least=SMALLEST_LIMIT, most=1e4)
JERK = Kind(units.JERK, least=SMALLEST_LIMIT, most=LARGEST)
DURATION = Kind(units.TIME, least=0.0, most=LONGEST)
