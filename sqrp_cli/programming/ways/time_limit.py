"""How long a way may take: `--max-time`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqrp_cli.errors import Infeasible, bad_option
from sqrp_cli.knowledge.text.units import TIME, expected_quantity, read_quantity
from sqrp_cli.programming.coverage.assessment import Rehearsal

ROUNDING = 1e-9
"""By how much a way may exceed a limit, because times are sums [s]."""


@dataclass(frozen=True)
class TimeLimit:
    """The longest time of a way."""

    seconds: float | None = None
    """[s]; None for a multiple of the fastest way's."""
    times: float = 1.0
    """Of the time of the candidate's fastest way, where no seconds are given."""

    @classmethod
    def read(cls, text: str, option: str = "--max-time") -> TimeLimit:
        """A limit such as `20 s` or `1.25x`. Raises InputError for anything else."""
        stripped = text.strip()
        try:
            times = float(stripped[:-1]) if stripped.endswith("x") else None
        except ValueError:
            times = None
        if times is not None and 1.0 <= times <= 1e6:
            return cls(None, times)
        quantity = read_quantity(text)
        if times is None and quantity is not None and quantity.dimension in (None, TIME) and 0 < quantity.value <= 1e6:
            return cls(quantity.value)
        expected = f"{expected_quantity(TIME)}, or a multiple of the fastest way's time, at least 1, such as `1.25x`"
        raise bad_option(f"{option} is `{text}`, expected {expected}")

    def longest(self, scenes: Sequence[Rehearsal]) -> float:
        """The longest time of a way among all ways of a candidate [s]."""
        return self.times * min(scene.motion.time for scene in scenes) if self.seconds is None else self.seconds

    def within(self, scenes: Sequence[Rehearsal], whose: str = "its fastest way") -> Sequence[Rehearsal] | Infeasible:
        """The ways that keep the limit, or by how much the fastest one exceeds it. whose: what its reason calls it."""
        longest = self.longest(scenes)
        kept = [scene for scene in scenes if scene.motion.time <= longest + ROUNDING]
        if kept:
            return kept
        fastest = min(scene.motion.time for scene in scenes)
        return Infeasible((f"{whose} takes {fastest:.2f} s, {fastest - longest:.2f} s more than allowed",))
