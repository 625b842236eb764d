"""Figures of what the cameras see: of a fault, the qualities, and all of a candidate.

SI units, shares in 0..1. Nothing of the program but its foundations is imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from sqrp_cli.document import LEFT_OUT, Record
from sqrp_cli.files.entries import FileRecord
from sqrp_cli.geometry import check_finite
from sqrp_cli.records import dataclass

Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


FIGURE_NAMES = {
    "q_eoi": "critical time seen",
    "q_avg": "time seen",
    "time": "time",
    "delay": "noticed at the latest after",
    "delay_mean": "noticed after",
    "delay_worst": "noticed at the latest after",
    "expected_time": "done after a retry at",
}
"""What texts call the figures of a candidate."""


def shown_figure(name: str, value: float | None, more: int = 0) -> str:
    """A figure as texts show it: `63.4 %`, `12.30 s`, `never` if it is infinite, `-` if undefined; more: digits."""
    if value is None or value == inf:
        return "-" if value is None else "never"
    if name in ("q_eoi", "q_avg"):
        return f"{100 * value:.{1 + more}f} %"
    return f"{value:.{(1 if name == 'expected_time' else 2) + more}f} s"


def named_figures(found: object, *names: str, between: str = " ") -> list[str]:
    """Each of some figures that is not None as texts show it, with its name: `time seen 63.4 %`."""
    known = ((name, getattr(found, name)) for name in names)
    return [f"{FIGURE_NAMES[name]}{between}{shown_figure(name, value)}" for name, value in known if value is not None]


ROUNDING = 1e-9  # by how much a quality, or a time [s], may miss a threshold: both come of sums of times


def falls_short(quality: float, least: float) -> bool:
    """Whether a quality is below a threshold."""
    return quality < least - ROUNDING


LATE = 1.0  # A fault that may be noticed later than this is late [s]: texts say why

LateCause = Literal[
    "line_of_sight", "hardly_apart", "no_place", "not_in_place", "fingers_close", "fingers_hide", "not_seen",
    "not_asked", "still_there", "frame",
]  # fmt: skip
"""What takes longest until a fault is noticed."""


@dataclass(frozen=True, kw_only=True)
class LateReason(FileRecord):
    """What takes longest until a fault is noticed, if it happens when that takes longest, or may never be."""

    kind: LateCause
    """What takes longest."""
    camera: str | None
    """The slowest camera, or of those that do not see it one that comes nearest; null where it is none of one."""
    at: Seconds
    """When the fault then happens, from the start of the skill [s]."""
    after: Seconds | None
    """From then until that has passed [s]; null if it never does."""
    words: str
    """It in words, as the end of a sentence."""


@dataclass(frozen=True)
class FaultMetrics(FileRecord):
    """The cost of a fault at a time x, uniform over its interval."""

    delay_mean: Seconds | None
    """From x until it is noticed, mean over the x after which it is [s]; null if it never is."""
    delay_worst: Seconds | None
    """From x until it is noticed, supremum [s]; null where `unseen` is more than 0."""
    blind_longest: Seconds
    """Longest stretch of the interval in which it cannot be seen [s]."""
    unseen: Share
    """Share of x after which it may never be noticed, as no image is sure to show it, in 0..1."""
    expected_time: Seconds | None
    """Mean time from the start of the skill to its end after one retry [s]; null where `unseen` is more than 0."""
    why: LateReason | None = field(default=None, metadata=LEFT_OUT)
    """What takes longest until it is noticed; not in programs."""

    def __post_init__(self) -> None:
        """Raises ValueError if a figure is not finite."""
        check_finite("a fault", [value for value in vars(self).values() if isinstance(value, float)])


@dataclass(frozen=True)
class Qualities(Record):
    """Q_avg and Q_eoi."""

    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""

    def __post_init__(self) -> None:
        """Raises ValueError if a figure is not finite, also one of a subclass."""
        check_finite("a figure", [value for value in vars(self).values() if isinstance(value, float)])


@dataclass(frozen=True, eq=False, kw_only=True)
class Figures(Qualities):
    """The figures of a candidate. All are None, and `faults` is empty, where it is infeasible."""

    time: float | None
    """Duration of the whole motion [s]."""
    t_total: float | None
    """T, the time that formulas monitor [s]."""
    t_eoi: float | None
    """T_eoi, the time of the events of interest [s]."""
    faults: Mapping[str, FaultMetrics]
    """By the fault's name."""
    states: int | None
    """Samples that hold literals."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def unseen(self) -> float | None:
        """The largest share of times after which a fault may never be noticed, in 0..1; None without faults."""
        return max((fault.unseen for fault in self.faults.values()), default=None)

    @property
    def latest(self) -> float | None:
        """The longest time until a fault is noticed [s]: infinite where one may never be, None without faults."""
        worst = [inf if fault.delay_worst is None else fault.delay_worst for fault in self.faults.values()]
        return max(worst, default=None)

    @property
    def delay_worst(self) -> float | None:
        """The same; None where a fault may never be noticed."""
        return None if self.latest == inf else self.latest


NO_FIGURES = Figures(
    **{part.name: {} if part.name == "faults" else None for part in fields(Figures)}  # type: ignore[arg-type]
)
"""Those of an infeasible candidate."""


@dataclass(frozen=True, kw_only=True)
class AdvisedFigures(Qualities):
    """The figures of a candidate that a goal may be about; null where undefined, and all of an infeasible one."""

    time: float | None = None
    """Duration of the whole motion [s]."""
    delay_worst: float | None = None
    """The longest time that any fault may remain unnoticed [s]; null without faults, and where one may never be
    noticed."""
    unseen: float | None = None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
